"""The simple replication objective: be the same as the picture, pixel by pixel."""

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
    """l_print of the paper (Eq. "l2"): the mean squared difference to `target` [3, H, W].

    matters [H, W]: how much each pixel matters, 1 in the mean; None: all the same.
    """

    target: Tensor
    matters: Tensor | None = None

    @classmethod
    def of(cls, image: Tensor, grid: PixelGrid, importance: Tensor | None = None) -> Self:
        """To `image` [3, h, w] as it fits the grid. importance [h, w]: how much each place of the image matters."""
        matters = None if importance is None else spread(importance, grid.rows, grid.columns)
        return cls(images.fit(image, grid.rows, grid.columns), matters)

    def __call__(self, picture: Tensor) -> Tensor:
        """How far a picture [3, H, W] is from the target."""
        target = self.target.to(picture)
        if self.matters is None:
            return mse_loss(picture, target)
        root = self.matters.to(picture).sqrt()
        return mse_loss(root * picture, root * target)

    def of_variance(self, variance: Tensor) -> Tensor:
        """What pixels that vary by so much [H, W] add on average: E[(C - T)^2] = (M - T)^2 + Var C."""
        return variance.mean() if self.matters is None else (self.matters.to(variance) * variance).mean()

    def on_rows(self, rows: Rows) -> Self:
        """The same for pictures that have these rows only."""
        return type(self)(rows.of(self.target), None if self.matters is None else rows.of(self.matters))


def spread(importance: Tensor, rows: int, columns: int) -> Tensor:
    """Importance [h, w] for a picture that is fitted to so many rows and columns: [rows, columns], 1 in the mean."""
    most = importance.amax()
    fitted = images.fit((importance / most)[None], rows, columns)[0] * most
    return fitted / fitted.mean()


# What a painting of a photograph is planned towards: the photograph, sharpened by as much as painting softens it.
#
# Marks have soft edges and land beside where they are meant, and where the planner is not sure of them it evens
# colours
# out. So a painting has less contrast than its photograph, from one mark to the next. Printers sharpen pictures for
# the
# same reason.

_SPREAD = 0.0037
"""Standard deviation, metres on the canvas, over which a place is compared with what is around it."""


def sharpened(picture: Tensor, sharpness: float, grid: PixelGrid) -> Tensor:
    """A picture [3, h, w] as it fills the grid [3, H, W], and as sharp as it is to be planned for that canvas.

    sharpness: by how much of its difference from its surroundings each place differs more.
    """
    return with_contrast(images.fit(picture, grid.rows, grid.columns), _SPREAD / grid.pitch[1], sharpness)


def with_contrast(picture: Tensor, spread: float, amount: float) -> Tensor:
    """A picture [3, H, W] in [0, 1] with `amount` more of each pixel's difference from those within `spread` pixels.

    That is unsharp masking.
    """
    return (picture + amount * (picture - images.blurred(picture, spread))).clamp(0, 1)
