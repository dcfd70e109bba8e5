"""Short strokes at given heights, each on a free place of the paper, and how wide a mark they leave."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.calibration import Calibration
from frida_painter.frames import PixelGrid
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Waypoints
from frida_painter.palette import Palette
from frida_painter.perception.color import true_color
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.rectify import rectify
from frida_painter.session.procedures.at_the_easel import EaselAccess

LENGTH = 0.012
"""Of a trial stroke, metres."""
_BLACK = 0.04
_PITCH = 0.0005
_STEP = 0.001
_EDGE = 0.004
# A pixel belongs to a mark where it is darkened by this share, and a mark is at least so large, m2.
_DARKENED, _SMALLEST = 0.25, 2e-6


@dataclass(frozen=True)
class Trial:
    """A stroke at `height` (robot z): the width of its mark, 0 where it left none, and its look [3, h, w].

    Metres; pitch: of one pixel of the look.
    """

    height: float
    width: float
    look: Tensor
    pitch: float

    @property
    def marked(self) -> bool:
        """Whether there is a mark."""
        return self.width > 0


class TrialPaper:
    """A bare paper with room for trial strokes, one to a cell of `cell` (width, height) metres.

    The well is filled with black first. Raises FrameRejected where the paper is not bare.
    """

    def __init__(self, access: EaselAccess, cell: tuple[float, float], ground: tuple[float, float, float]) -> None:
        easel = access.easel
        easel.operator.fill_wells(Palette(torch.full((1, 3), _BLACK)))
        self._access, self._easel, self._cell = access, easel, cell
        pitch = max(_PITCH, _metres_per_pixel(easel.calibration, easel.canvas.width))
        self._grid = PixelGrid.of_height(easel.canvas, max(8, round(easel.canvas.height / pitch)))
        bare = rectify(self._access.photograph().image, easel.calibration, self._grid)
        self._light = FlatField.learn(bare, ground)
        self._seen = self._in_true_colors(bare)
        self._places = self._cells()
        self._here: tuple[float, float] | None = next(self._places)

    @property
    def is_full(self) -> bool:
        """Whether no place is free any more."""
        return self._here is None

    @property
    def free_place(self) -> tuple[float, float]:
        """The middle of the next free cell, or of the paper, canvas metres."""
        return self._here or (self._easel.canvas.width / 2, self._easel.canvas.height / 2)

    def stroke(self, height: float) -> Trial:
        """Dips, paints a stroke at that height from left to right, and looks.

        A place without a mark stays free. Raises WorkspaceViolation, RobotError, CameraError.
        """
        assert self._here is not None
        easel, (x, y) = self._easel, self._here
        along = np.arange(-LENGTH / 2, LENGTH / 2 + _STEP / 2, _STEP)
        path = np.c_[x + along, np.full_like(along, y)]
        dip, trial = Motion(easel.workspace, easel.calibration).dip(0), at_height(easel, path, height)
        self._access.perform([dip, trial])
        after = self._in_true_colors(rectify(self._access.photograph().image, easel.calibration, self._grid))
        cell = self._pixels(x, y)
        width = self._width(self._seen[:, *cell], after[:, *cell])
        self._seen = after
        if width > 0:
            self._here = next(self._places, None)
        return Trial(height, width, after[:, *cell], self._grid.pitch[0])

    def _in_true_colors(self, picture: Tensor) -> Tensor:
        return true_color(self._light.correct(picture), self._easel.calibration)

    def _width(self, before: Tensor, after: Tensor) -> float:
        """Width of the mark that came between two looks at a cell, metres; 0 where there is none."""
        one, other = (look.mean(0).numpy() for look in (before, after))  # [h, w]
        # Paper is what is brightest; it tells how the light has changed.
        change = float(np.quantile(one, 0.8)) / max(1e-3, float(np.quantile(other, 0.8)))
        mark = other * change < (1 - _DARKENED) * one
        across, down = self._grid.pitch
        if not mark.sum() * across * down >= _SMALLEST:
            return 0.0
        columns = mark.sum(0)
        return float(np.quantile(columns[columns > 0], 0.75)) * down

    def _cells(self) -> Iterator[tuple[float, float]]:
        """Middles of the cells, row by row from the top left."""
        width, height = (side - 2 * _EDGE for side in (self._easel.canvas.width, self._easel.canvas.height))
        across, down = max(1, int(width / self._cell[0])), max(1, int(height / self._cell[1]))
        for row in range(down):
            for column in range(across):
                yield _EDGE + (column + 0.5) * width / across, _EDGE + height * (1 - (row + 0.5) / down)

    def _pixels(self, x: float, y: float) -> tuple[slice, slice]:
        """Rows and columns of the cell around a place."""
        column, row = self._grid.to_pixels(torch.tensor([x, y])).tolist()
        across, down = self._grid.pitch
        half_down, half_across = self._cell[1] / 2 / down, self._cell[0] / 2 / across
        return (
            slice(max(0, round(row - half_down)), round(row + half_down) + 1),
            slice(max(0, round(column - half_across)), round(column + half_across) + 1),
        )


def at_height(easel: Easel, path: NDArray[np.float64], height: float) -> Waypoints:
    """The tip follows a path on the canvas [k, 2] (metres) at robot z `height`, from above and up again."""
    workspace = easel.workspace
    placed = workspace.to_robot(easel.calibration.place(path), np.full(len(path), height))
    above = placed[[0, -1]].copy()
    above[:, 2] = max(height, ceiling(easel))
    position = np.concatenate([above[:1], placed, above[1:]])
    return Waypoints(f"trial stroke at {1000 * height:.1f} mm", position, workspace.painting_speed)


def ceiling(easel: Easel) -> float:
    """Robot z, metres, at which nothing is touched."""
    workspace = easel.workspace
    return min(workspace.upper[2], workspace.canvas_origin[2] + workspace.hover)


def _metres_per_pixel(record: Calibration, width: float) -> float:
    top_left, top_right = np.array(record.corners[0]), np.array(record.corners[1])
    return width / float(np.linalg.norm(top_right - top_left))
