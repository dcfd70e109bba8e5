"""Gradient descent on the plan (paper, Algorithm 1, `optimize`), under the limits it will be painted with."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from frida_painter.compiled import array, compiles_for
from frida_painter.errors import PlanningDiverged
from frida_painter.frames import PixelGrid, Rows
from frida_painter.objectives.objective import Objective
from frida_painter.planning.problem import Scene
from frida_painter.planning.variables import Paints, Variables
from frida_painter.render import Marks, Moments, composite_moments
from frida_painter.strokes import Strokes

# Adam for the planner's two leaves, torch's own but for rounding (D. Kingma, J. Ba, ICLR 2015).
#
# torch.optim.Adam loads PyTorch's compiler, whatever it is used for: more than a second of every command that plans.

_EPSILON = 1e-8


class Adam:
    """Steps `leaves`, in place, along their gradients; betas: how long the means of slope and of its square last."""

    def __init__(self, leaves: Sequence[Tensor], betas: tuple[float, float]) -> None:
        self._leaves = list(leaves)
        self._betas = betas
        self._means = [torch.zeros_like(leaf) for leaf in self._leaves]
        self._squares = [torch.zeros_like(leaf) for leaf in self._leaves]
        self._steps = 0

    def forget_gradients(self) -> None:
        """Has the next gradients begin at nothing."""
        for leaf in self._leaves:
            leaf.grad = None

    @torch.no_grad()
    def step(self, rate: float) -> None:
        """One step of that rate for every leaf that has a gradient."""
        self._steps += 1
        first, second = self._betas
        length = rate / (1 - first**self._steps)
        spread = (1 - second**self._steps) ** 0.5
        for leaf, mean, square in zip(self._leaves, self._means, self._squares, strict=True):
            if leaf.grad is None:
                continue
            if compiles_for(leaf) and leaf.is_contiguous():
                from frida_painter.planning.variable_kernels import step

                state = (array(tensor).reshape(-1) for tensor in (leaf, leaf.grad, mean, square))
                step(*state, *map(array(leaf).dtype.type, (first, second, length, spread, _EPSILON)))
                torch.autograd.graph.increment_version(leaf)
            else:
                mean.lerp_(leaf.grad, 1 - first)
                square.mul_(second).addcmul_(leaf.grad, leaf.grad, value=1 - second)
                leaf.addcdiv_(mean, square.sqrt().div_(spread).add_(_EPSILON), value=-length)


# Which rows of the canvas an iteration looks at: what a stroke does to one row, it does to the next one as well.
#
# Rendering takes time in proportion to the rows that strokes cross. The mean squared error of some rows estimates
# that of
# all, and the mean over the turns is the whole, with its gradient. docs/lab/planning.md says what is lost and won.

_ROWS_TO_A_MARK = 32  # in the rectangle that holds every mark of the brush


def interlaced(scenes: list[Scene]) -> list[list[Scene]]:
    """What iterations see in turn, each time the scenes of all parts with the same rows; together they have all rows.

    Where all rows are needed, that is the scenes alone. Rows are at most a 32nd of the height of the rectangle that
    holds the marks of any of the brushes apart, or of the canvas's where that is less. So how many turns there are
    follows from the brushes and from the resolution.
    """
    every = min(_rows_apart(scene) for scene in scenes)
    if every == 1:
        return [scenes]
    turns = (Rows(every, first) for first in range(every))
    return [[_on_rows(scene, rows) for scene in scenes] for rows in turns]


def _on_rows(scene: Scene, rows: Rows) -> Scene:
    """The scene with those rows only."""
    assert scene.objective_on_rows is not None
    return replace(scene, objective=scene.objective_on_rows(rows), rows=rows)


def _rows_apart(scene: Scene) -> int:
    """How many rows farther the next one is that has to be looked at."""
    if scene.objective_on_rows is None:
        return 1
    _, pitch = PixelGrid(scene.size, *scene.canvas.shape[1:]).pitch
    mark = scene.model.frame.top - scene.model.frame.bottom
    return max(1, int(min(mark, scene.size.height) / _ROWS_TO_A_MARK / pitch))


# Strokes of several brushes, each brush's laid over those of the one before: their picture and their loss.
#
# Every part of the strokes has a scene, with its brush, on the canvas of the first.


def stacked_moments(
    strokes: Sequence[Strokes], scenes: Sequence[Scene], marks: Sequence[Marks] | None = None
) -> Moments:
    """Mean [3, H, W] and variance [H, W] of the picture after strokes of several brushes, each over the one before.

    scenes: one for each part, with its brush, on the canvas of the first; marks: those of each part's strokes, to
    differentiate in, by default what its stroke model says.
    """
    mean = scenes[0].rows.of(scenes[0].canvas)
    variance = torch.zeros_like(mean[0])
    for number, (part, scene) in enumerate(zip(strokes, scenes, strict=True)):
        if len(part) == 0:
            continue
        laid = scene.marks(part) if marks is None else marks[number]
        mean, variance = composite_moments(*laid, part.color, mean, scene.spread, variance, bare_cells_answer=False)
    return Moments(mean, variance)


def stacked_loss(strokes: Sequence[Strokes], scenes: Sequence[Scene], objective: Objective | None = None) -> Tensor:
    """What the objective (default: that of the first scene) says on average of paintings of the strokes."""
    if len(scenes) == 1:
        return scenes[0].expected_loss(strokes[0], objective)
    return (objective or scenes[0].objective)(*stacked_moments(strokes, scenes))


def stacked_cost(strokes: Sequence[Strokes], scenes: Sequence[Scene], objective: Objective | None = None) -> Tensor:
    """That, and what the paint costs: every dip takes time, and paint that is hardly seen wins little.

    The price is a share of the loss, for a decibel is worth as much in a dark picture as in a light one.
    """
    loss = stacked_loss(strokes, scenes, objective)
    if all(scene.paint_price == 0 for scene in scenes):
        return loss
    return loss * (1 + sum(scene.paint_cost(part) for part, scene in zip(strokes, scenes, strict=True)))


_MOST_FAILURES = 3
_WARMING = 6
_BETAS = (0.9, 0.98)
_BETWEEN_VALIDATIONS = 10  # iterations
_READ_TOGETHER = 8  # iterations of a GPU, which would stand still at each reading


@dataclass(frozen=True)
class Step:
    """One iteration that was made: its number, of how many, the loss before it, and the strokes as they stood then.

    The loss is that of the rows that the iteration looked at. laid: what is on the canvas by then, each brush and its
    strokes in painting order, for whoever wants to watch the plan grow.
    """

    iteration: int
    of: int
    loss: float
    laid: tuple[tuple[str, Strokes], ...] = ()

    @property
    def parts(self) -> tuple[tuple[str, Strokes], ...]:
        """All strokes as they stand, on the CPU."""
        return tuple((brush, strokes.to("cpu")) for brush, strokes in self.laid)


@dataclass(frozen=True)
class StrokesInScene:
    """Strokes of one brush, in painting order, that are optimised in a scene.

    With `paints` every colour is one of the palette's, throughout; `vary_colors` says whether the palette (or, without
    one, each stroke's colour) may change.
    """

    strokes: Strokes
    scene: Scene
    paints: Paints | None = None
    vary_colors: bool = True


def optimize(
    strokes: Strokes,
    scene: Scene,
    *,
    iterations: int,
    paints: Paints | None = None,
    vary_colors: bool = True,
    light_to_dark: bool = True,
    pace: float = 1.0,
    notify: Callable[[Step], None] = lambda step: None,
) -> tuple[Strokes, Paints | None]:
    """The strokes (in painting order) and paints that do better on the scene's objective, as `optimize_together`."""
    (found,) = optimize_together(
        [StrokesInScene(strokes, scene, paints, vary_colors)],
        iterations=iterations,
        light_to_dark=light_to_dark,
        pace=pace,
        notify=notify,
    )
    return found.strokes, found.paints


