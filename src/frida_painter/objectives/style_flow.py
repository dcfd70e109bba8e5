"""Marks of a style picture: how wide and how long they are, and which way they go at each place of a painting.

The direction is that of least change, from the structure tensor of the lightness (Bigün and Granlund 1987,
"Optimal orientation detection of linear symmetry"). There is no direction if the lightness changes equally in
all directions.
"""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.frames import PixelGrid
from frida_painter.objectives.image import rise, spread
from frida_painter.objectives.objective import Goal, Term
from frida_painter.strokes.palette import to_lab
from frida_painter.system import images

# Places of several styles in one picture: the darkest style takes the darkest places, each a share by its weight

_PLACE_ROWS = 128  # rows of the small picture that decides the places
_PLACE_AREA = 4.0  # its pixels: standard deviation of the blur, so that places are areas and no specks
_BLEND = 3.0  # L* over which two styles blend


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
    light = images.gaussian_blur(_light(picture)[None], _PLACE_AREA)[0]
    lighter = [torch.ones_like(light)]  # share of this style and of those that are lighter
    for number in range(1, len(weights)):
        limit = light.quantile(sum(weights[:number]) / sum(weights))
        lighter.append(torch.sigmoid((light - limit) / _BLEND))
    lighter.append(torch.zeros_like(light))
    return [here - above for here, above in pairwise(lighter)]


def _light(picture: Tensor) -> Tensor:
    """Returns L* of a picture [3, H, W], small: [h, w]."""
    small = images.fit(picture, _PLACE_ROWS, max(1, round(_PLACE_ROWS * picture.shape[2] / picture.shape[1])))
    return to_lab(small.permute(1, 2, 0))[..., 0]


_ROWS = 160  # rows of the picture in which directions are measured
_MARK = 1.0  # pixels of that picture: smoothing of its grain
_AROUND = 5.0  # pixels of that picture: window of one direction, about a stroke's width
_CLEAR = 0.5  # coherence above which a direction is certain
_EDGE = 2.0  # times the mean slope: above it an edge is clear
FACE = 3.0
"""Importance of a place, relative to the least, from which it is free of a style, as faces are."""


