"""Faces in a picture, with eyes, nose and mouth: viewers look there first.

CenterFace (Y. Xu et al. 2019, arXiv 1911.03599) says for each place how likely a face is centred there, its size and
its five marks. It also finds faces in profile or cut by the edge, and most faces of dogs.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.system import images

# Pixels of the longer side of the searched picture: large faces are found better in the smaller one.
_LONGEST = 640, 320
_CELL, _STRIDE = 4, 32  # pixels of a place of the answer; sides of the picture are multiples of the stride
_SURE = 0.35  # least likelihood; coins, galaxies, tissue and sketches have up to 0.11
_SAME = 0.3  # shared part of the union of two boxes, above which they show the same face
_OUTPUTS = ("537", "538", "539", "540")  # likelihood, size, offset and marks in the network's file
_DIGITS = 3  # processors differ in later ones


class Face(NamedTuple):
    """Place of a face: its centre, height and width, as shares of the picture's height and width.

    marks: row and column of the eyes, the nose and the corners of the mouth; empty if they are unknown
    """

    row: float
    column: float
    height: float
    width: float
    marks: tuple[tuple[float, float], ...] = ()


def faces(picture: Tensor) -> list[Face]:
    """Returns the faces in a picture, sRGB [3, H, W], largest first."""
    import cv2

    network = cv2.dnn.readNetFromONNX(str(Path(__file__).with_name("centerface.onnx")))
    pixels, kept = images.to_uint8(picture), list[Face]()
    found = [each for longest in _LONGEST for each in _search(network, pixels, longest)]
    for _, face in sorted(found, key=lambda each: -each[0]):
        if all(_shared_part(face, other) <= _SAME for other in kept):
            kept.append(face)
    return sorted(kept, key=lambda face: -face.height * face.width)


def _search(network: Any, pixels: NDArray[np.uint8], longest: int) -> list[tuple[float, Face]]:
    """Returns the likelihood and the place of each face in a picture [H, W, 3] that is resized first."""
    import cv2

    scale = longest / max(pixels.shape)
    rows, columns = (max(1, round(side * scale / _STRIDE)) * _STRIDE for side in pixels.shape[:2])
    network.setInput(cv2.dnn.blobFromImage(cv2.resize(pixels, (columns, rows), interpolation=cv2.INTER_AREA)))
    likely, size, offset, marks = (answer[0] for answer in network.forward(_OUTPUTS))
    at, whole = np.argwhere(likely[0] > _SURE), np.array((rows, columns)) / _CELL
    found = []
    for row, column in at:
        side = np.exp(size[:, row, column]) / whole
        middle = ((row, column) + offset[:, row, column] + 0.5) / whole
        places = middle + (marks[:, row, column].reshape(-1, 2) - 0.5) * side
        (down, across), (height, width), *seen = np.vstack((middle, side, places)).round(_DIGITS).tolist()
        face = Face(down, across, height, width, tuple((y, x) for y, x in seen))
        found.append((float(likely[0, row, column]), face))
    return found


def _shared_part(one: Face, other: Face) -> float:
    """Returns the shared area of two boxes, as a share of their union."""
    down = min(one.height, other.height, (one.height + other.height) / 2 - abs(one.row - other.row))
    across = min(one.width, other.width, (one.width + other.width) / 2 - abs(one.column - other.column))
    shared = max(0.0, down) * max(0.0, across)
    return shared / (one.height * one.width + other.height * other.width - shared)
