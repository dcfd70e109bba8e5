"""Gradient descent on the plan (paper, Algorithm 1, `optimize`), within the limits of the brush and the canvas."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from torch import Tensor

from frida_painter.brush.kinds import kind_of, mark_width
from frida_painter.errors import PlanningDiverged
from frida_painter.frames import PixelGrid, Rows
from frida_painter.objectives.objective import CanvasLoss, Sparing
from frida_painter.planning.problem import PlanningProblem
from frida_painter.planning.variables import Paints, Variables
from frida_painter.render import Marks, Moments, composite_moments
from frida_painter.strokes.strokes import Strokes
from frida_painter.system.devices import array, compiles_for

_BETAS = (0.9, 0.98)
_EPSILON = 1e-8


class Adam:
    """Adam optimiser that steps `leaves` in place along their gradients (D. Kingma, J. Ba, ICLR 2015).

    It is that of PyTorch but for rounding. torch.optim.Adam loads PyTorch's compiler, which would cost every planning
    command more than a second.
    betas: decay rates of the means of the gradient and of its square.
    """

    def __init__(self, leaves: Sequence[Tensor], betas: tuple[float, float] = _BETAS) -> None:
        self._leaves, self._betas = list(leaves), betas
        self._means = [torch.zeros_like(leaf) for leaf in self._leaves]
        self._squares = [torch.zeros_like(leaf) for leaf in self._leaves]
        self._steps = 0

    def forget_gradients(self) -> None:
        """Sets the gradients of all leaves to None."""
        for leaf in self._leaves:
            leaf.grad = None

    @torch.no_grad()
    def step(self, rate: float) -> None:
        """Makes one step of this rate for every leaf that has a gradient."""
        self._steps += 1
        first, second = self._betas
        length = rate / (1 - first**self._steps)
        spread = (1 - second**self._steps) ** 0.5
        for leaf, mean, square in zip(self._leaves, self._means, self._squares, strict=True):
            if leaf.grad is None:
                continue
            if compiles_for(leaf) and leaf.is_contiguous():
                from frida_painter.planning.kernels import step

                state = (array(tensor).reshape(-1) for tensor in (leaf, leaf.grad, mean, square))
                step(*state, *map(array(leaf).dtype.type, (first, second, length, spread, _EPSILON)))
                torch.autograd.graph.increment_version(leaf)
            else:
                mean.lerp_(leaf.grad, 1 - first)
                square.mul_(second).addcmul_(leaf.grad, leaf.grad, value=1 - second)
                leaf.addcdiv_(mean, square.sqrt().div_(spread).add_(_EPSILON), value=-length)


# Interlacing: an iteration renders only some rows, because a stroke changes adjacent rows in nearly the same way.
#
# Rendering time is proportional to the rows that strokes cross. The mean squared error of some rows estimates that
# of all rows. Its mean over the turns is exact, and so is the gradient. docs/lab/planning.md has the gains and
# losses.

_ROWS_TO_A_MARK = 32  # in the rectangle that holds every mark of the brush


def interlace_rows(problems: list[PlanningProblem]) -> list[list[PlanningProblem]]:
    """Returns the scenes of each turn: those of all parts, with the same rows; together the turns have all rows.

    There is one turn if all rows are needed. The distance of two rows is at most a 32nd of the height of the
    rectangle that holds the marks of a brush, or of the canvas if that is less. The smallest brush decides.
    """
    if any(problem.forms.on_rows is None for problem in problems):
        return [problems]
    apart = []
    for problem in problems:
        _, pitch = PixelGrid(problem.size, *problem.canvas.shape[1:]).pitch
        mark = 3 * mark_width(problem.model)
        apart.append(max(1, int(min(mark, problem.size.height) / _ROWS_TO_A_MARK / pitch)))
    every = min(apart)
    if every == 1:
        return [problems]

    def on_rows(problem: PlanningProblem, rows: Rows) -> PlanningProblem:
        assert problem.forms.on_rows is not None
        return replace(problem, objective=problem.forms.on_rows(rows), rows=rows)

    turns = (Rows(every, first) for first in range(every))
    return [[on_rows(problem, rows) for problem in problems] for rows in turns]


def take_turns(
    problems: list[PlanningProblem], iterations: int, pace: float = 1.0
) -> list[tuple[list[PlanningProblem], bool]]:
    """Returns the scenes of each iteration of one optimisation, from the first to `iterations` inclusive.

    Each comes with True if its loss can be compared with others: all rows are seen, and all terms are computed.

    If a term is slow, as those of networks are, some iterations compute it and the others use its gradient there
    (`find_renewals`); else the iterations between the first and the last one have rows of their own (`interlace_rows`).
    """
    sparing = problems[0].forms.sparing
    if sparing is None:
        turns = interlace_rows(problems)
        between = [(turns[number % len(turns)], len(turns) == 1) for number in range(1, iterations)]
        return [(problems, True), *between, (problems, True)][: iterations + 1]
    made = sparing()
    first, *others = problems
    anew, spared = ([replace(first, objective=judge), *others] for judge in (made.anew, made.between))
    renewed = find_renewals(iterations, made, pace)
    asked = [(anew, True) if number in renewed else (spared, False) for number in range(iterations)]
    return [*asked, (problems, True)]


def find_renewals(iterations: int, sparing: Sparing, pace: float = 1.0) -> set[int]:
    """Returns the iterations that compute slow terms: every `sparing.lasts` of them.

    If these terms are smooth, full steps are counted in place of iterations: small steps at the beginning and at the
    end do not go far.
    """
    found, way = {0}, 0.0
    for number in range(1, iterations):
        way += pace * _step_schedule(number - 1, iterations) if sparing.smooth else 1.0
        if way >= sparing.lasts:
            found.add(number)
            way = 0.0
    return found


# Strokes of several brushes, each painted over the one before: their joint picture and loss.
#
# Each part has a scene with its brush; all parts are on the canvas of the first scene.


def stacked_moments(
    strokes: Sequence[Strokes], problems: Sequence[PlanningProblem], marks: Sequence[Marks] | None = None
) -> Moments:
    """Returns mean [3, H, W] and variance [H, W] of the picture after strokes of several brushes, painted in turn.

    scenes: one for each part, with its brush; the canvas is that of the first.
    marks: marks of each part, as leaves of a gradient. None: the marks of the stroke model.
    """
    mean = problems[0].rows.of(problems[0].canvas)
    variance = torch.zeros_like(mean[0]) if problems[0].unrest is None else problems[0].unrest
    for number, (part, problem) in enumerate(zip(strokes, problems, strict=True)):
        if len(part) == 0:
            continue
        laid = problem.marks(part) if marks is None else marks[number]
        mean, variance = composite_moments(*laid, part.color, mean, problem.spread, variance, bare_cells_answer=False)
    return Moments(mean, variance)


def stacked_loss(
    strokes: Sequence[Strokes], problems: Sequence[PlanningProblem], objective: CanvasLoss | None = None
) -> Tensor:
    """Returns the expected loss over paintings of the strokes, by default for the objective of the first scene."""
    if len(problems) == 1:
        return problems[0].expected_loss(strokes[0], objective)
    return (objective or problems[0].objective)(*stacked_moments(strokes, problems))


def stacked_cost(
    strokes: Sequence[Strokes], problems: Sequence[PlanningProblem], objective: CanvasLoss | None = None
) -> Tensor:
    """Returns the expected loss plus the price of the paint.

    Paint has a price because every dip takes time, and hardly visible paint gains little. The price is a share of
    the loss, because a decibel is worth as much in a dark picture as in a light one.
    """
    loss = stacked_loss(strokes, problems, objective)
    if not any(problem.wishes.paint_price > 0 or problem.wishes.brushwork is not None for problem in problems):
        return loss
    return loss * (1 + sum(problem.stroke_cost(part) for part, problem in zip(strokes, problems, strict=True)))


_MAX_FAILURES = 3
_WARMING = 6
_BETWEEN_VALIDATIONS = 10  # iterations
_RENEWAL = 10  # iterations after which a change of the picture is renewed
_READ_TOGETHER = 8  # iterations; a GPU would stand still at each reading


@dataclass(frozen=True)
class Step:
    """Report of one iteration of the optimiser.

    iteration, of: number of the iteration, and their total.
    loss: loss before the iteration, on the rows that it rendered.
    laid: each kind of strokes (`plan.Layer.kind`) and its strokes on the canvas, in painting order.
    """

    iteration: int
    of: int
    loss: float
    laid: tuple[tuple[str, Strokes], ...] = ()

    @property
    def parts(self) -> tuple[tuple[str, Strokes], ...]:
        """Each brush and its current strokes, on the CPU."""
        return tuple((brush, strokes.to("cpu")) for brush, strokes in self.laid)


@dataclass(frozen=True)
class StrokesInScene:
    """Strokes of one brush, in painting order, to be optimised in a scene.

    paints: palette and the paint of each stroke. None: each stroke has its own colour.
    vary_colors: True if the palette, or each stroke's own colour, may change.
    """

    strokes: Strokes
    problem: PlanningProblem
    paints: Paints | None = None
    vary_colors: bool = True


PictureChange = Callable[[Sequence[Strokes], Sequence[PlanningProblem]], Tensor]
"""Function that returns the change [3, H, W] of an expected picture, for strokes of several brushes in turn."""


def optimize(
    strokes: Strokes,
    problem: PlanningProblem,
    *,
    iterations: int,
    paints: Paints | None = None,
    vary_colors: bool = True,
    pace: float = 1.0,
    notify: Callable[[Step], None] = lambda step: None,
) -> tuple[Strokes, Paints | None]:
    """Optimises strokes of one brush, in painting order, and their paints; see `optimize_together`."""
    part = StrokesInScene(strokes, problem, paints, vary_colors)
    (found,) = optimize_together([part], iterations=iterations, pace=pace, notify=notify)
    return found.strokes, found.paints


def optimize_together(
    parts: Sequence[StrokesInScene],
    *,
    iterations: int,
    pace: float = 1.0,
    notify: Callable[[Step], None] = lambda step: None,
    change: PictureChange | None = None,
) -> list[StrokesInScene]:
    """Optimises parts, each painted over the one before, for the objective of the first part's scene.

    pace: factor of the step size.
    notify: called after every iteration; on a GPU, for several iterations at once.
    change: change [3, H, W] of the expected picture that the marks do not know of, for strokes in painting order. It
    is renewed every ten iterations and held constant in between, so it has no slopes. None: no change.
    Returns the best parts seen, never worse than the given ones. They are compared on all rows, by the objective.
    If the scene has a validation objective, that one compares them, every ten iterations; every twenty if slow terms
    are spared.
    Raises PlanningDiverged at the third loss or gradient that is not finite, or if no loss was finite.

    Iterations render some rows in turn if that is enough (`interlace_rows`), but all rows at the beginning and at the
    end. Slow terms of the objective are computed in some iterations only (`take_turns`). A step that is not finite is
    discarded (on a GPU at the next reading), and later steps are half as large.
    """
    working = [part for part in parts if len(part.strokes)]
    if not working:
        return list(parts)
    variables = [Variables(part.strokes, part.paints, vary_colors=part.vary_colors) for part in working]
    leaves = [leaf for each in variables for leaf in each.leaves]
    problems = [part.problem for part in working]
    kinds = [kind_of(problem.model) for problem in problems]
    adam, best = Adam(leaves), _Best(leaves)
    waiting: list[_Reading] = []
    together = 1 if leaves[0].device.type == "cpu" else _READ_TOGETHER
    validation = problems[0].forms.validation
    pause = _BETWEEN_VALIDATIONS * (2 if problems[0].forms.sparing else 1)  # as long as some spared iterations
    failures = 0
    changed: Tensor | None = None
    for iteration, (seen, is_comparable) in enumerate(take_turns(problems, iterations, pace)):
        current = [each.strokes(each.order()) for each in variables]
        if change is not None:
            if changed is None or iteration % _RENEWAL == 0 or iteration == iterations:
                with torch.no_grad():
                    changed = change(current, problems)
            else:
                is_comparable = False  # only plans with their own changes are compared
            shifted = shift_objective(seen[0].objective, seen[0].rows.of(changed))
            seen = [replace(seen[0], objective=shifted), *seen[1:]]
        with torch.set_grad_enabled(iteration < iterations):
            loss = stacked_cost(current, seen)
        if validation is None:
            if is_comparable:  # losses of different rows are not comparable, nor is a tangent a loss
                best.consider(loss)
        elif iteration % pause == 0 or iteration == iterations:
            with torch.no_grad():
                by = validation if changed is None else shift_objective(validation, changed)
                best.consider(stacked_cost(current, problems, by))
        if iteration == iterations:
            break
        adam.forget_gradients()
        torch.autograd.backward(loss)
        laid = tuple((kind, strokes.detach()) for kind, strokes in zip(kinds, current, strict=True))
        waiting.append(_Reading(iteration, loss.detach(), _zero_unsound_slope(loss, leaves), laid))
        adam.step(pace * 0.5**failures * _step_schedule(iteration, iterations))
        for each, problem in zip(variables, problems, strict=True):
            each.bring_inside(problem.limits, problem.size, problem.in_paint)
        if len(waiting) < together and iteration + 1 < iterations:
            continue
        numbers = [part.to(best.loss) for one in waiting for part in (one.loss, one.sound)]
        least, *values = torch.stack([best.loss, *numbers]).tolist()  # one transfer
        read, waiting = zip(waiting, values[::2], values[1::2], strict=True), []
        for reading, value, sound in read:
            if sound:
                notify(Step(reading.iteration + 1, iterations, value, reading.laid))
                continue
            failures += 1
            if failures == _MAX_FAILURES or not math.isfinite(least):
                raise PlanningDiverged(
                    f"The loss or its slope was not finite in iteration {reading.iteration}, for the {failures}. time "
                    f"(the loss was {value:g}); try another seed (--seed), or another picture."
                )
            best.restore()
            adam = Adam(leaves)
            break
    best.restore()
    done = iter(zip(working, variables, strict=True))
    return [_in_order(*next(done)) if len(part.strokes) else part for part in parts]


def shift_objective(objective: CanvasLoss, change: Tensor) -> CanvasLoss:
    """Returns the objective of pictures to which this change [3, h, w] is added."""
    return lambda picture, variance=None: objective(picture + change, variance)


def _in_order(part: StrokesInScene, variables: Variables) -> StrokesInScene:
    order = variables.order()
    found = variables.paints()
    if found is not None:
        found = replace(found, paint=found.paint[order])
    return replace(part, strokes=variables.strokes().detach()[order], paints=found)


def _step_schedule(iteration: int, iterations: int) -> float:
    """Returns the step size: it grows over the first iterations and then falls along a half cosine to a tenth.

    Adam's first steps have the same size for every gradient. At full size, they would undo a settled plan.
    """
    warm = min(1.0, (iteration + 1) / _WARMING)
    return warm * (0.1 + 0.45 * (1 + math.cos(math.pi * iteration / iterations)))


def _zero_unsound_slope(loss: Tensor, leaves: list[Tensor]) -> Tensor:
    """Returns True, as a tensor, if loss and gradients are finite; otherwise sets the gradients to 0."""
    if any(leaf.grad is None for leaf in leaves):
        return torch.zeros_like(loss, dtype=torch.bool)
    slopes = [leaf.grad for leaf in leaves if leaf.grad is not None]
    sums = [loss.detach(), *(slope.sum() for slope in slopes)]  # one bad number spoils a sum
    sound = torch.stack(sums).isfinite().all()
    for leaf, slope in zip(leaves, slopes, strict=True):
        leaf.grad = torch.where(sound, slope, 0)
    return sound


class _Reading(NamedTuple):
    """Iteration whose loss may still be on the device; it is sound if loss and gradients were finite."""

    iteration: int
    loss: Tensor
    sound: Tensor
    laid: tuple[tuple[str, Strokes], ...]


class _Best:
    """Best values of the leaves so far, kept on their device."""

    def __init__(self, leaves: Sequence[Tensor]) -> None:
        self._leaves = leaves
        self.loss = leaves[0].new_full((), math.inf)
        self._kept = [leaf.detach().clone() for leaf in leaves]

    def consider(self, loss: Tensor) -> None:
        """Keeps the leaves if the loss is the least so far."""
        loss = loss.detach().to(self.loss)
        better = loss < self.loss
        self.loss = torch.where(better, loss, self.loss)
        both = zip(self._leaves, self._kept, strict=True)
        self._kept = [torch.where(better, leaf.detach(), kept) for leaf, kept in both]

    def restore(self) -> None:
        """Sets the leaves to the best values."""
        with torch.no_grad():
            for leaf, kept in zip(self._leaves, self._kept, strict=True):
                leaf.copy_(kept)
