"""Conversion of a goal to one objective: interpretation of the terms, preparation, weighted sum."""

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid, Rows
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.objective import (
    CanvasLoss,
    Goal,
    ObjectiveContext,
    ObjectiveTerm,
    Sparing,
    Term,
    require_objective,
)
from frida_painter.system import images

_INSISTENCE = 4.0  # weight of a recognition that is worse than that of the beginning


def interpret_goal(goal: Goal, grid: PixelGrid, encoders: EncoderRegistry, seed: int) -> Goal:
    """Returns the goal after interpretation: each kind of term may change the other terms, in a fixed order.

    Sketches are drawn on their photographs. Words get a first picture. Pictures with a style term get the
    colours of the style. Pictures with a semantic term get importance maps. Photographs without other terms are
    sharpened. Raises WeightsError if a network is missing.
    """
    context = ObjectiveContext(grid, encoders, seed)
    kinds = {type(term) for term in (*goal.terms, *goal.initial)}
    for kind in sorted(kinds, key=lambda kind: (kind.interpretation_order, kind.__qualname__)):
        goal = kind.interpret(goal, context)
    return goal


class WeightedObjective:
    """Objective that is the weighted sum of a goal's terms (paper, Eq. for p_next).

    begun [3, H, W]: picture that a painting of words begins with. The validation adds a penalty if the painting
    is less recognisable than this picture. Terms with `recognizes` measure that.
    """

    def __init__(self, terms: Sequence[tuple[float, ObjectiveTerm]], begun: Tensor | None = None) -> None:
        self._terms = tuple(terms)
        self._begun = begun
        self._limit = math.inf
        if begun is not None and any(term.recognizes for _, term in terms):
            with torch.no_grad():
                self._limit = float(self.recognition(begun))

    def __call__(self, picture: Tensor, variance: Tensor | None = None) -> Tensor:
        """Returns the loss of a picture [3, H, W] with pixel variance [H, W]; lower is better. Differentiable."""
        total = picture.new_zeros(())
        for weight, term in self._terms:
            total = total + weight * (term.objective(picture) + _of_variance(term, variance))
        return total

    @property
    def validation(self) -> CanvasLoss | None:
        """Objective that selects the best of several pictures; None if the sum itself does."""
        return self._validation if any(term.validation is not None for _, term in self._terms) else None

    @property
    def on_rows(self) -> Callable[[Rows], CanvasLoss] | None:
        """Maker of the sum for pictures with some rows of the grid only; None if a term needs all rows."""
        makers = [(weight, term.on_rows) for weight, term in self._terms if term.on_rows is not None]
        if len(makers) < len(self._terms):
            return None
        return lambda rows: WeightedObjective([(weight, make(rows)) for weight, make in makers])

    @property
    def sparing(self) -> Callable[[], Sparing] | None:
        """Maker of the same sum for one optimisation, with slow terms computed seldom; None if no term is slow."""
        slow = [term for _, term in self._terms if term.lasts > 1]
        if not slow:
            return None

        def begin() -> Sparing:
            made = _Tangents(self._terms)
            smooth = all(term.smooth for term in slow)
            return Sparing(made.anew, made.between, min(term.lasts for term in slow), smooth)

        return begin

    def recognition(self, picture: Tensor) -> Tensor:
        """Returns how far a picture [3, H, W] is from being recognised as the wish; 0 if no term measures it."""
        return self._validate(picture, None)[1]

    def measure_step(self, picture: Tensor) -> float | None:
        """Returns the seconds that an iteration spends in networks that recognise; None if there is no such network.

        The processor's time of the validation of a picture [3, H, W] is measured, which draws no random number, so the
        plan stays the same.
        """
        slow = [term for _, term in self._terms if term.recognizes]
        seconds = 0.0
        for term in slow:
            began = time.thread_time()
            if term.validation is not None:
                with torch.enable_grad():
                    torch.autograd.grad(term.validation(at := picture.detach().requires_grad_()), at)
            seconds += term.looks * (time.thread_time() - began) / term.lasts
        return seconds if slow else None

    def _validation(self, picture: Tensor, variance: Tensor | None = None) -> Tensor:
        total, recognition = self._validate(picture, variance)
        return total + _INSISTENCE * (recognition - self._limit).clamp(min=0)

    def _validate(self, picture: Tensor, variance: Tensor | None) -> tuple[Tensor, Tensor]:
        """Returns two sums: of the validations of all terms, and of those terms that measure recognition."""
        total = recognition = picture.new_zeros(())
        for weight, term in self._terms:
            value = weight * ((term.validation or term.objective)(picture) + _of_variance(term, variance))
            total = total + value
            if term.recognizes:
                recognition = recognition + value
        return total, recognition


