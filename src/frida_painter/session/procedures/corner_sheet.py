"""The picture of a canvas calibration: its outline on the photograph, and each corner through a magnifying glass."""

import cv2
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.perception.outline import Outline
from frida_painter.sheet import CREAM, SOFT, Sheet

_ROWS = 760
_GLASS = 24  # pixels of the photograph across a magnifying glass
_SIDE, _GAP, _MARGIN, _HEAD = 300, 24, 40, 56
_FOUND = (214, 40, 80)
_NAMES = ("top left", "top right", "bottom right", "bottom left")
_EDGE_POINTS = 33


def corner_sheet(photograph: NDArray[np.uint8], outline: Outline) -> Tensor:
    """The picture, sRGB [3, h, w] in [0, 1]: the photograph to the left, the four corners to the right."""
    scale = (_ROWS - _HEAD - _MARGIN) / photograph.shape[0]
    size = (round(photograph.shape[1] * scale), _ROWS - _HEAD - _MARGIN)
    left = _MARGIN + size[0] + _GAP
    sheet = Sheet(left + 2 * _SIDE + _GAP + _MARGIN, _ROWS, CREAM)
    edge = _edge(outline)
    seen = np.asarray(cv2.resize(photograph, size, interpolation=cv2.INTER_AREA), np.uint8)
    _trace(seen, (edge + 0.5) * scale - 0.5, 2)
    for column, row in (np.array(outline.corners) + 0.5) * scale - 0.5:
        _ring(seen, column, row, 9)
    sheet.paste(seen, (_MARGIN, _HEAD))
    # On the sheet the corners stand as they do on the canvas.
    for number, (across, down) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
        place = (left + across * (_SIDE + _GAP), _HEAD + down * (_SIDE + _GAP + 40))
        sheet.paste(_magnified(photograph, outline, edge, number), place)
        column, row = outline.corners[number]
        text = f"{_NAMES[number]}  {column:.1f}, {row:.1f}"
        sheet.text((place[0], place[1] + _SIDE + 6), text, 18, SOFT)
    sheet.text((_MARGIN, 20), "The canvas as it was found", 20)
    sheet.text((left, 20), f"Its corners, {_SIDE / _GLASS:g} times as large", 20)
    return sheet.tensor()


def _edge(outline: Outline) -> NDArray[np.float64]:
    """Points along the whole outline as it is seen, [n, 2]: through a lens its sides are bowed."""
    corners = np.array(outline.corners)
    straight = corners if outline.lens is None else outline.lens.straightened(corners)
    share = np.linspace(0, 1, _EDGE_POINTS, endpoint=False)[:, None]
    sides = [a + share * (b - a) for a, b in zip(straight, np.roll(straight, -1, axis=0), strict=True)]
    edge = np.concatenate(sides)
    return edge if outline.lens is None else outline.lens.bent(edge)


def _magnified(
    photograph: NDArray[np.uint8], outline: Outline, edge: NDArray[np.float64], number: int
) -> NDArray[np.uint8]:
    corner = np.array(outline.corners[number])
    scale = _SIDE / _GLASS
    shift = (_SIDE - 1) / 2 - scale * corner
    view = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    enlarged = cv2.warpAffine(
        photograph, view, (_SIDE, _SIDE), flags=cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=CREAM
    )
    glass: NDArray[np.uint8] = np.asarray(enlarged, np.uint8)
    _trace(glass, edge * scale + shift, 2)
    return glass


def _trace(picture: NDArray[np.uint8], points: NDArray[np.float64], width: int) -> None:
    cv2.polylines(picture, [(16 * points).round().astype(np.int32)], True, _FOUND, width, cv2.LINE_AA, shift=4)


def _ring(picture: NDArray[np.uint8], column: float, row: float, radius: int) -> None:
    center = (round(16 * column), round(16 * row))
    cv2.circle(picture, center, 16 * radius, (255, 255, 255), 4, cv2.LINE_AA, shift=4)
    cv2.circle(picture, center, 16 * radius, _FOUND, 2, cv2.LINE_AA, shift=4)
