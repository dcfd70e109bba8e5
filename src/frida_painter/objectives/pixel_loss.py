"""Replication objective: same pixels as the picture; and sharpening of photographs before planning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from torch import Tensor
from torch.nn.functional import mse_loss

from frida_painter import images
from frida_painter.frames import PixelGrid

if TYPE_CHECKING:
    from frida_painter.frames import Rows


@dataclass(frozen=True)
class Replication:
    """Mean squared difference to `target` [3, H, W]: l_print of the paper (Eq. "l2").

    matters [H, W]: weight of each pixel, mean 1; None if uniform
    """

    target: Tensor
    matters: Tensor | None = None

    @classmethod
    def of(cls, image: Tensor, grid: PixelGrid, importance: Tensor | None = None) -> Self:
        """Returns the objective for a picture [3, h, w], fitted to the grid.

        importance [h, w]: importance of each place of the picture
        """
        matters = None if importance is None else spread(importance, grid.rows, grid.columns)
        return cls(images.fit(image, grid.rows, grid.columns), matters)

    def __call__(self, picture: Tensor) -> Tensor:
        """Returns the distance of a picture [3, H, W] to the target."""
        target = self.target.to(picture)
        if self.matters is None:
            return mse_loss(picture, target)
        root = self.matters.to(picture).sqrt()
        return mse_loss(root * picture, root * target)

    def of_variance(self, variance: Tensor) -> Tensor:
        """Returns the mean increase by pixel variance [H, W]: E[(C - T)^2] = (M - T)^2 + Var C."""
        return variance.mean() if self.matters is None else (self.matters.to(variance) * variance).mean()

    def on_rows(self, rows: Rows) -> Self:
        """Returns the objective for pictures with these rows only."""
        return type(self)(rows.of(self.target), None if self.matters is None else rows.of(self.matters))


def spread(importance: Tensor, rows: int, columns: int) -> Tensor:
    """Returns importance [h, w] fitted to `rows` x `columns`, mean 1."""
    most = importance.amax()
    fitted = images.fit((importance / most)[None], rows, columns)[0] * most
    return fitted / fitted.mean()


def rise(importance: Tensor, times: float) -> Tensor:
    """Returns by how much places [h, w] matter more than the least: 0 for the least, 1 from `times` the least on."""
    return ((importance / importance.amin() - 1) / (times - 1)).clamp(0, 1)


# Sharpening of photographs before planning
#
# Painting softens a picture: marks have soft edges and land beside their intended place, and the planner averages
# colours if it is uncertain. So photographs are sharpened first, as printers do.

_SPREAD = 0.0037
"""Standard deviation in metres on the canvas of the blur in unsharp masking."""


def fit_and_sharpen(picture: Tensor, sharpness: float, grid: PixelGrid) -> Tensor:
    """Returns a picture [3, h, w], fitted to the grid [3, H, W] and sharpened for planning.

    sharpness: increase of each pixel's difference from its surroundings
    """
    return with_contrast(images.fit(picture, grid.rows, grid.columns), _SPREAD / grid.pitch[1], sharpness)


def with_contrast(picture: Tensor, spread: float, amount: float) -> Tensor:
    """Sharpens a picture [3, H, W] in [0, 1] by unsharp masking.

    spread: standard deviation of the blur in pixels
    amount: increase of each pixel's difference from the blurred picture
    """
    return (picture + amount * (picture - images.gaussian_blur(picture, spread))).clamp(0, 1)
