"""Calibrations and photographs for tests, drawn without the code that they test."""

import numpy as np
from numpy.typing import NDArray

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize

SIZE = CanvasSize(0.4, 0.3)
ROWS, COLUMNS = 240, 320
# A canvas seen at a slant: top-left, top-right, bottom-right, bottom-left, (column, row).
CORNERS = ((40.0, 30.0), (290.0, 20.0), (300.0, 220.0), (25.0, 205.0))


def calibration(corners=CORNERS, rows: int = ROWS, columns: int = COLUMNS, **rest) -> Calibration:
    return Calibration("test", "small", tuple(corners), (rows, columns), 0.1, 0.09, **rest)


def across_and_down(rows: int = ROWS, columns: int = COLUMNS) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where on the canvas each pixel of the photograph looks, both in [0, 1] from the canvas's top left."""
    target = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
    equations = []
    for (column, row), (across, down) in zip(CORNERS, target, strict=True):
        equations.append([column, row, 1, 0, 0, 0, -across * column, -across * row, across])
        equations.append([0, 0, 0, column, row, 1, -down * column, -down * row, down])
    system = np.array(equations)
    homography = np.append(np.linalg.solve(system[:, :8], system[:, 8]), 1).reshape(3, 3)
    column, row = np.meshgrid(np.arange(columns), np.arange(rows))
    seen = np.stack((column, row, np.ones_like(row)), -1) @ homography.T
    return seen[..., 0] / seen[..., 2], seen[..., 1] / seen[..., 2]
