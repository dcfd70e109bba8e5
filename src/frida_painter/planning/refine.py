"""Work between rounds of gradient descent: weak strokes move, and free colours become paints."""

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from frida_painter.planning.effort import DRAWING, Effort
from frida_painter.planning.initialize import best_proposals, insert
from frida_painter.planning.optimize import Step, optimize
from frida_painter.planning.problem import PlanningProblem
from frida_painter.planning.variables import Paints
from frida_painter.render import composite
from frida_painter.strokes.palette import Palette, ciede2000, to_lab
from frida_painter.strokes.strokes import Strokes

HARDLY_APART = 2.5
"""CIEDE2000 below which two paints are hardly told apart and are merged.

With 5, photographs lost 0.1 to 0.2 dB, and text goals got wrong colours, such as a green and purple dolphin.
"""
_GROWN = 0.8  # share of HARDLY_APART below which paints are merged at the end


def distinct(palette: Palette, color: Tensor, weight: Tensor, apart: float) -> Palette:
    """Returns the palette, lightest first, with no two paints nearer than `apart` (CIEDE2000).

    Each well that becomes free gets an accent: the colour with the largest product of weight and squared distance
    from all paints. The palette has fewer paints if no colour is farther than `apart` from them.
    color [n, 3], weight [n]: colours for which the palette was chosen, and their weights.
    """
    paint = palette.nearest(color)
    mass = weight.new_zeros(len(palette)).index_add(0, paint.to(weight.device), weight)
    paints, _ = _merge_colors(palette.color, mass, apart)
    lab = to_lab(color)
    for _ in range(len(palette) - len(paints)):
        gap = ciede2000(lab[:, None], to_lab(paints)[None]).amin(1)
        worth = torch.where(gap >= apart, weight * gap.square(), 0)
        if not float(worth.max()) > 0:
            break
        paints = torch.cat((paints, color[worth.argmax()][None]))
    return Palette.sort_light_to_dark(paints)


def without_twins(paints: Paints, apart: float) -> Paints:
    """Returns the paints after merging all that are closer than 0.8 times `apart`; strokes keep their order."""
    strokes = torch.bincount(paints.paint, minlength=len(paints.color)).to(paints.color)
    colors, number = _merge_colors(paints.color, strokes, _GROWN * apart)
    return Paints(colors, number[paints.paint], paints.first)


def _merge_colors(color: Tensor, mass: Tensor, apart: float) -> tuple[Tensor, Tensor]:
    """Merges the two nearest colours into their weighted mean, until all are at least `apart` in CIEDE2000.

    mass [k]: weight of each colour.
    Returns the colours [m, 3] and the new number of each old colour [k].
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
"""Share of the strokes that may move in a round."""
MOVED_WHERE_A_LAYER_BEGINS = 0.5
"""Share of the strokes that may move if a layer begins, because its canvas may differ from the planned one."""
_PROPOSALS = 24  # that are weighed for each stroke that moves
_PROBES = 8
_WORTHWHILE = 1.5  # gains are estimated on a coarse picture, and neighbours may want the same place


def loss_of_paint(
    strokes: Strokes, problem: PlanningProblem, target: Tensor, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Returns the cost of strokes that lack a share f of their paint: f slope + f^2 square, [n] and [n].

    The cost is the rise of the summed squared error to target [3, H, W]. If the scene has an importance w, errors
    count by w; r and D_i below are then multiplied by its root.

    The picture is linear in the opacity of a single stroke. Without stroke i the picture loses D_i, and the error
    rises by 2 r.D_i + |D_i|^2 with r = target - picture. r.D_i is a derivative. |D_i|^2 is the mean of (z.D_i)^2
    over random signs z (Hutchinson's estimator), which is a derivative too.
    """
    with torch.no_grad():
        marks = problem.marks(strokes)
    affine, magnitude = marks.affine, marks.magnitude.detach().requires_grad_()
    picture = composite(magnitude, affine, strokes.color, problem.canvas, bare_cells_answer=False)

    def along(direction: Tensor) -> Tensor:  # -direction . D_i for every stroke
        # Of a number: PyTorch imports its compiler if it is given a direction, which takes half a second.
        (slope,) = torch.autograd.grad((picture * direction).sum(), magnitude, retain_graph=True)
        return -(slope * magnitude).sum((1, 2)).detach()

    matters = torch.ones_like(target[0]) if problem.wishes.importance is None else problem.wishes.importance
    signs = [torch.randint(0, 2, picture.shape, generator=generator).to(picture) * 2 - 1 for _ in range(_PROBES)]
    squared = torch.stack([along(sign * matters.sqrt()).square() for sign in signs]).mean(0)
    return -2 * along((matters * (target - picture)).detach()), squared


