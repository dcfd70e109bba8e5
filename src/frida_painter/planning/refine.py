"""Between rounds of gradient descent: strokes that hardly matter move, and colours become paints."""

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from frida_painter.palette import Palette, ciede2000, to_lab
from frida_painter.planning.initialize import best_proposals, insert
from frida_painter.planning.optimize import Step, optimize
from frida_painter.planning.problem import Scene
from frida_painter.planning.variables import Paints
from frida_painter.render import composite
from frida_painter.strokes import Strokes

# Wells that differ: paints that are hardly told apart become one, and the well that is free gets an accent.

HARDLY_APART = 2.5
"""CIEDE2000 below which two paints are hardly told apart, and become one. By 5, photographs lost 0.1 to 0.2 dB, and
things that words name got colours that they do not have, as a dolphin green and purple."""
_GROWN = 0.8  # of that, below which paints that grew alike while they were optimised are one in the end


def distinct(palette: Palette, color: Tensor, weight: Tensor, apart: float) -> Palette:
    """The palette, lightest first, with no two paints nearer than `apart`; a well that is free gets an accent.

    color [n, 3], weight [n]: the colours for which the palette was chosen, and how much each matters. An accent is the
    one that matters most for how far it is from all paints. There are fewer paints where none is far from them.
    """
    paint = palette.nearest(color)
    mass = weight.new_zeros(len(palette)).index_add(0, paint.to(weight.device), weight)
    paints, _ = _merged(palette.color, mass, apart)
    lab = to_lab(color)
    for _ in range(len(palette) - len(paints)):
        gap = ciede2000(lab[:, None], to_lab(paints)[None]).amin(1)
        worth = torch.where(gap >= apart, weight * gap.square(), 0)
        if not float(worth.max()) > 0:
            break
        paints = torch.cat((paints, color[worth.argmax()][None]))
    return Palette.ordered(paints)


def without_twins(paints: Paints, apart: float) -> Paints:
    """The paints; those that came clearly nearer to each other than `apart` are one. Strokes keep their order."""
    strokes = torch.bincount(paints.paint, minlength=len(paints.color)).to(paints.color)
    colors, number = _merged(paints.color, strokes, _GROWN * apart)
    return Paints(colors, number[paints.paint], paints.first)


