"""From a photograph of the easel to a picture of the canvas alone, seen straight on."""

import math

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.calibration import Calibration
from frida_painter.errors import FrameRejected
from frida_painter.frames import PixelGrid
from frida_painter.perception.light import to_linear, to_srgb

_DARKEST = 0.01
_MOST_OVERLAP = 2.0
_FINEST = 8


def rectify(photograph: NDArray[np.uint8], calibration: Calibration, grid: PixelGrid) -> Tensor:
    """The canvas [3, rows, columns], sRGB in [0, 1], float32, whose top-left corner is at row 0, column 0.

    photograph [rows, columns, 3] uint8 sRGB. Where the photograph is finer than the grid, each
    pixel of the grid is the mean over its area, in linear light, so that nothing aliases. Raises
    FrameRejected where the photograph is not one of the calibrated camera, or is dark.
    """
    _check(photograph, calibration)
    fineness = _fineness(calibration, grid)
    rows, columns = grid.rows * fineness, grid.columns * fineness
    corners = np.array(
        [(-0.5, -0.5), (columns - 0.5, -0.5), (columns - 0.5, rows - 0.5), (-0.5, rows - 0.5)], np.float32
    )
    to_photograph = cv2.getPerspectiveTransform(corners, np.array(calibration.corners, np.float32))
    tones = to_linear(torch.linspace(0, 1, 256)).numpy()
    light = cv2.warpPerspective(
        tones[photograph],
        to_photograph,
        (columns, rows),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    if fineness > 1:
        light = cv2.resize(light, (grid.columns, grid.rows), interpolation=cv2.INTER_AREA)
    picture = torch.from_numpy(np.ascontiguousarray(light.transpose(2, 0, 1)))
    if not float(picture.mean()) >= _DARKEST:
        raise FrameRejected("The photograph of the canvas is dark; switch the light on and take the camera's cap off.")
    return to_srgb(picture)


def _check(photograph: NDArray[np.uint8], calibration: Calibration) -> None:
    """Raises FrameRejected where the photograph cannot be one of the calibrated camera."""
    wanted = (*calibration.photograph, 3)
    if photograph.shape != wanted or photograph.dtype != np.uint8:
        raise FrameRejected(
            f"A photograph of shape {photograph.shape} and kind {photograph.dtype} was taken; the calibration is for "
            f"{wanted} and uint8; set the camera as it was, or repeat the canvas calibration."
        )
    column, row = np.array(calibration.corners).T
    rows, columns = calibration.photograph
    overlap = max(-column.min(), -row.min(), column.max() - (columns - 1), row.max() - (rows - 1))
    if not overlap <= _MOST_OVERLAP:
        raise FrameRejected(
            f"The canvas reaches {overlap:.0f} pixels beyond the photograph; move the camera until it sees all four "
            "corners, and repeat the canvas calibration."
        )


def _fineness(calibration: Calibration, grid: PixelGrid) -> int:
    """How many samples along each side of a grid's pixel it takes to look at every pixel of the photograph."""
    corners = np.array(calibration.corners)
    top, right, bottom, left = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    denser = max(top / grid.columns, bottom / grid.columns, left / grid.rows, right / grid.rows)
    return min(_FINEST, max(1, math.ceil(denser)))
