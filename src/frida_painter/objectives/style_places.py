"""Places of several styles in one picture: the darkest style takes the darkest places, each a share by its weight."""

from collections.abc import Callable, Sequence
from itertools import pairwise

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.objectives.objective import Goal, Term
from frida_painter.palette import to_lab

_ROWS = 128  # rows of the small picture that decides the places
_AREA = 4.0  # its pixels: standard deviation of the blur, so that places are areas and no specks
_SOFT = 3.0  # L* over which two styles blend


def styles_of(goal: Goal) -> list[Term]:
    """Returns the terms of a goal that set a style, from the darkest style picture to the lightest."""
    styles = [term for term in goal.terms if term.colors is not None]
    return sorted(styles, key=lambda term: 0.0 if term.colors is None else float(_light(term.colors).mean()))


def change_by_place(picture: Tensor, styles: Sequence[Term], change: Callable[[Tensor], Tensor]) -> Tensor:
    """Returns a picture [3, H, W] changed towards each style at the places of that style.

    styles: from `styles_of`
    change: from a style picture to the result for the whole picture, [c, h, w]
    """
    changed = [change(style.colors) for style in styles if style.colors is not None]
    shares = _share_places(picture, [style.weight for style in styles])
    return sum(
        (images.fit(share[None], *one.shape[1:]) * one for share, one in zip(shares, changed, strict=True)),
        torch.zeros_like(changed[0]),
    )


def _share_places(picture: Tensor, weights: Sequence[float]) -> list[Tensor]:
    """Returns the share of each style at each place of a picture [3, H, W], from dark to light: [h, w] each."""
    light = images.gaussian_blur(_light(picture)[None], _AREA)[0]
    lighter = [torch.ones_like(light)]  # share of this style and of those that are lighter
    for number in range(1, len(weights)):
        limit = light.quantile(sum(weights[:number]) / sum(weights))
        lighter.append(torch.sigmoid((light - limit) / _SOFT))
    lighter.append(torch.zeros_like(light))
    return [here - above for here, above in pairwise(lighter)]


def _light(picture: Tensor) -> Tensor:
    """Returns L* of a picture [3, H, W], small: [h, w]."""
    small = images.fit(picture, _ROWS, max(1, round(_ROWS * picture.shape[2] / picture.shape[1])))
    return to_lab(small.permute(1, 2, 0))[..., 0]
