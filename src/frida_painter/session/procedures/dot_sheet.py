"""The picture of a robot calibration: where its dots were meant to be, where they are, and what remains."""

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.frames import PixelGrid
from frida_painter.perception.homography import apply
from frida_painter.sheet import CREAM, INK, Sheet

_COLUMNS = 1100
_LARGER = 20
_MARGIN, _HEAD, _FOOT = 40, 24, 64
_MEANT, _SEEN, _MISSING = (40, 105, 185), (214, 40, 80), (225, 140, 20)
_RADIUS = 18


def dot_sheet(
    canvas: Tensor,
    grid: PixelGrid,
    meant: NDArray[np.float64],
    found: NDArray[np.float64],
    seen: NDArray[np.float64],
    matrix: NDArray[np.float64],
) -> Tensor:
    """The picture, sRGB [3, h, w] in [0, 1].

    canvas [3, rows, columns]: the rectified photograph on `grid`; meant [n, 2]: all dots; found,
    seen [k, 2]: those that were found, where meant and where seen; matrix: the fit between the two.
    """
    rows = round(_COLUMNS * grid.rows / grid.columns)
    pixels = (255 * canvas.clamp(0, 1)).round().to(torch.uint8).permute(1, 2, 0).numpy()
    picture = np.asarray(cv2.resize(pixels, (_COLUMNS, rows), interpolation=cv2.INTER_AREA), np.uint8).copy()
    view = PixelGrid(grid.size, rows, _COLUMNS)

    def at(places: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(view.to_pixels(torch.from_numpy(places)).numpy(), np.float64)

    left = seen - apply(matrix, found)
    for start, end, rest in zip(at(found), at(seen), at(seen + _LARGER * left), strict=True):
        _circle(picture, end, _SEEN)
        _line(picture, start, end, _MEANT, 1)
        _line(picture, end, rest, _SEEN, 2)
    missing = (np.linalg.norm(meant[:, None] - found[None], axis=-1) > 1e-9).all(1)
    for place, lost in zip(at(meant), missing, strict=True):
        for color, width in (((255, 255, 255), 4), (_MISSING if lost else _MEANT, 2)):
            for offset in ((8, 0), (0, 8)):
                _stripe(picture, place - offset, place + offset, color, width)
        if lost:
            _circle(picture, place, _MISSING)
    sheet = Sheet(_COLUMNS + 2 * _MARGIN, rows + _HEAD + _FOOT, CREAM)
    sheet.paste(picture, (_MARGIN, _HEAD))
    text = f"Circles: the dots. Crosses: where they were meant to be. Red lines: what remains, {_LARGER} times as long."
    sheet.text((_MARGIN, rows + _HEAD + 18), text, 20, INK)
    return sheet.tensor()


def _fine(place: NDArray[np.float64]) -> tuple[int, int]:
    """A place in sixteenths of a pixel, as OpenCV draws with shift=4."""
    return round(16 * float(place[0])), round(16 * float(place[1]))


def _circle(picture: NDArray[np.uint8], place: NDArray[np.float64], color: tuple[int, ...]) -> None:
    for around, width in (((255, 255, 255), 4), (color, 2)):
        cv2.circle(picture, _fine(place), 16 * _RADIUS, around, width, cv2.LINE_AA, shift=4)


def _line(
    picture: NDArray[np.uint8],
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    color: tuple[int, ...],
    width: int,
) -> None:
    _stripe(picture, start, end, (255, 255, 255), width + 2)
    _stripe(picture, start, end, color, width)


def _stripe(
    picture: NDArray[np.uint8],
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    color: tuple[int, ...],
    width: int,
) -> None:
    cv2.line(picture, _fine(start), _fine(end), color, width, cv2.LINE_AA, shift=4)
