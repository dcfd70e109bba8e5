"""What an objective is, and what the objectives of a painting are prepared for."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

from frida_painter.errors import ConfigError, FridaError
from frida_painter.registry import OBJECTIVES, parts

if TYPE_CHECKING:
    import torch
    from torch import Tensor

    from frida_painter.frames import PixelGrid, Rows
    from frida_painter.objectives.encoders.registry import EncoderRegistry


# The goal: what a person wants to see on the canvas, as weighted terms.


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


# What a kind of goal says of itself to whoever asks people for goals.

_NAME = re.compile("[a-z][a-z0-9_]{0,29}")
_TAKEN = ("goal", "initial", "photo", "weight", "clip", "pictures")


class Gives(Enum):
    """What a person gives for a goal; the value is how help pages call it."""

    PICTURE = "FILE"
    WORDS = "WORDS"


@dataclass(frozen=True)
class GoalKind:
    """One kind of goal. Its file, objectives/kinds/NAME.py or one of somebody's own, says all that there is to say.

    name: of the option --NAME, of its weight's --NAME-weight, and of the key in goal files: small letters, digits, _;
    gives: a picture's file or words; help: of the option, one sentence; label: what records call such a goal;
    open: the file or the words, and the weight, to a term; raises ConfigError and ImageError for what makes none;
    begin: the same for what a painting only begins with; None: as `open` with a weight of 1;
    initial_help: of the option --init-NAME; "": there is none (goal files may still begin with this kind);
    networks: groups of names of weights, of each of which one must have been fetched, best first.
    Raises ConfigError for a name that cannot be.
    """

    name: str
    gives: Gives
    help: str
    label: str
    open: Callable[[Any, float], Term]
    begin: Callable[[Any], Term] | None = None
    initial_help: str = ""
    networks: tuple[tuple[str, ...], ...] = ()

    def __post_init__(self) -> None:
        free = self.name not in _TAKEN and not self.name.startswith("init_") and not self.name.endswith("_weight")
        if not _NAME.fullmatch(self.name) or not free:
            raise ConfigError(
                f"A kind of goal was called {self.name[:40]!r}; a name has up to 30 small letters, digits and _, does "
                f"not begin with init_ or end with _weight, and is none of {', '.join(_TAKEN)}."
            )

    @property
    def option(self) -> str:
        """The option of the command line."""
        return f"--{self.name.replace('_', '-')}"

    @property
    def initial_option(self) -> str:
        """The option for what a painting begins with."""
        return f"--init-{self.name.replace('_', '-')}"

    def opened(self, value: Any, weight: float, *, beginning: bool) -> Term:
        """The term of a file or of words. Raises ConfigError, which names the option, and ImageError."""
        try:
            if not beginning:
                return self.open(value, weight)
            return self.open(value, 1.0) if self.begin is None else self.begin(value)
        except ConfigError as error:
            option = self.initial_option if beginning else self.option
            raise ConfigError(f"{option} {str(value)[:60]}: {error}") from error


@dataclass(frozen=True)
class KnownKinds:
    """The kinds of goals by their names, the project's own first; complaints: a sentence for each that was left out."""

    by_name: Mapping[str, GoalKind]
    complaints: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> GoalKind:
        """The kind of that name. Raises ConfigError where there is none."""
        if name not in self.by_name:
            raise ConfigError(f"There is no kind of goal called {name[:40]!r}; there are {', '.join(self.by_name)}.")
        return self.by_name[name]


@cache
def goal_kinds() -> KnownKinds:
    """The kinds of goals. Neither networks nor PyTorch are loaded for it.

    A kind of another package that cannot be loaded, or whose name is taken, is left out with a complaint.
    """
    known: dict[str, GoalKind] = {}
    complaints: list[str] = []
    for name, part in parts(OBJECTIVES).items():
        try:
            known[name] = part.load(GoalKind)
        except FridaError as error:
            complaints.append(f"A kind of goal is left out: {error}")
    return KnownKinds(known, tuple(complaints))


class Objective(Protocol):
    """Judges a picture of the canvas: the less, the nearer to the goal. Differentiable."""

    def __call__(self, picture: Tensor, variance: Tensor | None = None) -> Tensor:
        """picture [3, H, W] in [0, 1] -> a number.

        variance [H, W]: of the pixels about the picture, which then is the mean of what may come; what is
        judged is the expectation, as far as the goal can tell it.
        """


@dataclass(frozen=True)
class ObjectiveContext:
    """What objectives are prepared for: the pictures' grid, the networks at hand, the run's seed.

    begun [3, H, W]: the picture of that grid that a painting begins with, where the goal has one beside its terms.
    sharpness: how much sharper than its photographs a painting is planned (objectives/pixel_loss.py).
    """

    grid: PixelGrid
    encoders: EncoderRegistry
    seed: int
    begun: Tensor | None = None
    sharpness: float = 0.0


@dataclass(frozen=True)
class ObjectiveTerm:
    """One term, ready to judge pictures.

    validation: where the objective looks at a picture in another way every time, or could be fooled,
    what says in the end whether a picture is good: steady, and best by a network kept aside.
    of_variance: what pixels that vary by so much [H, W] about a picture add to its objective on average, exact for
    squared errors; None where that is not known.
    recognizes: whether the validation says how far a picture is from being recognised as what is meant.
    on_rows: the term for pictures that have some rows of the grid only, where the objective is a mean over pixels; None
    where it is not.
    """

    objective: Callable[[Tensor], Tensor]
    validation: Callable[[Tensor], Tensor] | None = None
    of_variance: Callable[[Tensor], Tensor] | None = None
    recognizes: bool = False
    on_rows: Callable[[Rows], ObjectiveTerm] | None = None
