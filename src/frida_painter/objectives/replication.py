"""The simple replication objective: be the same as the picture, pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from torch import Tensor
from torch.nn.functional import mse_loss

from frida_painter import images

if TYPE_CHECKING:
    from frida_painter.frames import PixelGrid, Rows


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
