"""The simple replication objective: be the same as the picture, pixel by pixel."""

from collections.abc import Callable

from torch import Tensor

from frida_painter import images
from frida_painter.frames import PixelGrid

_PAPER = 0.04  # of sRGB, up to which a pale colour is as good as white paper


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


def bareness(image: Tensor, grid: PixelGrid) -> Callable[[Tensor], Tensor]:
    """How much of a picture is left bare where `image` [3, H, W] is no paper, in [0, 1] (the original's fill_weight).

    A pixel counts by how far it has stayed nearer to white paper than it is to be, whatever the colour: a pale sky that
    was not painted counts as much as a dark wood, though its squared difference is small.
    """
    wanted = _from_paper(images.fit(image, grid.rows, grid.columns))
    painted = wanted > _PAPER

    def judge(picture: Tensor) -> Tensor:
        left = 1 - _from_paper(picture) / wanted.to(picture).clamp(min=_PAPER)
        return (left.clamp(min=0) * painted.to(picture)).mean()

    return judge


def _from_paper(picture: Tensor) -> Tensor:
    """How far colours [3, H, W] are from white, [H, W] in [0, 1]."""
    return ((1 - picture).square().mean(0) + 1e-6).sqrt()


def spread(importance: Tensor, rows: int, columns: int) -> Tensor:
    """Importance [h, w] for a picture that is fitted to so many rows and columns: [rows, columns], 1 in the mean."""
    most = importance.amax()
    fitted = images.fit((importance / most)[None], rows, columns)[0] * most
    return fitted / fitted.mean()
