"""From a goal to one objective: what a person said is interpreted, its terms are prepared and weighed."""

import math
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.frames import PixelGrid, Rows
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.objective import Goal, Objective, ObjectiveContext, ObjectiveTerm

_INSISTENCE = 4.0  # times as much as else, what makes a painting less recognisable than its beginning counts


def interpreted(goal: Goal, grid: PixelGrid, encoders: EncoderRegistry, seed: int, sharpness: float = 0.0) -> Goal:
    """The goal as it is pursued on pictures of that grid: each kind of term in it is asked once, in their order.

    Sketches are drawn on the photograph they came with, words get a picture to begin with, what is painted in
    a style is wanted in its colours, what is painted by its meaning is attended to where its meaning is, and
    photographs alone are wanted with that sharpness (objectives/pixel_loss.py).
    Raises WeightsError where a network is missing.
    """
    context = ObjectiveContext(grid, encoders, seed, sharpness=sharpness)
    kinds = {type(term) for term in (*goal.terms, *goal.initial)}
    for kind in sorted(kinds, key=lambda kind: (kind.interpretation_order, kind.__qualname__)):
        goal = kind.interpret(goal, context)
    return goal


class WeightedObjective:
    """The weighted sum of a goal's terms (paper, Eq. for p_next): itself an objective.

    begun [3, H, W]: the picture that a painting of words begins with. As long as a painting is less recognisable than
    that, by the terms that recognise, its validation insists on it.
    """

    def __init__(self, terms: Sequence[tuple[float, ObjectiveTerm]], begun: Tensor | None = None) -> None:
        self._terms = tuple(terms)
        self._begun = begun
        self._limit = math.inf
        if begun is not None and any(term.recognizes for _, term in terms):
            with torch.no_grad():
                self._limit = float(self.recognition(begun))

    def __call__(self, picture: Tensor, variance: Tensor | None = None) -> Tensor:
        """picture [3, H, W], variance [H, W] -> a number, the less the better; differentiable."""
        total = picture.new_zeros(())
        for weight, term in self._terms:
            total = total + weight * (term.objective(picture) + _of_variance(term, variance))
        return total

    @property
    def validation(self) -> Objective | None:
        """What says which of several pictures is best; None where the sum itself says it."""
        return self._validation if any(term.validation is not None for _, term in self._terms) else None

    @property
    def on_rows(self) -> Callable[[Rows], Objective] | None:
        """The sum for pictures that have some rows of the grid only; None where a term has to see all of them."""
        makers = [(weight, term.on_rows) for weight, term in self._terms if term.on_rows is not None]
        if len(makers) < len(self._terms):
            return None
        return lambda rows: WeightedObjective([(weight, make(rows)) for weight, make in makers])

    def recognition(self, picture: Tensor) -> Tensor:
        """How far a picture [3, H, W] is from being recognised as what is meant; 0 where nothing says it."""
        return self._validated(picture, None)[1]

    def _validation(self, picture: Tensor, variance: Tensor | None = None) -> Tensor:
        total, recognition = self._validated(picture, variance)
        return total + _INSISTENCE * (recognition - self._limit).clamp(min=0)

    def _validated(self, picture: Tensor, variance: Tensor | None) -> tuple[Tensor, Tensor]:
        """What the terms' validations say together, and those of them that recognise."""
        total = recognition = picture.new_zeros(())
        for weight, term in self._terms:
            value = weight * ((term.validation or term.objective)(picture) + _of_variance(term, variance))
            total = total + value
            if term.recognizes:
                recognition = recognition + value
        return total, recognition


def _of_variance(term: ObjectiveTerm, variance: Tensor | None) -> Tensor | float:
    return 0.0 if variance is None or term.of_variance is None else term.of_variance(variance)


def prepare(goal: Goal, grid: PixelGrid, encoders: EncoderRegistry | None = None, seed: int = 0) -> WeightedObjective:
    """The objective of the goal for pictures of that grid.

    encoders: the networks that terms other than pictures are seen through; by default those that
    were fetched. Raises WeightsError where one is missing.
    """
    picture = next((term.picture for term in goal.initial if term.picture is not None), None)
    begun = None if picture is None else images.fit(picture, grid.rows, grid.columns)
    context = ObjectiveContext(grid, encoders or EncoderRegistry(), seed, begun)
    return WeightedObjective([(term.weight, term.prepare(context)) for term in goal.terms], begun)
