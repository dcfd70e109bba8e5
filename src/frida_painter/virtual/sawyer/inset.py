"""The painting straight on, in a corner of the film of the arm, where the arm hides nothing of it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from frida_painter.frames import CanvasSize

Picture = NDArray[np.uint8]

_LARGEST = 0.30  # of the film's columns
_MARGIN = 0.035
_MOUNT, _EDGE = 250, 190  # grey
_BORDER, _SHADOW = 7, 4  # pixels
_SHADE = 0.88


class Inset:
    """Hangs a canvas of that size into pictures [rows, columns, 3], in their upper right corner."""

    def __init__(self, canvas: CanvasSize, rows: int, columns: int) -> None:
        most = _LARGEST * columns
        scale = most / max(canvas.width, canvas.height)
        self._width, self._height = round(canvas.width * scale), round(canvas.height * scale)
        margin = round(_MARGIN * columns) + _BORDER
        self._left, self._top = columns - margin - self._width, margin

    def hang(self, canvas: Picture, pixels: Picture) -> None:
        """Puts the canvas [n, n, 3], its first row at the lower edge, into the picture."""
        picture = cv2.resize(canvas[::-1], (self._width, self._height), interpolation=cv2.INTER_AREA)
        shadow = self._around(pixels, _BORDER + 1, _SHADOW)
        shadow[:] = (shadow * _SHADE).astype(np.uint8)
        self._around(pixels, _BORDER + 1)[:] = _EDGE
        self._around(pixels, _BORDER)[:] = _MOUNT
        self._around(pixels, 0)[:] = picture

    def _around(self, pixels: Picture, border: int, shift: int = 0) -> Picture:
        """The part of the picture that the canvas fills with a border of so many pixels, shifted down and right."""
        top, left = self._top - border + shift, self._left - border + shift
        return pixels[top : top + self._height + 2 * border, left : left + self._width + 2 * border]