def optimize_together(
    parts: Sequence[StrokesInScene],
    *,
    iterations: int,
    light_to_dark: bool = True,
    pace: float = 1.0,
    notify: Callable[[Step], None] = lambda step: None,
) -> list[StrokesInScene]:
    """The parts, each laid over the one before, that together do better on the objective of the first one's scene.

    `pace` scales the steps. Iterations look at some rows of the canvas in turn where that is enough
    (interlace.py), and at all of them at the beginning and at the end. The best strokes of which all rows
    were looked at are returned, never worse than those given: by the objective or, where the scene has one,
    by its validation objective, asked every ten iterations. A step that is not finite is discarded, and steps
    are halved from then on; the third raises PlanningDiverged, and so does a loss that was never finite. On a
    GPU `notify` hears of several steps at once, and so late a step is discarded.
    """
    working = [part for part in parts if len(part.strokes)]
    if not working:
        return list(parts)
    variables = [
        Variables(part.strokes, part.paints, vary_colors=part.vary_colors, light_to_dark=light_to_dark)
        for part in working
    ]
    leaves = [leaf for each in variables for leaf in each.leaves]
    scenes = [part.scene for part in working]
    brushes = [scene.model.brush for scene in scenes]
    adam = Adam(leaves, _BETAS)
    best = _Best(variables)
    readings = _Readings(1 if leaves[0].device.type == "cpu" else _READ_TOGETHER)
    turns = interlaced(scenes)
    validation = scenes[0].validation
    failures = 0
    for iteration in range(iterations + 1):
        current = [each.strokes(each.order()) for each in variables]
        seen = scenes if iteration in (0, iterations) else turns[iteration % len(turns)]
        with torch.set_grad_enabled(iteration < iterations):
            loss = stacked_cost(current, seen)
        if validation is None:
            if seen is scenes:  # losses of other rows differ by what is wanted there
                best.consider(loss, variables)
        elif iteration % _BETWEEN_VALIDATIONS == 0 or iteration == iterations:
            with torch.no_grad():
                best.consider(stacked_cost(current, scenes, validation), variables)
        if iteration == iterations:
            break
        adam.forget_gradients()
        torch.autograd.backward(loss)
        laid = tuple((brush, strokes.detach()) for brush, strokes in zip(brushes, current, strict=True))
        readings.add(_Reading(iteration, loss.detach(), _made_sound(loss, leaves), laid))
        adam.step(pace * 0.5**failures * _rhythm(iteration, iterations))
        for each, scene in zip(variables, scenes, strict=True):
            each.bring_inside(scene.limits, scene.size, scene.in_paint)
        if not readings.full and iteration + 1 < iterations:
            continue
        heard, failed, least = readings.read(best.loss)
        for step in heard:
            notify(Step(step.iteration + 1, iterations, step.value, step.laid))
        if failed is not None:
            failures += 1
            if failures == _MOST_FAILURES or not math.isfinite(least):
                raise PlanningDiverged(
                    f"The loss or its slope was not finite in iteration {failed.iteration}, for the {failures}. time "
                    f"(the loss was {failed.value:g}); try another seed (--seed), or another picture."
                )
            best.restore(variables)
            adam = Adam(leaves, _BETAS)
    best.restore(variables)
    done = iter(zip(working, variables, strict=True))
    return [_in_order(*next(done)) if len(part.strokes) else part for part in parts]


