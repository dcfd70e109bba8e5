"""Start of a plan: strokes placed at random as in the paper, or at the places that a guide picture needs most."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.brush.kinds import StrokeModel, growth_of, mark_width
from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.planning.brushwork import along_brushwork
from frida_painter.planning.effort import Effort
from frida_painter.planning.optimize import Step, optimize
from frida_painter.planning.problem import PlanningProblem
from frida_painter.planning.variables import Paints
from frida_painter.render import composite
from frida_painter.strokes.family import CODE_REACH, StrokeFamily, Taught
from frida_painter.strokes.palette import to_lab
from frida_painter.strokes.strokes import StrokeLimits, Strokes

# Places for the next strokes: many strokes are proposed, their gains are computed, and the best are kept.
#
# For a quadratic objective, the best colour of a single stroke and its gain have a closed form. Thousands of
# proposals can therefore be weighed at once on a coarse picture.

_CELLS = (16, 26)  # rows and columns of the grid on which a proposal's mark is weighed
_PLACES = 12  # most places in the painting order for a new stroke


@dataclass(frozen=True)
class Layers:
    """Places in the painting order for one more stroke, with the picture below and the light let through above.

    lightness [k - 1]: falling. A stroke that is darker than the first i values goes to place i.
    below [k, 3, H, W]: picture under a stroke at each place.
    open [k, H, W]: share of light that the strokes painted afterwards let through.
    picture [3, H, W]: picture of all strokes.
    """

    lightness: Tensor
    below: Tensor
    open: Tensor
    picture: Tensor

    def place_of(self, color: Tensor) -> Tensor:
        """Returns the place [m] of strokes with these colours [m, 3]."""
        return (to_lab(color)[:, :1] < self.lightness).sum(1)


def layers(strokes: Strokes, problem: PlanningProblem) -> Layers:
    """Returns the layers of strokes in painting order, from light to dark."""
    magnitude, affine = problem.marks(strokes)
    count = min(_PLACES, len(strokes))
    ends = [slice(len(strokes) * i // count, len(strokes) * (i + 1) // count) for i in range(count)]
    below, picture = [problem.canvas], problem.canvas  # the canvas itself is a place too: below all strokes
    for part in ends:
        picture = composite(magnitude[part], affine[part], strokes.color[part], picture)
        below.append(picture)
    open_above, covering = [], torch.ones_like(problem.canvas)
    for part in reversed(ends):
        open_above.append(covering[0])
        covering = composite(magnitude[part], affine[part], torch.zeros_like(strokes.color[part]), covering)
    open_above.append(covering[0])
    lightness = to_lab(strokes.color)[[part.stop - 1 for part in ends], 0]
    return Layers(lightness, torch.stack(below), torch.stack(open_above[::-1]), picture)


def propose(error: Tensor, count: int, limits: StrokeLimits, size: CanvasSize, generator: torch.Generator) -> Strokes:
    """Returns `count` strokes of random shape, on the error's device; large errors [H, W] attract their middles."""
    _, columns = error.shape
    wanted, error = error, error.cpu()  # same random choices on every device
    chosen = torch.multinomial(error.flatten() + 1e-12, count, replacement=True, generator=generator)
    grid = PixelGrid(size, *error.shape)
    pixel = torch.stack((chosen % columns, chosen // columns), -1).to(error)
    middle = grid.to_canvas(pixel + torch.rand(count, 2, generator=generator) - 0.5)

    def uniform(low: float, high: float) -> Tensor:
        return low + (high - low) * torch.rand(count, generator=generator)

    angle = uniform(-torch.pi, torch.pi)
    length = uniform(*limits.length)
    # A bend beyond a third of the length is a hook, which pictures rarely need.
    bend = uniform(-1, 1) * torch.minimum(length / 3, torch.tensor(limits.bend[1]))
    half = torch.stack((torch.cos(angle), torch.sin(angle)), -1) * length[:, None] / 2
    strokes = Strokes(middle - half, angle, length, bend, uniform(0, 1), torch.zeros(count, 3))
    if limits.family is not None:
        strokes = _with_codes(strokes, limits.family, generator)
        center = strokes.path(torch.linspace(0, 1, 9)).mean(1)
        strokes = strokes.with_groups(position=middle + strokes.position - center)
    return strokes.project(limits, size).to(wanted.device)


def _with_codes(strokes: Strokes, family: StrokeFamily, generator: torch.Generator) -> Strokes:
    code = CODE_REACH * (2 * torch.rand(len(strokes), family.codes, generator=generator) - 1)
    return replace(strokes, bend=torch.zeros_like(strokes.bend), taught=Taught.of(family, code.to(strokes.angle)))


def weigh(
    proposals: Strokes, under: Layers, target: Tensor, paints: Paints | None, problem: PlanningProblem
) -> tuple[Tensor, Strokes, Tensor | None]:
    """Computes the gain of each proposal: the fall of the summed squared error, in pixels of the target [3, H, W].

    Returns the gains [m], the proposals with their best colours, and with `paints` the paint of each proposal [m].

    A stroke of alpha a changes the picture by o a (c - below); o is the share left open above it. With r = target -
    picture, the gain is |r|^2 - |r - o a (c - below)|^2, and each pixel counts by its importance.
    """
    alpha, place = _cells(proposals, problem)
    wanted = _sample(target, place)  # [m, 3, cells]
    residual = wanted - _sample(under.picture, place)
    alpha = alpha[:, None]  # [m, 1, cells]
    importance = problem.wishes.importance
    matters = torch.ones_like(alpha) if importance is None else _sample(importance[None], place)
    share = alpha * matters
    color = problem.in_paint((share * wanted).sum(2) / share.sum(2).clamp(min=1e-6))
    paint = None
    if paints is not None:
        paint = paints.first + torch.cdist(to_lab(color), to_lab(paints.color[paints.first :])).argmin(1)
        color = paints.color[paint]
    layer = under.place_of(color)
    gain = alpha.new_empty(len(proposals))
    for number in sorted(set(layer.tolist())):
        mine = layer == number
        visible = alpha[mine] * _sample(under.open[number][None], place[mine])
        change = visible * (color[mine][:, :, None] - _sample(under.below[number], place[mine]))
        gain[mine] = (matters[mine] * (2 * residual[mine] * change - change.square())).sum((1, 2))
    growth = growth_of(problem.model, proposals.length)
    gain = gain if growth is None else gain * growth.square()
    pitch, cell = PixelGrid(problem.size, *target.shape[1:]).pitch, problem.model.frame.resize(*_CELLS).pitch
    return gain * (cell[0] * cell[1] / (pitch[0] * pitch[1])), proposals.with_groups(color=color), paint


def pick(strokes: Strokes, gain: Tensor, count: int, model: StrokeModel) -> Tensor:
    """Returns the indices of up to `count` strokes of the largest gain whose marks keep clear of each other."""
    strokes, gain = strokes.to("cpu"), gain.cpu()  # a loop over single strokes is faster there
    middle = strokes.path(torch.tensor([0.5]))[:, 0]
    width = mark_width(model)
    radius = torch.sqrt(strokes.way() * (0.3 + 0.7 * strokes.thickness) * width) / 2
    chosen: list[int] = []
    free = gain > 0
    for index in torch.argsort(gain, descending=True).tolist():
        if len(chosen) == count:
            break
        if not free[index]:
            continue
        chosen.append(index)
        free &= (middle - middle[index]).norm(dim=1) > 0.8 * (radius + radius[index])
    return torch.tensor(chosen, dtype=torch.long)


def _cells(strokes: Strokes, problem: PlanningProblem) -> tuple[Tensor, Tensor]:
    """Returns the coarse alpha [m, cells] of each mark, and the cells' canvas positions [m, cells, 2] in [-1, 1]."""
    magnitude = problem.model(strokes.thickness, strokes.length, strokes.shape)
    alpha = functional.interpolate(magnitude[:, None], _CELLS, mode="area")[:, 0].flatten(1)
    centers = problem.model.frame.resize(*_CELLS).cell_centers(dtype=alpha.dtype, device=alpha.device).flatten(0, 1)
    growth = growth_of(problem.model, strokes.length)
    across, up = centers[:, 0], centers[:, 1]
    if growth is not None:
        across, up = growth[:, None] * across, growth[:, None] * up
    cos, sin = torch.cos(strokes.angle)[:, None], torch.sin(strokes.angle)[:, None]
    x = strokes.position[:, 0:1] + cos * across - sin * up
    y = strokes.position[:, 1:2] + sin * across + cos * up
    place = torch.stack((2 * x / problem.size.width - 1, 1 - 2 * y / problem.size.height), -1)
    outside = (place.abs() > 1).any(-1)
    return alpha.masked_fill(outside, 0), place


def _sample(picture: Tensor, place: Tensor) -> Tensor:
    """Samples the picture [c, H, W] at positions [m, cells, 2]; returns [m, c, cells]."""
    found = functional.grid_sample(picture[None], place[None].to(picture), align_corners=False, padding_mode="border")
    return found[0].transpose(0, 1)


_COARSENESS = 3  # pixels of the planning image to a pixel of the descended picture
_DESCENDING, _DESCENT = 60, 0.05  # steps, and their size in sRGB


def uniform(count: int, limits: StrokeLimits, size: CanvasSize, generator: torch.Generator) -> Strokes:
    """Returns `count` strokes sampled uniformly over the parameters (paper, Algorithm 1, `init_brush_strokes`)."""

    def between(low: float, high: float) -> Tensor:
        return low + (high - low) * torch.rand(count, generator=generator)

    limits = limits.within(size)
    strokes = Strokes(
        position=torch.rand(count, 2, generator=generator) * torch.tensor([size.width, size.height]),
        angle=between(-torch.pi, torch.pi),
        length=between(*limits.length),
        bend=between(*limits.bend),
        thickness=between(0, 1),
        color=torch.rand(count, 3, generator=generator),
    )
    if limits.family is not None:
        strokes = _with_codes(strokes, limits.family, generator)
    return strokes.project(limits, size)


def progressive(
    count: int,
    problem: PlanningProblem,
    target: Tensor,
    effort: Effort,
    generator: torch.Generator,
    notify: Callable[[Step], None] = lambda step: None,
) -> Strokes:
    """Grows `count` strokes in their own colours, from light to dark, towards `target` [3, H, W].

    Each round proposes strokes at the errors of the current picture and places those with the largest gains.
    Gradient descent on the scene's objective then settles all strokes together.
    """
    strokes = Strokes.empty(device=problem.canvas.device)
    quotas = round_sizes(count, effort.growing)
    for number, quota in enumerate(quotas):
        while quota > 0:
            found = best_proposals(strokes, None, quota, problem, target, effort.proposals, generator)
            strokes, _ = insert(strokes, None, found)
            quota -= len(found.strokes)

        def tell(step: Step, done: int = number) -> None:
            before, steps = done * effort.growing_together, len(quotas) * effort.growing_together
            notify(replace(step, iteration=before + step.iteration, of=steps))

        strokes, _ = optimize(strokes, problem, iterations=effort.growing_together, notify=tell)
    return strokes


def optimize_target(problem: PlanningProblem) -> Tensor:
    """Returns a target picture [3, H, W] for a goal without a guide picture, by gradient descent from the canvas.

    The picture is no finer than strokes are; otherwise networks would favour patterns that no brush can paint.
    Against strokes that start at random, as in the paper, plans of 24 and 60 strokes towards four of these goals
    ended a third nearer.
    """
    _, rows, columns = problem.canvas.shape
    shape = (max(1, rows // _COARSENESS), max(1, columns // _COARSENESS))
    small = functional.adaptive_avg_pool2d(problem.canvas[None], shape).clone().requires_grad_()
    adam = torch.optim.Adam([small], lr=_DESCENT)

    def picture() -> Tensor:
        return functional.interpolate(small, (rows, columns), mode="bilinear")[0]

    for _ in range(_DESCENDING):
        adam.zero_grad()
        torch.autograd.backward(problem.objective(picture()))
        adam.step()
        with torch.no_grad():
            small.clamp_(0, 1)
    return picture().detach()


@dataclass(frozen=True)
class Found:
    """Proposed strokes, best first.

    gain: gain of each stroke in summed squared error.
    paint: paint of each stroke; None without a palette.
    """

    strokes: Strokes
    gain: Tensor
    paint: Tensor | None

    def first(self, count: int) -> "Found":
        """Returns the best `count` strokes."""
        return Found(self.strokes[:count], self.gain[:count], None if self.paint is None else self.paint[:count])


@torch.no_grad()
def best_proposals(
    strokes: Strokes,
    paints: Paints | None,
    count: int,
    problem: PlanningProblem,
    target: Tensor,
    proposals: int,
    generator: torch.Generator,
) -> Found:
    """Returns 1 to `count` strokes of the largest gain that keep clear of each other.

    proposals: number of proposals weighed for each stroke, at least 64 in all.
    """
    under = layers(strokes, problem)
    error = (target - under.picture).square().sum(0)
    if problem.wishes.importance is not None:
        error = error * problem.wishes.importance
    # The error is averaged over a neighbourhood of about a twentieth of the height.
    width = 2 * (error.shape[0] // 40) + 1
    error = functional.avg_pool2d(error[None, None], width, 1, width // 2, count_include_pad=False)[0, 0]
    candidates = propose(error, max(64, proposals * count), problem.limits, problem.size, generator)
    if (wanted := problem.wishes.brushwork) is not None:
        candidates = along_brushwork(candidates, wanted.to(error), problem.model, problem.size, generator)
    gain, candidates, paint = weigh(candidates, under, target, paints, problem)
    chosen = pick(candidates, gain, count, problem.model)
    if len(chosen) == 0:  # no stroke gains any more, but the rest must still be placed
        chosen = torch.argsort(gain, descending=True)[:count]
    return Found(candidates[chosen], gain[chosen], None if paint is None else paint[chosen])


def insert(strokes: Strokes, paints: Paints | None, found: Found) -> tuple[Strokes, Paints | None]:
    """Inserts the found strokes at their places in the painting order."""
    strokes = Strokes.join(strokes, found.strokes)
    if paints is not None and found.paint is not None:
        paints = replace(paints, paint=torch.cat([paints.paint, found.paint]))
    order = torch.argsort(to_lab(strokes.color)[:, 0], descending=True, stable=True)
    return strokes[order], None if paints is None else replace(paints, paint=paints.paint[order])


def round_sizes(count: int, rounds: int) -> list[int]:
    """Splits `count` into at most `rounds` growing parts, each at least 1."""
    rounds = min(rounds, count)
    if rounds == 0:
        return []
    share = torch.arange(1, rounds + 1, dtype=torch.float64).cumsum(0)
    ends = (share / share[-1] * (count - rounds)).round().long() + torch.arange(1, rounds + 1)
    return torch.diff(ends, prepend=ends.new_zeros(1)).tolist()
