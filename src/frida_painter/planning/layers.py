"""Layers of a plan that are optimised together, so that one layer can correct what another one leaves.

Each layer is first grown as if it were the last one. Then the strokes of all layers move and descend towards the
picture that all layers make together. A broad brush can so leave details to the finer brushes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from frida_painter.frames import PixelGrid
from frida_painter.planning.optimize import Step, StrokesInScene
from frida_painter.planning.problem import PlanningProblem, PlanningProblems
from frida_painter.planning.refine import HARDLY_APART, MOVED, relocate, without_twins
from frida_painter.planning.variables import Paints, as_palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import Strokes


class StepCount:
    """Count of iterations through all optimisations that make a plan."""

    def __init__(self, notify: Callable[[Step], None], total: int) -> None:
        self._notify, self._total, self._done = notify, total, 0

    def begin(self, iterations: int, below: Sequence[tuple[str, Strokes]] = ()) -> Callable[[Step], None]:
        """Returns the callback for the next `iterations` steps.

        below: each kind of strokes below, with its strokes on the canvas.
        """
        before = self._done
        self._done += iterations

        def tell(step: Step) -> None:
            number = before + step.iteration
            self._notify(replace(step, iteration=number, of=self._total, laid=(*below, *step.laid)))

        return tell


def at_the_end(notify: Callable[[Step], None]) -> Callable[[Step], None]:
    """Returns the callback for a second try, which reports each step as the last one of the total."""
    return lambda step: notify(replace(step, iteration=step.of))


_CLOSED = 0.05  # share of a layer that shows through; below it, the layer's colour does not matter


@dataclass(frozen=True)
class LayerAtWork:
    """Layer that is being planned: its strokes in painting order, and their paints.

    kind: kind of its strokes (`plan.Layer.kind`).
    mixes: True if the paints may still change.
    """

    kind: str
    strokes: Strokes
    paints: Paints
    mixes: bool

    def after(self, found: StrokesInScene) -> Self:
        """Returns the layer with the optimised strokes; paints that may not change stay exactly the same."""
        assert found.paints is not None
        paints = found.paints if self.mixes else replace(found.paints, color=self.paints.color)
        return replace(self, strokes=found.strokes, paints=paints)

    def with_paints_in_order(self) -> Self:
        """Returns the layer with its paints and its strokes from light to dark; nearly equal paints are merged."""
        strokes, palette, paint = as_palette(self.strokes, without_twins(self.paints, HARDLY_APART))
        return replace(self, strokes=strokes, paints=Paints(palette.color, paint))


def find_later_mixing(rest: Plan, new_paints: bool, *, fresh: bool) -> list[bool]:
    """Returns a bool for each layer that has strokes: True if its paints are its own and are not mixed yet.

    rest: part of the plan that is not painted.
    new_paints: True if layers have palettes of their own.
    fresh: True if the layer of the next stroke begins now.
    """
    now, wells = int(rest.layer[0]), [layer.paints for layer in rest.layers]
    return [
        new_paints and (number > now or (fresh and number == now > 0)) and wells.count(layer.paints) == 1
        for number, layer in enumerate(rest.layers)
        if layer.strokes
    ]


@dataclass(frozen=True)
class Moves:
    """Rounds in which strokes move to better places.

    rounds: number of rounds.
    generator: source of random places. None: strokes do not move to other places.
    share: greatest share of each layer's strokes that moves in a round.
    """

    rounds: int = 0
    generator: torch.Generator | None = None
    share: float = MOVED


def relocate_strokes(
    layers: Sequence[LayerAtWork],
    canvas: Tensor,
    problems: PlanningProblems,
    grid: PixelGrid,
    share: float,
    generator: torch.Generator,
) -> list[LayerAtWork]:
    """Returns the layers after some strokes of each moved to places of a larger gain, one layer after another."""
    found, below = list(layers), canvas
    for number, layer in enumerate(found):
        problem = problems.of(below, grid, layer.kind)
        guide = problems.guide(problem)
        if guide is None:
            return found
        above = [(later.strokes, problems.of(canvas, grid, later.kind)) for later in found[number + 1 :]]
        seen, wanted = beneath(above, layer.strokes, problem, guide)
        strokes, paints = relocate(layer.strokes, layer.paints, seen, wanted, share, generator)
        assert paints is not None
        found[number] = replace(layer, strokes=strokes, paints=paints)
        below = problem.render(found[number].strokes).detach()
    return found


@torch.no_grad()
def beneath(
    above: Sequence[tuple[Strokes, PlanningProblem]], strokes: Strokes, problem: PlanningProblem, target: Tensor
) -> tuple[PlanningProblem, Tensor]:
    """Returns the scene and the target [3, H, W] of a layer below other layers.

    above: strokes of each later layer, with a scene of its brush.

    The layers above let through a share t of the picture below, and add a. They turn the layer's picture p into t p
    + a, and (t p + a - target)^2 is t^2 (p - (target - a) / t)^2. So each error counts by t^2 and is measured from
    (target - a) / t. If t is almost 0, the target is the layer's own picture.
    """
    if not above:
        return problem, target
    added, through = torch.zeros_like(problem.canvas), torch.ones_like(problem.canvas)
    for laid, on in above:
        added, through = (replace(on, canvas=picture).render(laid) for picture in (added, through))
    share = (through - added)[0].clamp(0, 1)  # [H, W]
    wanted = torch.where(share > _CLOSED, (target - added) / share.clamp(min=_CLOSED), problem.render(strokes))
    matters = share.square() if problem.wishes.importance is None else share.square() * problem.wishes.importance
    return replace(problem, wishes=replace(problem.wishes, importance=matters)), wanted
