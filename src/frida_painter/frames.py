"""Frames of reference and the maps between them: canvas, pixels, and the frame of a stroke.

Canvas: metres, origin at the bottom-left corner, x right, y up. Pixels: row down, column right. The centre of
pixel (row, column) lies at (row, column), so a picture of n rows spans -0.5 to n - 0.5. Only this module and
strokes/place_kernels.py flip y.
"""

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CalibrationError
from frida_painter.system.devices import compiles_for

# Distortion of a camera's lens

_STRONGEST = 1.0
_ROUNDS = 60
_EXACT = 1e-3


@dataclass(frozen=True)
class Lens:
    """Radial and tangential distortion in OpenCV's model (D. Brown, "Close-range camera calibration", 1971).

    focal: focal length in pixels, along columns and along rows
    middle: principal point in the photograph, (column, row)
    coefficients: k1, k2, p1, p2, k3, each from -1 to 1

    Raises CalibrationError if a number is not finite or out of range.
    """

    focal: tuple[float, float]
    middle: tuple[float, float]
    coefficients: tuple[float, float, float, float, float]

    def __post_init__(self) -> None:
        numbers = np.array([*self.focal, *self.middle, *self.coefficients])
        sane = np.isfinite(numbers).all() and min(self.focal) > 0
        if not (sane and np.abs(self.coefficients).max() <= _STRONGEST):
            raise CalibrationError(
                f"A lens of focal length {self.focal} px and distortion {self.coefficients} cannot be true; "
                "repeat the canvas calibration."
            )

    def undistort(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns undistorted positions of distorted `pixels` [n, 2], (column, row).

        NaN if the lens shows nothing at that position.
        """
        # With a strong lens cv2.undistortPoints stops up to 0.006 px short, without a sign of it.
        straight = np.array(pixels, np.float64)
        with np.errstate(all="ignore"):
            for _ in range(_ROUNDS):
                straight += pixels - self.distort(straight)
            unseen = ~(np.abs(self.distort(straight) - pixels).max(-1) < _EXACT)
        straight[unseen] = np.nan
        return straight

    def distort(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns distorted positions [n, 2] of undistorted `pixels` [n, 2]."""
        x, y = ((pixels - self.middle) / self.focal).T
        k1, k2, p1, p2, k3 = self.coefficients
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        bent_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        bent_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.stack((bent_x, bent_y), -1) * self.focal + self.middle


@dataclass(frozen=True)
class PixelGrid:
    """Picture of `rows` x `columns` pixels that shows exactly the whole canvas."""

    size: CanvasSize
    rows: int
    columns: int

    @classmethod
    def of_height(cls, size: CanvasSize, rows: int) -> Self:
        """Returns the grid with `rows` rows and nearly square pixels."""
        return cls(size, rows, max(1, round(rows * size.width / size.height)))

    @property
    def pitch(self) -> tuple[float, float]:
        """Distance between pixel centres in metres: (across, down)."""
        return self.size.width / self.columns, self.size.height / self.rows

    def to_pixels(self, position: Tensor) -> Tensor:
        """Converts canvas metres [..., 2] (x, y) to pixels [..., 2] (column, row)."""
        across, down = self.pitch
        column = position[..., 0] / across - 0.5
        row = (self.size.height - position[..., 1]) / down - 0.5
        return torch.stack((column, row), -1)

    def to_canvas(self, pixel: Tensor) -> Tensor:
        """Converts pixels [..., 2] (column, row) to canvas metres [..., 2] (x, y)."""
        across, down = self.pitch
        x = (pixel[..., 0] + 0.5) * across
        y = self.size.height - (pixel[..., 1] + 0.5) * down
        return torch.stack((x, y), -1)


@dataclass(frozen=True)
class Rows:
    """Rows `first`, `first + every`, `first + 2 every`, ... of a picture; by default all rows."""

    every: int = 1
    first: int = 0

    def of(self, picture: Tensor) -> Tensor:
        """Returns these rows of a picture [..., H, W]."""
        return picture[..., self.first :: self.every, :]


ALL_ROWS = Rows()


@dataclass(frozen=True)
class MapFrame:
    """Rectangle of a magnitude map in the frame of its stroke.

    The stroke starts at (0, 0) and heads along +x, in metres. The map covers [left, right] x [bottom, top] with
    `rows` x `columns` cells. Row 0 is at the top.
    """

    left: float
    right: float
    bottom: float
    top: float
    rows: int
    columns: int

    @property
    def pitch(self) -> tuple[float, float]:
        """Distance between cell centres in metres: (along x, along y)."""
        return (self.right - self.left) / self.columns, (self.top - self.bottom) / self.rows

    def cell_centers(self, *, dtype: torch.dtype = torch.float32, device: torch.device | str = "cpu") -> Tensor:
        """Returns the centre of each cell in the stroke's frame: [rows, columns, 2] in metres."""
        across, down = self.pitch
        x = self.left + (torch.arange(self.columns, dtype=dtype, device=device) + 0.5) * across
        y = self.top - (torch.arange(self.rows, dtype=dtype, device=device) + 0.5) * down
        return torch.stack(torch.meshgrid(x, y, indexing="xy"), -1)

    def scale(self, growth: float) -> "MapFrame":
        """Returns the rectangle with all distances from the start of the stroke multiplied by `growth`."""
        left, right, bottom, top = (growth * side for side in (self.left, self.right, self.bottom, self.top))
        return MapFrame(left, right, bottom, top, self.rows, self.columns)

    def resize(self, rows: int, columns: int) -> "MapFrame":
        """Returns the same rectangle with another number of cells."""
        return MapFrame(self.left, self.right, self.bottom, self.top, rows, columns)


def pixel_to_map(position: Tensor, angle: Tensor, grid: PixelGrid, frame: MapFrame, rows: Rows = ALL_ROWS) -> Tensor:
    """Returns the affine maps from picture pixels to cells of each stroke's magnitude map.

    position [n, 2]: metres
    angle [n]: radians
    rows: rows of the grid that the picture has. Row i of the picture is row `first + i every` of the grid.
    Returns A [n, 2, 3] with (map column, map row) = A @ (pixel column, pixel row, 1). Differentiable; on the
    CPU only once.
    """
    if compiles_for(angle):
        affine: Tensor = _PixelToMap.apply(position, angle, grid, frame, rows)  # type: ignore[no-untyped-call]
        return affine
    return pixel_to_map_plainly(position, angle, grid, frame, rows)


def scale_maps(affine: Tensor, frame: MapFrame, growth: Tensor) -> Tensor:
    """Returns the affine maps [n, 2, 3] of `pixel_to_map` for frames scaled by `growth` [n]. Differentiable."""
    across, down = frame.pitch
    origin = affine.new_tensor([0.5 + frame.left / across, 0.5 - frame.top / down])  # minus the cell of the start
    shift = functional.pad(origin[:, None], (2, 0))  # [2, 3]
    return (affine + shift) / growth[:, None, None] - shift


def pixel_to_map_plainly(position: Tensor, angle: Tensor, grid: PixelGrid, frame: MapFrame, rows: Rows) -> Tensor:
    """Computes `pixel_to_map` with PyTorch, on any device."""
    (corner_x, corner_y), (across, down) = _corner(grid, rows)
    cell_x, cell_y = frame.pitch
    cos, sin = torch.cos(angle), torch.sin(angle)
    x, y = corner_x - position[:, 0], corner_y - position[:, 1]
    # Rotates back by the stroke's angle, then converts to cells. The map's rows point down, so y flips once more.
    column = (cos * x + sin * y - frame.left) / cell_x - 0.5
    row = (sin * x - cos * y + frame.top) / cell_y - 0.5
    to_column = torch.stack((cos * (across / cell_x), -sin * (down / cell_x), column), -1)
    to_row = torch.stack((sin * (across / cell_y), cos * (down / cell_y), row), -1)
    return torch.stack((to_column, to_row), 1)


def _corner(grid: PixelGrid, rows: Rows) -> tuple[tuple[float, float], tuple[float, float]]:
    """Returns the canvas position of the centre of pixel (0, 0) of these rows, and the pixel pitch; both in metres."""
    across, pitch = grid.pitch
    return (0.5 * across, grid.size.height - (rows.first + 0.5) * pitch), (across, rows.every * pitch)


class _PixelToMap(torch.autograd.Function):
    """`pixel_to_map` with compiled loops and derivatives in closed form."""

    @staticmethod
    def forward(context: Any, position: Tensor, angle: Tensor, grid: PixelGrid, frame: MapFrame, rows: Rows) -> Tensor:
        from frida_painter.strokes import place_kernels as frame_kernels

        affine = angle.new_empty(len(angle), 2, 3)
        places = tuple(tensor.detach().contiguous().numpy() for tensor in (position, angle))
        corner, pitch = _corner(grid, rows)
        number = places[1].dtype.type
        known = tuple(tuple(map(number, metres)) for metres in (corner, pitch, (frame.left, frame.top), frame.pitch))
        frame_kernels.place(places, known, affine.numpy())
        context.save_for_backward(position, angle)
        context.known = known
        return affine

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(context: Any, *upstream: Tensor) -> tuple[Tensor | None, ...]:
        from frida_painter.strokes import place_kernels as frame_kernels

        places = [tensor.detach().contiguous() for tensor in context.saved_tensors]
        found = [torch.empty_like(tensor) for tensor in places]
        arrays, to_places = (tuple(tensor.numpy() for tensor in tensors) for tensors in (places, found))
        frame_kernels.pull_back(arrays, context.known, upstream[0].contiguous().numpy(), to_places)
        return *found, None, None, None


def wrap_angles(angle: Tensor) -> Tensor:
    """Returns the same directions in radians in [-pi, pi)."""
    return torch.remainder(angle + math.pi, 2 * math.pi) - math.pi
