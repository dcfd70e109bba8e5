"""Painting a stroke library: the robot paints single strokes, and the camera sees what they look like.

Paper, "Real Data to Simulation": strokes of random thickness, length and bend, black on white
paper, several to a sheet; each one's mark is what changed between two photographs.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.kinds import BrushKind
from frida_painter.brush.library import StrokeLibrary
from frida_painter.errors import ConfigError
from frida_painter.frames import CanvasSize, MapFrame, PixelGrid
from frida_painter.hardware import limits
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.motion import Motion
from frida_painter.palette import Palette
from frida_painter.perception.color import true_color
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.rectify import rectify
from frida_painter.strokes import Strokes

BLACK = 0.04
PAPER = 1.0
MOST_STROKES = 10_000
_FINER = 3
_NOISE_FLOOR = 0.04


@dataclass(frozen=True)
class LibraryProgress:
    """Stroke `done` of `of` was painted and photographed, on sheet number `sheet` (from 1)."""

    done: int
    of: int
    sheet: int


def paint_library(
    next_sheet: Callable[[int], Easel],
    kind: BrushKind,
    *,
    count: int = 200,
    seed: int = 0,
    notify: Callable[[LibraryProgress], None] | None = None,
) -> StrokeLibrary:
    """Paints `count` strokes drawn uniformly from the brush's limits, and cuts out their marks.

    next_sheet: gives the connected easel with a fresh white paper on it, called with 0, 1, 2, ...
    whenever one is full; the easel's placement must be calibrated, or its error is learned with the
    brush. The brush is refilled before every stroke. Raises ConfigError where the paper is too
    small for one stroke, RobotError, CameraError and their kinds.
    """
    if not 1 <= count <= MOST_STROKES:
        raise ConfigError(
            f"{count} strokes were asked for the library; it takes 1 to {MOST_STROKES}, and about 200 are enough."
        )
    shapes = _sample_shapes(kind, count, seed)
    crops: list[NDArray[np.uint8]] = []
    sheet = _Sheet(next_sheet(0), kind)
    sheets = 1
    while len(crops) < count:
        if sheet.is_full:
            sheet = _Sheet(next_sheet(sheets), kind)
            sheets += 1
        crops.append(sheet.paint(shapes[len(crops)]))
        if notify is not None:
            notify(LibraryProgress(len(crops), count, sheets))
    return StrokeLibrary(
        magnitude=np.stack(crops),
        length_m=shapes.length.numpy(),
        bend_m=shapes.bend.numpy(),
        thickness=shapes.thickness.numpy(),
        metres_per_pixel=sheet.pitch,
        origin_px=sheet.origin,
        recorded_index=np.arange(count, dtype=np.int32),
    )


@dataclass(frozen=True)
class _Shapes:
    """What varies from stroke to stroke of a library, each [n]."""

    thickness: Tensor
    length: Tensor
    bend: Tensor

    def __getitem__(self, index: int) -> "_Shapes":
        chosen = slice(index, index + 1)
        return _Shapes(self.thickness[chosen], self.length[chosen], self.bend[chosen])


def _sample_shapes(kind: BrushKind, count: int, seed: int) -> _Shapes:
    chance = torch.Generator().manual_seed(seed)
    thickness, along, aside = torch.rand(3, count, generator=chance)
    (shortest, longest), (least, most) = kind.limits.length, kind.limits.bend
    return _Shapes(thickness, shortest + along * (longest - shortest), least + aside * (most - least))


class _Sheet:
    """One sheet of paper on the easel: free places for strokes, and what it looks like now."""

    def __init__(self, easel: Easel, kind: BrushKind) -> None:
        self._easel = easel
        self._motion = Motion(easel.workspace, easel.calibration)
        self._crop = _pixels(kind.frame)
        self.pitch = kind.frame.pitch[0] / _FINER
        self._grid = _grid(easel.canvas, self.pitch)
        self._places = _places(self._grid, self._crop)
        first = next(self._places, None)
        if first is None:
            raise ConfigError(
                f"A paper of {easel.canvas} has no room for one stroke of brush {kind.name!r}; "
                f"take one of at least {kind.frame.right - kind.frame.left:.3f} x "
                f"{kind.frame.top - kind.frame.bottom:.3f} m."
            )
        self._next: tuple[int, int] | None = first
        easel.attendant.fill_wells(Palette(torch.full((1, 3), BLACK)))
        bare = self._photograph(easel.robot.home().finished_at)
        self._light = FlatField.learn(bare, (PAPER, PAPER, PAPER))
        self._seen = self._magnitude(bare)

    @property
    def is_full(self) -> bool:
        """Whether another sheet is needed."""
        return self._next is None

    @property
    def origin(self) -> tuple[float, float]:
        """Where in its crop a stroke starts, (row, column)."""
        return float(self._crop.above), float(self._crop.left)

    def paint(self, shape: _Shapes) -> NDArray[np.uint8]:
        """Paints one stroke at the next free place and returns its mark, [rows, columns]."""
        assert self._next is not None
        row, column = self._next
        position = self._grid.to_canvas(torch.tensor([[column, row]], dtype=torch.float64))
        nothing = torch.zeros(1)
        stroke = Strokes(position, nothing, shape.length, shape.bend, shape.thickness, torch.full((1, 3), BLACK))
        motions = (self._motion.dip(0), self._motion.stroke(stroke, 0, "stroke for the library"))
        limits.check(motions, self._easel.workspace)
        for motion in motions:
            self._easel.robot.follow(motion)
        before = self._seen
        self._seen = self._magnitude(self._photograph(self._easel.robot.home().finished_at))
        crop = self._crop.around(row, column)
        # What is covered now, as a share of what was bare before.
        mark = (self._seen[crop] - before[crop]) / (1 - before[crop]).clip(0.2)
        self._next = next(self._places, None)
        return np.rint(255 * np.where(mark < _NOISE_FLOOR, 0, mark).clip(0, 1)).astype(np.uint8)

    def _photograph(self, newer_than: float) -> Tensor:
        frame = self._easel.camera.capture(newer_than)
        return rectify(frame.image, self._easel.calibration, self._grid)

    def _magnitude(self, photograph: Tensor) -> NDArray[np.float32]:
        """How much of the paper is covered at each pixel: 0 paper, 1 black paint."""
        picture = true_color(self._light.correct(photograph), self._easel.calibration)
        return ((PAPER - picture.mean(0)) / (PAPER - BLACK)).numpy()


@dataclass(frozen=True)
class _Crop:
    """How many pixels a crop reaches from the pixel at which its stroke starts."""

    left: int
    right: int
    above: int
    below: int

    def around(self, row: int, column: int) -> tuple[slice, slice]:
        """Rows and columns of the crop of a stroke that starts at that pixel."""
        return slice(row - self.above, row + self.below + 1), slice(column - self.left, column + self.right + 1)


def _pixels(frame: MapFrame) -> _Crop:
    """The crop that covers a stroke model's frame."""
    pitch = frame.pitch[0] / _FINER
    reaches = (-frame.left, frame.right, frame.top, -frame.bottom)
    return _Crop(*(int(np.ceil(reach / pitch)) for reach in reaches))


def _grid(canvas: CanvasSize, pitch: float) -> PixelGrid:
    return PixelGrid(canvas, round(canvas.height / pitch), round(canvas.width / pitch))


def _places(grid: PixelGrid, crop: _Crop) -> Iterator[tuple[int, int]]:
    """Pixels (row, column) at which strokes may start so that their crops do not meet."""
    for row in range(crop.above, grid.rows - crop.below, crop.above + crop.below + 1):
        for column in range(crop.left, grid.columns - crop.right, crop.left + crop.right + 1):
            yield row, column