def directions(picture: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Returns the directions in a picture [3, H, W] at up to 160 rows, three maps [h, w].

    First map: twice the angle from the canvas's x axis, counter-clockwise. Doubled, because opposite angles are
    the same direction.
    Second map: coherence in [0, 1], how much more the lightness changes along one axis than along the other.
    Third map: energy, total change of the lightness.
    """
    rows = min(_ROWS, picture.shape[1])
    small = images.fit(picture, rows, max(1, round(rows * picture.shape[2] / picture.shape[1])))
    light = images.gaussian_blur(small.mean(0, keepdim=True), _MARK)[0]
    padded = functional.pad(light[None, None], (1, 1, 1, 1), mode="replicate")[0, 0]
    right = padded[1:-1, 2:] - padded[1:-1, :-2]
    up = padded[:-2, 1:-1] - padded[2:, 1:-1]
    along, across, both = images.gaussian_blur(torch.stack((right.square(), up.square(), right * up)), _AROUND)
    energy = along + across
    difference = along - across
    coherence = torch.sqrt(difference.square() + 4 * both.square()) / energy.clamp(min=1e-8)
    # The gradient points across a mark. The mark's direction is a quarter turn further, half a turn when doubled.
    doubled = torch.atan2(-2 * both, -difference)
    return doubled, coherence.clamp(0, 1), energy


def clear_edges(picture: Tensor, rows: int, columns: int) -> Tensor:
    """Returns how clear the edges at each place of a picture [3, H, W] are, in [0, 1]: [rows, columns]."""
    _, _, energy = directions(picture)
    clear = (energy.sqrt() / (_EDGE * energy.sqrt().mean()).clamp(min=1e-4)).clamp(max=1)
    return images.fit(clear[None], rows, columns)[0]


# Size of marks. Lightness and colours without their coarse part vary as often as marks follow each other: half a
# period is pi times the deviation of the values over that of their slope (Rice 1944, "Mathematical analysis of random
# noise").

_SIDE = 360  # pixels: marks are measured in a picture with a shorter side of this length
_GRAIN, _COARSE = 1.0, 0.05  # pixels of it, and share of its shorter side: blurs between which marks lie
_LARGER, _MAX_LARGER = 1.3, 3.0  # least and greatest magnification of marks on the canvas
_MIN_WIDTH = 0.047  # width of a mark on the canvas, of its shorter side, below which marks are magnified more
_LONGEST = 6.0  # longest mark, in widths
_LOOSE = 0.2, 0.085  # length and width of loose marks, as shares of the shorter side of the canvas


def mark_spacing(style: Tensor) -> float:
    """Returns the distance from one mark to the next in a style [3, H, W], as a share of its shorter side."""
    scale = _SIDE / min(style.shape[1:])
    small = images.fit(style, *(max(3, round(scale * side)) for side in style.shape[1:]))
    lab = to_lab(small.permute(1, 2, 0)).permute(2, 0, 1)
    marks = images.gaussian_blur(lab, _GRAIN) - images.gaussian_blur(lab, _COARSE * _SIDE)
    slope = sum(float(part.square().mean()) for part in (marks.diff(dim=1), marks.diff(dim=2)))
    return max(1.0, 2 * math.pi * math.sqrt(float(marks.square().mean()) / max(slope, 1e-12))) / _SIDE


def magnification(style: Tensor) -> float:
    """Returns how much larger the marks of a style [3, H, W] are on a canvas of its size: brushes paint none finer."""
    return min(_MAX_LARGER, max(_LARGER, _MIN_WIDTH / mark_spacing(style)))


def mark_size(style: Tensor) -> tuple[float, float]:
    """Returns length and width of the marks of a style [3, H, W] on a canvas, as shares of its shorter side.

    A mark of length l and width w has slopes across it on 2 l of its edge, and along it on 2 w.
    """
    _, coherence, energy = directions(style)
    mean = float((coherence * energy).sum() / energy.sum().clamp(min=1e-8))
    width = magnification(style) * mark_spacing(style)
    return width * min(_LONGEST, (1 + mean) / max(1 - mean, 1e-3)), width


def brushwork_of(goal: Goal, grid: PixelGrid, form: float = 0.0) -> Tensor | None:
    """Returns the marks that strokes should make at each place of a goal, [6, H, W]; None if it wants none.

    Cosine and sine of twice the direction, and in [0, 1] how far strokes are held to it; logarithms of length and width
    in metres, and in [0, 1] how far strokes are held to these. Directions are those of the picture that the plan begins
    with, which has the marks of the styles (style_marks.py) beside its own edges; faces in photographs are free. Beside
    a goal that is painted loosely, marks are large, and what matters is free.
    form: how far strokes follow a goal of photographs alone, in [0, 1]. It wants no sizes.
    """
    styles, loose = styles_of(goal), any(term.is_loose for term in goal.terms)
    formed = form > 0 and all(term.is_pixelwise for term in goal.terms)
    if not (styles or loose or formed):
        return None
    begun = next((term for term in goal.initial_terms if term.guide is not None), None)
    picture = begun.guide if begun is not None else styles[0].colors if styles else None
    if picture is None:
        return None
    shape = grid.rows, grid.columns
    doubled, coherence, _ = directions(images.fit(picture, *shape))
    field = torch.stack((doubled.cos(), doubled.sin(), (coherence / _CLEAR).clamp(max=1)))[None]
    cosine, sine, sure = functional.interpolate(field, shape, mode="bilinear", align_corners=False)[0]
    if formed:
        return torch.stack((cosine, sine, form * sure, *torch.zeros(3, *shape).to(sure)))
    held = torch.ones(shape)
    if begun is not None and begun.importance is not None and all(term.words is None for term in goal.terms):
        held = 1 - rise(spread(begun.importance, *shape), FACE)
    shorter = min(grid.size.width, grid.size.height)

    def sizes(sides: tuple[float, float]) -> Tensor:
        return torch.tensor([math.log(shorter * side) for side in sides])[:, None, None].expand(2, *shape)

    size = change_by_place(picture, styles, lambda style: sizes(mark_size(style))) if styles else sizes(_LOOSE)
    return torch.cat((torch.stack((cosine, sine, held * sure)), size, held[None]))
