"""The goal: what a person wants to see on the canvas, as weighted terms."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self

from frida_painter.errors import ConfigError

if TYPE_CHECKING:  # kinds of goals are known, and asked for, where nothing is planned
    import torch
    from torch import Tensor

    from frida_painter.objectives.objective import ObjectiveContext, ObjectiveTerm


class Term(ABC):
    """One thing that is wanted, and how much it matters: `weight` > 0. Pictures are [3, H, W] in [0, 1].

    Every kind of goal has its own, a frozen dataclass that says all of itself (objectives/kinds/). Terms of
    different kinds know of each other only what the properties below say. Only `prepare` has to be written:
    the rest says, if nothing else is said, that the term has neither picture nor words.

    initial_order: a plan begins with the terms whose number is least; None: only where no term has a number.
    interpretation_order: the terms' `interpret` are called by this number, the least first.
    """

    weight: float
    initial_order: ClassVar[int | None] = None
    interpretation_order: ClassVar[int] = 100

    @abstractmethod
    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """The objective of this term. What can be computed once is computed here. Raises WeightsError."""

    @property
    def picture(self) -> Tensor | None:
        """The picture to paint: it says what is where, and in which colours."""
        return None

    @property
    def is_pixelwise(self) -> bool:
        """Whether the picture to paint is compared pixel by pixel: drawings beside it are drawn on it then."""
        return False

    @property
    def drawing(self) -> Tensor | None:
        """Dark lines on white paper that say what is where, and nothing of colours."""
        return None

    @property
    def colors(self) -> Tensor | None:
        """A picture that says which colours are wanted, and nothing of what is where."""
        return None

    @property
    def brushwork(self) -> Tensor | None:
        """A picture whose marks say which way strokes go where the picture to paint does not."""
        return None

    @property
    def words(self) -> str | None:
        """Words that say what is wanted."""
        return None

    @property
    def guide(self) -> Tensor | None:
        """The picture towards which strokes are placed where a plan begins with this term: the picture to paint."""
        return self.picture

    @property
    def importance(self) -> Tensor | None:
        """How much each place of the guide matters, [h, w], 1 in the mean; None: all the same."""
        return None

    def begun(self, goal: Goal) -> Term:
        """What a plan of that goal begins with where it begins with this term."""
        return self

    def with_picture(self, picture: Tensor) -> Term:
        """The term with another picture to paint."""
        return self

    def on_picture(self, picture: Tensor) -> Term:
        """The term, whose drawing was drawn on that picture."""
        return self

    def fitted(self, rows: int, columns: int, *, pad: bool = False) -> Term:
        """The term with each picture that is to fill the canvas as it fills so many rows and columns.

        pad: whether all of a picture of other proportions is shown, on white; else its middle is.
        """
        return self

    def to(self, device: torch.device) -> Self:
        """The term with its pictures on that device."""
        from torch import Tensor

        this: Any = self
        pictures = {name: part.to(device) for name, part in vars(self).items() if isinstance(part, Tensor)}
        return replace(this, **pictures) if pictures else this

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """The goal as it is pursued, where terms of this kind are in it and change what others ask for."""
        return goal


@dataclass(frozen=True)
class Goal:
    """One or more terms that are pursued together. Raises ConfigError where there is none.

    initial: terms that are pursued first, so that their composition stays (paper, Algorithm 1). A style among them is
    begun with as the picture that it is.
    """

    terms: tuple[Term, ...]
    initial: tuple[Term, ...] = ()

    def __post_init__(self) -> None:
        if not self.terms:
            raise ConfigError("A goal without any term was given; name at least one picture or some words to paint.")

    def to(self, device: torch.device) -> Self:
        """The goal with its pictures on that device."""
        return replace(
            self,
            terms=tuple(term.to(device) for term in self.terms),
            initial=tuple(term.to(device) for term in self.initial),
        )

    def fitted(self, rows: int, columns: int, *, pad: bool = False) -> Self:
        """The goal with the pictures that are to fill the canvas as they fill so many rows and columns."""
        return replace(
            self,
            terms=tuple(term.fitted(rows, columns, pad=pad) for term in self.terms),
            initial=tuple(term.fitted(rows, columns, pad=pad) for term in self.initial),
        )

    @cached_property
    def initial_terms(self) -> tuple[Term, ...]:
        """What a plan begins with: the initial terms, or those of least `initial_order`, or else all.

        These are the goal's own terms, and the same tuple, where it has nothing but pictures to come near to.
        """
        if self.initial:
            return tuple(term.begun(self) for term in self.initial)
        orders = [term.initial_order for term in self.terms if term.initial_order is not None]
        if not orders:
            return self.terms
        begun = tuple(term.begun(self) for term in self.terms if term.initial_order == min(orders))
        same = len(begun) == len(self.terms) and all(map(lambda one, other: one is other, begun, self.terms))
        return self.terms if same else begun


def require_weight(weight: float, what: str) -> None:
    """Raises ConfigError unless the weight, which was given to `what`, is above 0 and finite."""
    if not 0 < weight < math.inf:
        raise ConfigError(f"A weight of {weight} was given to {what}; weights are above 0 and finite.")