class _Tangents:
    """Weighted sum of terms that keeps the tangent of each slow one: its value and gradient at a picture.

    Slow terms are smooth and strokes move little in a step, so a tangent serves for several steps.
    """

    def __init__(self, terms: Sequence[tuple[float, ObjectiveTerm]]) -> None:
        self._terms = tuple(terms)
        self._slow = [(weight, term) for weight, term in self._terms if term.lasts > 1]
        self._held: tuple[Tensor, Tensor, Tensor] | None = None  # value and gradient of the slow terms, and picture

    def anew(self, picture: Tensor, variance: Tensor | None = None) -> Tensor:
        """Returns the loss of a picture [3, H, W] with pixel variance [H, W]; keeps the tangent there.

        The slow terms have one gradient, so that what they share of a network is passed through once.
        """
        with torch.enable_grad():
            at = picture.detach().requires_grad_()
            value = torch.stack([weight * term.objective(at) for weight, term in self._slow]).sum()
            (slope,) = torch.autograd.grad(value, at)
        self._held = value.detach(), slope, at.detach()
        return self.between(picture, variance)

    def between(self, picture: Tensor, variance: Tensor | None = None) -> Tensor:
        """Returns the same with slow terms as their tangents tell; exact at the picture last given to `anew`."""
        assert self._held is not None, "`anew` comes first"
        value, slope, at = self._held
        total = value + (slope * (picture - at)).sum()
        for weight, term in self._terms:
            loss = 0.0 if term.lasts > 1 else term.objective(picture)
            total = total + weight * (loss + _of_variance(term, variance))
        return total


def _of_variance(term: ObjectiveTerm, variance: Tensor | None) -> Tensor | float:
    return 0.0 if variance is None or term.of_variance is None else term.of_variance(variance)


def prepare(
    goal: Goal,
    grid: PixelGrid,
    encoders: EncoderRegistry | None = None,
    seed: int = 0,
    shared: dict[str, Any] | None = None,
) -> WeightedObjective:
    """Returns the objective of a goal for pictures on `grid`.

    encoders: networks for terms that need them; by default those that were fetched
    shared: what the objectives of several grids have in common, empty at first
    Raises WeightsError if a network is missing, ConfigError if an objective cannot be used.
    """
    picture = next((term.picture for term in goal.initial if term.picture is not None), None)
    begun = None if picture is None else images.fit(picture, grid.rows, grid.columns)
    in_style = any(term.colors is not None for term in goal.terms)
    is_held = any(term.is_pixelwise for term in goal.terms)
    shared = {} if shared is None else shared
    context = ObjectiveContext(
        grid, encoders or EncoderRegistry(), seed, in_style=in_style, is_held=is_held, shared=shared
    )
    return WeightedObjective([(term.weight, _prepare_term(term, context)) for term in goal.terms], begun)


def _prepare_term(term: Term, context: ObjectiveContext) -> ObjectiveTerm:
    """Returns the objective of a term. Raises ConfigError if it is none."""
    made = term.prepare(context)
    if not isinstance(made, ObjectiveTerm):
        raise ConfigError(
            f"{type(term).__name__}.prepare returned a {type(made).__name__}; it returns an ObjectiveTerm."
        )
    if term.is_tried:
        size = context.grid.rows, context.grid.columns, context.encoders.device
        called = getattr(made.objective, "__qualname__", type(made.objective).__name__)
        require_objective(made.objective, f"The objective {called}", *size)
    return made
