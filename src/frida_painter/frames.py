"""Frames of reference: canvas metres, picture pixels, the stroke's own frame, and the maps between them.

Canvas: metres, origin at the bottom-left corner, x right, y up. Pixels: row down, column right;
the centre of pixel (row, column) lies at (row, column), so a picture of n rows reaches from -0.5
to n - 0.5. This is the only module in which y flips.
"""

import math
from dataclasses import dataclass
from typing import Any, Self

import torch
from torch import Tensor

from frida_painter.canvas_size import LARGEST_CANVAS as LARGEST_CANVAS
from frida_painter.canvas_size import SMALLEST_CANVAS as SMALLEST_CANVAS
from frida_painter.canvas_size import CanvasSize as CanvasSize


@dataclass(frozen=True)
class PixelGrid:
    """A picture of `rows` x `columns` pixels that shows exactly the whole canvas."""

    size: CanvasSize
    rows: int
    columns: int

    @classmethod
    def of_height(cls, size: CanvasSize, rows: int) -> Self:
        """The grid of `rows` rows whose pixels are as square as whole numbers allow."""
        return cls(size, rows, max(1, round(rows * size.width / size.height)))

    @property
    def pitch(self) -> tuple[float, float]:
        """Metres from one pixel centre to the next: (across, down)."""
        return self.size.width / self.columns, self.size.height / self.rows

    def to_pixels(self, position: Tensor) -> Tensor:
        """Canvas metres [..., 2] (x, y) to pixels [..., 2] (column, row)."""
        across, down = self.pitch
        column = position[..., 0] / across - 0.5
        row = (self.size.height - position[..., 1]) / down - 0.5
        return torch.stack((column, row), -1)

    def to_canvas(self, pixel: Tensor) -> Tensor:
        """Pixels [..., 2] (column, row) to canvas metres [..., 2] (x, y)."""
        across, down = self.pitch
        x = (pixel[..., 0] + 0.5) * across
        y = self.size.height - (pixel[..., 1] + 0.5) * down
        return torch.stack((x, y), -1)


@dataclass(frozen=True)
class Rows:
    """Rows first, first + every, first + 2 every, ... of a picture; by default all of them."""

    every: int = 1
    first: int = 0

    def of(self, picture: Tensor) -> Tensor:
        """Those rows of a picture [..., H, W]."""
        return picture[..., self.first :: self.every, :]


ALL_ROWS = Rows()


@dataclass(frozen=True)
class MapFrame:
    """Where a magnitude map lies in the stroke's own frame.

    The stroke starts at (0, 0) and heads along +x, in metres; the map covers [left, right] x
    [bottom, top] with `rows` x `columns` cells, row 0 at the top.
    """

    left: float
    right: float
    bottom: float
    top: float
    rows: int
    columns: int

    @property
    def pitch(self) -> tuple[float, float]:
        """Metres from one cell centre to the next: (along x, along y)."""
        return (self.right - self.left) / self.columns, (self.top - self.bottom) / self.rows

    def cell_centers(self, *, dtype: torch.dtype = torch.float32, device: torch.device | str = "cpu") -> Tensor:
        """Position of every cell centre in the stroke's frame, metres, [rows, columns, 2]."""
        across, down = self.pitch
        x = self.left + (torch.arange(self.columns, dtype=dtype, device=device) + 0.5) * across
        y = self.top - (torch.arange(self.rows, dtype=dtype, device=device) + 0.5) * down
        return torch.stack(torch.meshgrid(x, y, indexing="xy"), -1)

    def resized(self, rows: int, columns: int) -> "MapFrame":
        """The same rectangle with other cells."""
        return MapFrame(self.left, self.right, self.bottom, self.top, rows, columns)


def pixel_to_map(position: Tensor, angle: Tensor, grid: PixelGrid, frame: MapFrame, rows: Rows = ALL_ROWS) -> Tensor:
    """The affine maps from picture pixels to cells of each stroke's magnitude map.

    position [n, 2] metres, angle [n] radians -> [n, 2, 3], such that
    (map column, map row) = A @ (pixel column, pixel row, 1). Differentiable (once).
    rows: which of the grid's rows the picture has; pixel row i is row first + i every of the grid.
    """
    affine: Tensor = _PixelToMap.apply(position, angle, grid, frame, rows)  # type: ignore[no-untyped-call]
    return affine


class _PixelToMap(torch.autograd.Function):
    """`pixel_to_map`, with its derivatives in closed form: it is asked for in every iteration of a plan."""

    @staticmethod
    def forward(context: Any, position: Tensor, angle: Tensor, grid: PixelGrid, frame: MapFrame, rows: Rows) -> Tensor:
        across, pitch = grid.pitch
        down = rows.every * pitch
        cell_x, cell_y = frame.pitch
        cos, sin = torch.cos(angle), torch.sin(angle)
        # Metres from the stroke's start to the centre of pixel (0, 0).
        x = 0.5 * across - position[:, 0]
        y = grid.size.height - (rows.first + 0.5) * pitch - position[:, 1]
        along, aside = cos * x + sin * y, sin * x - cos * y
        # Turned back by the stroke's angle, then counted in cells; y flips once more inside the map.
        affine = torch.empty(len(angle), 2, 3, dtype=angle.dtype, device=angle.device)
        affine[:, 0, 0] = cos * (across / cell_x)
        affine[:, 0, 1] = sin * (-down / cell_x)
        affine[:, 0, 2] = (along - frame.left) / cell_x - 0.5
        affine[:, 1, 0] = sin * (across / cell_y)
        affine[:, 1, 1] = cos * (down / cell_y)
        affine[:, 1, 2] = (aside + frame.top) / cell_y - 0.5
        context.save_for_backward(cos, sin, along, aside)
        context.pitches = across, down, cell_x, cell_y
        return affine

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(context: Any, *upstream: Tensor) -> tuple[Tensor | None, ...]:
        cos, sin, along, aside = context.saved_tensors
        across, down, cell_x, cell_y = context.pitches
        column, row = upstream[0][:, 0] / cell_x, upstream[0][:, 1] / cell_y
        (a, b, c), (d, e, f) = column.unbind(1), row.unbind(1)
        to_position = torch.stack((-(cos * c + sin * f), cos * f - sin * c), -1)
        to_angle = cos * (across * d - down * b) - sin * (across * a + down * e) - aside * c + along * f
        return to_position, to_angle, None, None, None


def whole_turns_removed(angle: Tensor) -> Tensor:
    """The same directions, radians in [-pi, pi)."""
    return torch.remainder(angle + math.pi, 2 * math.pi) - math.pi
