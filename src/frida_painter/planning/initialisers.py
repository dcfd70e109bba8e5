"""Initialisers: ways to place the first strokes of a layer, of this and other packages."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from frida_painter import registry
from frida_painter.errors import ConfigError, PluginError
from frida_painter.palette import to_lab
from frida_painter.planning.initialize import Growth, optimize_target, progressive, uniform
from frida_painter.planning.optimize import Step
from frida_painter.planning.problem import PlanningProblem
from frida_painter.strokes import Strokes


@dataclass(frozen=True)
class InitialTask:
    """Task of an initialiser: the first strokes of a layer, before anything is optimised.

    count: number of strokes
    problem: canvas picture [3, H, W] and its size, brush and objective
    guide [3, H, W]: picture to paint; None for goals without a picture
    generator: for every random choice
    growth: usual rounds of growth
    notify: called after each step of an optimisation; may raise to end it
    """

    count: int
    problem: PlanningProblem
    guide: Tensor | None
    generator: torch.Generator
    growth: Growth
    notify: Callable[[Step], None]

    @property
    def target(self) -> Tensor:
        """Picture that shows where strokes are needed: the guide, or one that lowers the objective."""
        return optimize_target(self.problem) if self.guide is None else self.guide


@dataclass(frozen=True)
class InitialiserKind:
    """Way to place the first strokes of a layer.

    name: as in `--initialiser NAME`
    help: one sentence
    place: returns `count` strokes; they are projected to the limits and ordered from light to dark afterwards
    """

    name: str
    help: str
    place: Callable[[InitialTask], Strokes]

    def begin(self, task: InitialTask) -> Strokes:
        """Returns the strokes, as the optimiser takes them. Raises PluginError if they are not what was asked for."""
        found = self.place(task)
        if not isinstance(found, Strokes) or len(found) != task.count:
            told = f"{len(found)} strokes" if isinstance(found, Strokes) else f"a {type(found).__name__}"
            raise PluginError(f"The initialiser {self.name!r} returned {told} for {task.count} strokes; mend it.")
        if not all(bool(part.isfinite().all()) for part in found.arrays().values()):
            raise PluginError(f"The initialiser {self.name!r} returned a number that is not finite; mend it.")
        found = found.to(task.problem.canvas.device).project(task.problem.limits, task.problem.size)
        return found[torch.argsort(to_lab(found.color)[:, 0], descending=True, stable=True)]


def _grow(task: InitialTask) -> Strokes:
    """Returns strokes that were grown in rounds, at the largest errors."""
    found, _ = progressive(
        task.count,
        task.problem,
        task.target,
        paints=None,
        light_to_dark=True,
        growth=task.growth,
        generator=task.generator,
        notify=task.notify,
    )
    return found


def _scatter(task: InitialTask) -> Strokes:
    """Returns strokes of random places and shapes in the colours of the target, as the paper begins."""
    size, target = task.problem.size, task.target
    found = uniform(task.count, task.problem.limits, size, task.generator)
    middle = found.path(torch.tensor([0.5]))[:, 0] / torch.tensor([size.width, size.height])
    rows, columns = target.shape[1:]
    column = (middle[:, 0] * columns).long().clamp(0, columns - 1)
    row = ((1 - middle[:, 1]) * rows).long().clamp(0, rows - 1)
    return found.with_groups(color=target.cpu()[:, row, column].T.contiguous())


GROWTH = InitialiserKind("growth", "Strokes grow in rounds, where the error is largest.", _grow)
UNIFORM = InitialiserKind("uniform", "Strokes of random places and shapes, as in the paper.", _scatter)


def find_initialiser(name: str) -> InitialiserKind:
    """Returns the initialiser of that name. Raises ConfigError if there is none, PluginError if it is broken."""
    known = registry.parts(registry.INITIALISERS)
    if name not in known:
        raise ConfigError(f"There is no initialiser called {name[:40]!r}; there are {', '.join(known)}.")
    return known[name].load(InitialiserKind)