def _merged(color: Tensor, mass: Tensor, apart: float) -> tuple[Tensor, Tensor]:
    """Colours [m, 3], each two of which are `apart` in CIEDE2000 at least, and which of them each of the old is, [k].

    The two that are nearest become their mean, each mattering by its mass [k], until none are too near.
    """
    number = torch.arange(len(color), device=color.device)
    while len(color) > 1:
        lab = to_lab(color)
        gap = ciede2000(lab[:, None], lab[None])
        gap.fill_diagonal_(torch.inf)
        nearest = int(gap.argmin())
        one, other = sorted((nearest // len(color), nearest % len(color)))
        if float(gap[one, other]) >= apart:
            break
        pair = torch.stack((mass[one], mass[other])) + 1e-9
        color, mass = color.clone(), mass.clone()
        color[one], mass[one] = (pair[:, None] * color[[one, other]]).sum(0) / pair.sum(), pair.sum()
        stays = torch.arange(len(color), device=color.device) != other
        color, mass = color[stays], mass[stays]
        number = torch.where(number == other, one, number - (number > other).long())
    return color, number


MOVED = 0.15
"""Share of the strokes that may move at a time."""
MOVED_WHERE_A_LAYER_BEGINS = 0.5
"""The same where nothing of a layer was painted, and the canvas may be another than it was planned for."""
PROPOSALS = 24
"""Weighed for each stroke that moves."""
_PROBES = 8
_WORTHWHILE = 1.5  # a gain is foreseen on a coarse picture, and neighbours may want the same place


def loss_without(strokes: Strokes, scene: Scene, target: Tensor, generator: torch.Generator) -> Tensor:
    """How much the summed squared error to target [3, H, W] rises when one stroke is left out, for each, [n]."""
    slope, square = loss_of_paint(strokes, scene, target, generator)
    return slope + square


def loss_of_paint(strokes: Strokes, scene: Scene, target: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """What it costs that a stroke lacks a share f of its paint: f slope + f^2 square, for each stroke, [n] and [n].

    That is by how much the summed squared error to target [3, H, W] rises. Errors count by the scene's importance w,
    where it has one: r and D_i below are then those times its root.

    The picture is linear in the opacity of a single stroke: leaving out stroke i takes D_i from
    it, and the error rises by 2 r.D_i + |D_i|^2 with r = target - picture. r.D_i is a derivative;
    |D_i|^2 is the mean of (z.D_i)^2 over random signs z (Hutchinson's estimator), a derivative too.
    """
    with torch.no_grad():
        magnitude, affine = scene.marks(strokes)
    magnitude.requires_grad_()
    picture = composite(magnitude, affine, strokes.color, scene.canvas, bare_cells_answer=False)

    def along(direction: Tensor) -> Tensor:
        """direction . D_i for every stroke."""
        (slope,) = torch.autograd.grad(picture, magnitude, direction, retain_graph=True)
        return (slope * magnitude).sum((1, 2)).detach()

    matters = torch.ones_like(target[0]) if scene.importance is None else scene.importance
    signs = [torch.randint(0, 2, picture.shape, generator=generator).to(picture) * 2 - 1 for _ in range(_PROBES)]
    squared = torch.stack([along(sign * matters.sqrt()).square() for sign in signs]).mean(0)
    return 2 * along((matters * (target - picture)).detach()), squared


def visible_area(strokes: Strokes, scene: Scene) -> Tensor:
    """How much of the picture each stroke's colour makes up, in pixels, [n]."""
    color = strokes.color.detach().clone().requires_grad_()
    picture = scene.render(strokes.with_groups(color=color))
    (share,) = torch.autograd.grad(picture, color, torch.ones_like(picture))
    return share[:, 0]


def anneal_to_palette(strokes: Strokes, scene: Scene, colors: int, keeping: float, seed: int) -> Strokes:
    """The strokes, still in colours of their own, but nearer to `colors` paints: `keeping` of the way is left.

    Done again and again with gradient descent in between, shapes and colours grow used to the
    paints, and lose less when at last they get them.
    """
    palette, paint = _cluster(strokes, scene, colors, seed)
    nearest = palette.color[paint]
    return strokes.with_groups(color=nearest + keeping * (strokes.color - nearest))


def discretize(strokes: Strokes, scene: Scene, colors: int, seed: int) -> tuple[Strokes, Paints]:
    """The strokes in at most `colors` paints, light to dark (paper, "Paint Colors and Mixing")."""
    palette, paint = _cluster(strokes, scene, colors, seed)
    order = torch.argsort(paint, stable=True)
    return strokes[order].with_groups(color=palette.color[paint[order]]), Paints(palette.color, paint[order])


def _cluster(strokes: Strokes, scene: Scene, colors: int, seed: int) -> tuple[Palette, Tensor]:
    """Paints for the strokes' colours that differ, and which one is nearest to each stroke's, [n].

    A colour counts by the fourth root of the area in which it is seen: by the area alone, small
    accents would drown.
    """
    weight = visible_area(strokes, scene).clamp(min=0).pow(0.25)
    palette = distinct(Palette.cluster(strokes.color, weight, colors, seed), strokes.color, weight, HARDLY_APART)
    return palette, torch.cdist(strokes.color, palette.color).argmin(1)


def relocate(
    strokes: Strokes,
    paints: Paints | None,
    scene: Scene,
    target: Tensor,
    *,
    share: float,
    light_to_dark: bool = True,
    proposals: int,
    generator: torch.Generator,
) -> tuple[Strokes, Paints | None]:
    """The same number of strokes, in painting order, of which up to a `share` has moved to better places.

    The strokes that matter least make room for the proposals that gain most, pair by pair, as long
    as the one gains clearly more than the other loses.
    """
    most = round(share * len(strokes))
    if most == 0:
        return strokes, paints
    loss = loss_without(strokes, scene, target, generator)
    found = best_proposals(
        strokes, paints, most, scene, target, proposals, light_to_dark=light_to_dark, generator=generator
    )
    weakest = torch.argsort(loss)[: len(found.strokes)]
    count = int((found.gain > _WORTHWHILE * loss[weakest].clamp(min=0)).sum())
    stays = torch.ones(len(strokes), dtype=torch.bool, device=loss.device)
    stays[weakest[:count]] = False
    if paints is not None:
        paints = replace(paints, paint=paints.paint[stays])
    return insert(strokes[stays], paints, found.first(count), light_to_dark=light_to_dark)


# From free colours to paints: colours move towards the paints in rounds, then strokes and paints settle together.

_KEEPING = (0.7, 0.45, 0.2, 0.1)  # of the way from a stroke's colour to its paint, round after round


def binding_iterations(drawing: int, binding: int) -> int:
    """How many iterations it takes."""
    return len(_KEEPING) * drawing + binding


def bound(
    strokes: Strokes,
    scene: Scene,
    colors: int,
    *,
    drawing: int,
    binding: int,
    seed: int,
    begin: Callable[[int], Callable[[Step], None]],
) -> tuple[Strokes, Paints]:
    """The strokes, in painting order, in at most `colors` paints.

    drawing: iterations after each round; binding: once colours are paints; begin: where so many of them are to be
    reported.
    """
    for keeping in _KEEPING:
        strokes = anneal_to_palette(strokes, scene, colors, keeping, seed)
        strokes, _ = optimize(strokes, scene, iterations=drawing, notify=begin(drawing))
    strokes, chosen = discretize(strokes, scene, colors, seed)
    strokes, paints = optimize(strokes, scene, iterations=binding, paints=chosen, notify=begin(binding))
    assert paints is not None
    return strokes, paints