def visible_area(strokes: Strokes, problem: PlanningProblem) -> Tensor:
    """Returns the visible area of each stroke in pixels [n]: the sum of its share of every pixel."""
    color = strokes.color.detach().clone().requires_grad_()
    picture = problem.render(strokes.with_groups(color=color))
    (share,) = torch.autograd.grad(picture.sum(), color)
    return share[:, 0]


def relocate(
    strokes: Strokes,
    paints: Paints | None,
    problem: PlanningProblem,
    target: Tensor,
    share: float,
    generator: torch.Generator,
) -> tuple[Strokes, Paints | None]:
    """Moves up to a `share` of the strokes to places of a larger gain; the number of strokes stays the same.

    The strokes that matter least make room for the best proposals, pair by pair. A stroke moves only if the gain of
    the proposal is 1.5 times its own loss or more.
    """
    most = round(share * len(strokes))
    if most == 0:
        return strokes, paints
    slope, square = loss_of_paint(strokes, problem, target, generator)
    loss = slope + square
    found = best_proposals(strokes, paints, most, problem, target, _PROPOSALS, generator)
    weakest = torch.argsort(loss)[: len(found.strokes)]
    count = int((found.gain > _WORTHWHILE * loss[weakest].clamp(min=0)).sum())
    stays = torch.ones(len(strokes), dtype=torch.bool, device=loss.device)
    stays[weakest[:count]] = False
    if paints is not None:
        paints = replace(paints, paint=paints.paint[stays])
    return insert(strokes[stays], paints, found.first(count))


def bind_to_palette(
    strokes: Strokes,
    problem: PlanningProblem,
    colors: int,
    effort: Effort,
    seed: int,
    begin: Callable[[int], Callable[[Step], None]],
) -> tuple[Strokes, Paints]:
    """Binds the strokes, in painting order, to at most `colors` paints (paper, "Paint Colors and Mixing").

    Colours move towards the paints in rounds, with gradient descent in between, so that shapes and colours adapt to
    the paints. Then strokes and paints, from light to dark, settle together.
    begin: returns the callback that reports the next iterations.
    """

    def cluster() -> tuple[Palette, Tensor]:  # distinct paints for the strokes' colours, and the nearest of each [n]
        # A colour counts by the fourth root of its visible area. With the area itself, small accents would get lost.
        weight = visible_area(strokes, problem).clamp(min=0).pow(0.25)
        palette = distinct(Palette.cluster(strokes.color, weight, colors, seed), strokes.color, weight, HARDLY_APART)
        return palette, torch.cdist(strokes.color, palette.color).argmin(1)

    for keeping in DRAWING:
        palette, paint = cluster()
        nearest = palette.color[paint]
        drawn = strokes.with_groups(color=nearest + keeping * (strokes.color - nearest))
        strokes, _ = optimize(drawn, problem, iterations=effort.drawing, notify=begin(effort.drawing))
    palette, paint = cluster()
    order, count = torch.argsort(paint, stable=True), effort.binding
    chosen = Paints(palette.color, paint[order])
    strokes = strokes[order].with_groups(color=chosen.color[chosen.paint])
    strokes, paints = optimize(strokes, problem, iterations=count, paints=chosen, notify=begin(count))
    assert paints is not None
    return strokes, paints
