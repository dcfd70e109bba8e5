"""The simple replication objective: be the same as the picture, pixel by pixel."""

from collections.abc import Callable

from torch import Tensor

from frida_painter import images
from frida_painter.frames import PixelGrid


def replication(image: Tensor, grid: PixelGrid, importance: Tensor | None = None) -> Callable[[Tensor], Tensor]:
    """l_print of the paper (Eq. "l2"): the mean squared difference to `image` [3, H, W], fitted to the grid.

    importance [h, w]: how much each place of the image matters, where some matter more than others.
    """
    target = images.fit(image, grid.rows, grid.columns)
    matters = None if importance is None else spread(importance, grid.rows, grid.columns)

    def judge(picture: Tensor) -> Tensor:
        apart = (picture - target.to(picture)).square()
        return apart.mean() if matters is None else (matters.to(picture) * apart).mean()

    return judge


def replication_of_variance(grid: PixelGrid, importance: Tensor | None = None) -> Callable[[Tensor], Tensor]:
    """What pixels that vary by so much [3, H, W] add to `replication` on average: E[(C - T)^2] = (M - T)^2 + Var C."""
    matters = None if importance is None else spread(importance, grid.rows, grid.columns)
    return lambda variance: variance.mean() if matters is None else (matters.to(variance) * variance).mean()


def spread(importance: Tensor, rows: int, columns: int) -> Tensor:
    """Importance [h, w] for a picture that is fitted to so many rows and columns: [rows, columns], 1 in the mean."""
    most = importance.amax()
    fitted = images.fit((importance / most)[None], rows, columns)[0] * most
    return fitted / fitted.mean()
