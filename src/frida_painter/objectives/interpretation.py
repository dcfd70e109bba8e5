"""From a goal to one objective: what a person said is interpreted, its terms are prepared and weighed."""

from collections.abc import Callable, Sequence

from torch import Tensor

from frida_painter.frames import PixelGrid
from frida_painter.goal import Goal
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.objective import Objective, ObjectiveContext, ObjectiveTerm


def interpreted(goal: Goal, grid: PixelGrid, encoders: EncoderRegistry, seed: int) -> Goal:
    """The goal as it is pursued on pictures of that grid: each kind of term in it is asked once, in their order.

    Sketches are drawn on the photograph they came with, words get a picture to begin with, what is painted in
    a style is wanted in its colours, and what is painted by its meaning is attended to where its meaning is.
    Raises WeightsError where a network is missing.
    """
    context = ObjectiveContext(grid, encoders, seed)
    kinds = {type(term) for term in (*goal.terms, *goal.initial)}
    for kind in sorted(kinds, key=lambda kind: (kind.interpretation_order, kind.__qualname__)):
        goal = kind.interpret(goal, context)
    return goal


class WeightedObjective:
    """The weighted sum of a goal's terms (paper, Eq. for p_next): itself an objective."""

    def __init__(self, terms: Sequence[tuple[float, ObjectiveTerm]]) -> None:
        self._terms = tuple(terms)

    def __call__(self, picture: Tensor, variance: Tensor | None = None) -> Tensor:
        """picture, variance [3, H, W] -> a number, the less the better; differentiable."""
        return self._sum([term.objective for _, term in self._terms], picture, variance)

    @property
    def validation(self) -> Objective | None:
        """What says which of several pictures is best; None where the sum itself says it."""
        return self._validation if any(term.validation is not None for _, term in self._terms) else None

    def _validation(self, picture: Tensor, variance: Tensor | None = None) -> Tensor:
        return self._sum([term.validation or term.objective for _, term in self._terms], picture, variance)

    def _sum(self, judges: list[Callable[[Tensor], Tensor]], picture: Tensor, variance: Tensor | None) -> Tensor:
        total = picture.new_zeros(())
        for (weight, term), judge in zip(self._terms, judges, strict=True):
            total = total + weight * judge(picture)
            if variance is not None and term.of_variance is not None:
                total = total + weight * term.of_variance(variance)
        return total


def prepare(goal: Goal, grid: PixelGrid, encoders: EncoderRegistry | None = None, seed: int = 0) -> WeightedObjective:
    """The objective of the goal for pictures of that grid.

    encoders: the networks that terms other than pictures are seen through; by default those that
    were fetched. Raises WeightsError where one is missing.
    """
    context = ObjectiveContext(grid, encoders or EncoderRegistry(), seed)
    return WeightedObjective([(term.weight, term.prepare(context)) for term in goal.terms])