def _in_order(part: StrokesInScene, variables: Variables) -> StrokesInScene:
    """The part with what was found, in painting order."""
    order = variables.order()
    found = variables.paints()
    if found is not None:
        found = replace(found, paint=found.paint[order])
    return replace(part, strokes=variables.strokes().detach()[order], paints=found)


def _rhythm(iteration: int, iterations: int) -> float:
    """Steps grow over the first iterations and then shrink along a half cosine to a tenth.

    Adam's first steps have the same size however small the slope is: taken in full, they would
    throw a settled plan back.
    """
    warm = min(1.0, (iteration + 1) / _WARMING)
    return warm * (0.1 + 0.45 * (1 + math.cos(math.pi * iteration / iterations)))


def _made_sound(loss: Tensor, leaves: list[Tensor]) -> Tensor:
    """Whether the loss and its slope are finite, one bool on their device; where they are not, the slope becomes 0."""
    if any(leaf.grad is None for leaf in leaves):
        return torch.zeros_like(loss, dtype=torch.bool)
    slopes = [leaf.grad for leaf in leaves if leaf.grad is not None]
    sound = torch.stack([loss.detach(), *(slope.sum() for slope in slopes)]).isfinite().all()  # one spoils a sum
    for leaf, slope in zip(leaves, slopes, strict=True):
        leaf.grad = torch.where(sound, slope, 0)
    return sound


@dataclass(frozen=True)
class _Reading:
    """An iteration: its loss and whether it was sound, on the device, its strokes; value: the loss, once read."""

    iteration: int
    loss: Tensor
    sound: Tensor
    laid: tuple[tuple[str, Strokes], ...]
    value: float = math.nan


class _Readings:
    """Iterations whose losses are still on the device; as many are read together as are given."""

    def __init__(self, together: int) -> None:
        self._together = together
        self._waiting: list[_Reading] = []

    @property
    def full(self) -> bool:
        """Whether it is time to read."""
        return len(self._waiting) >= self._together

    def add(self, reading: _Reading) -> None:
        """One more that waits."""
        self._waiting.append(reading)

    def read(self, least: Tensor) -> tuple[list[_Reading], _Reading | None, float]:
        """Those that waited up to the first that was not sound, that one, and the least loss: in one transfer."""
        waiting, self._waiting = self._waiting, []
        numbers = [part.to(least) for one in waiting for part in (one.loss, one.sound)]
        found, *values = torch.stack([least, *numbers]).tolist()
        heard: list[_Reading] = []
        for reading, value, sound in zip(waiting, values[::2], values[1::2], strict=True):
            if not sound:
                return heard, replace(reading, value=value), found
            heard.append(replace(reading, value=value))
        return heard, None, found


class _Best:
    """The best variables seen, kept on their device to be returned whatever happens later."""

    def __init__(self, variables: Sequence[Variables]) -> None:
        self.loss = variables[0].shape.new_full((), math.inf)
        self._kept = [(each.shape.detach().clone(), each.color.detach().clone()) for each in variables]

    def consider(self, loss: Tensor, variables: Sequence[Variables]) -> None:
        """Keeps the variables where the loss is less than any before."""
        loss = loss.detach().to(self.loss)
        better = loss < self.loss
        self.loss = torch.where(better, loss, self.loss)
        self._kept = [
            (torch.where(better, each.shape.detach(), shape), torch.where(better, each.color.detach(), color))
            for each, (shape, color) in zip(variables, self._kept, strict=True)
        ]

    def restore(self, variables: Sequence[Variables]) -> None:
        """Sets the variables to the best."""
        with torch.no_grad():
            for each, (shape, color) in zip(variables, self._kept, strict=True):
                each.shape.copy_(shape)
                each.color.copy_(color)
