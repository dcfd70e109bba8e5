"""Goals, terms and kinds of goals, and the objectives that are prepared from them."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

from frida_painter.errors import ConfigError, FridaError
from frida_painter.registry import OBJECTIVES, parts

if TYPE_CHECKING:
    import torch
    from torch import Tensor

    from frida_painter.frames import PixelGrid, Rows
    from frida_painter.objectives.encoders.loading import EncoderRegistry
    from frida_painter.objectives.word_settings import WordSettings


class Term(ABC):
    """One wish of a person with its weight: base class of the terms of a goal.

    weight: importance, > 0
    initial_order: a plan begins with the terms of the lowest number. A term with None takes part only if no
    term has a number.
    interpretation_order: order in which the `interpret` methods are called, lowest first
    is_tried: True if the objective is tried on a picture of noise before planning (`require_objective`); False for
    objectives with networks, whose trial takes a second
    can_be_weighed: True if some places of the picture may matter more than others
    is_loose: True if strokes may be large where the picture matters little

    Pictures are [3, H, W] in [0, 1]. Each kind of goal has a frozen dataclass for its terms. Terms of different
    kinds see each other only through the properties below. A subclass must define `prepare`; by default a term has
    neither a picture nor words.
    """

    weight: float
    initial_order: ClassVar[int | None] = None
    interpretation_order: ClassVar[int] = 100
    is_tried: ClassVar[bool] = True
    can_be_weighed: ClassVar[bool] = False
    is_loose: ClassVar[bool] = False

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "__repr__" not in vars(cls):  # before a dataclass makes one that prints all pixels
            cls.__repr__ = Term.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        values = {
            name: f"[{', '.join(map(str, value.shape))}]" if hasattr(value, "shape") else repr(value)[:60]
            for name, value in vars(self).items()
            if value is not None
        }
        return f"{type(self).__name__}({', '.join(f'{name}={value}' for name, value in values.items())})"

    @abstractmethod
    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """Returns the objective after all one-time computations. Raises WeightsError if a network is missing."""

    @property
    def picture(self) -> Tensor | None:
        """Picture to paint: sets composition and colours."""
        return None

    @property
    def is_pixelwise(self) -> bool:
        """True if the picture is compared pixel by pixel. Drawings of other terms are then drawn on it."""
        return False

    @property
    def drawing(self) -> Tensor | None:
        """Dark lines on white paper: set composition, not colours."""
        return None

    @property
    def colors(self) -> Tensor | None:
        """Style picture: sets colours and marks, not composition."""
        return None

    @property
    def words(self) -> str | None:
        """Words that describe what to paint."""
        return None

    @property
    def guide(self) -> Tensor | None:
        """Picture that guides the first strokes, if a plan begins with this term; by default `picture`."""
        return self.picture

    @property
    def importance(self) -> Tensor | None:
        """Importance of each place of the guide, [h, w], with mean 1; None if uniform."""
        return None

    def weigh(self, importance: Tensor) -> Term:
        """Returns the term with this importance of each place, if it `can_be_weighed`."""
        return self

    def as_start(self, goal: Goal) -> Term:
        """Returns the term that a plan of `goal` starts with, if it begins with this term."""
        return self

    def with_picture(self, picture: Tensor) -> Term:
        """Returns the term with another picture to paint."""
        return self

    def on_picture(self, picture: Tensor) -> Term:
        """Returns the term after its drawing was drawn on `picture`."""
        return self

    def say(self, settings: WordSettings) -> Term:
        """Returns the term with these settings of its words."""
        return self

    def free_colors(self, freedom: float) -> Term:
        """Returns the term with this freedom of its colours, from 0 to 1, if it can leave those of its picture."""
        return self

    def fit_to(self, rows: int, columns: int, *, pad: bool = False) -> Term:
        """Returns the term with its pictures fitted to `rows` x `columns`; see `Goal.fit_to`."""
        return self

    def crop(self, box: tuple[float, float, float, float]) -> Term:
        """Returns the term with a part of its picture; box as in `images.crop`. Raises ConfigError if it cannot."""
        raise ConfigError("A goal of this kind cannot be cropped; crop its file first, and give that.")

    def to(self, device: torch.device) -> Self:
        """Returns the term with its pictures on that device."""
        from torch import Tensor

        this: Any = self
        pictures = {name: part.to(device) for name, part in vars(self).items() if isinstance(part, Tensor)}
        return replace(this, **pictures) if pictures else this

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """Returns the goal after the changes that terms of this kind make to other terms."""
        return goal


@dataclass(frozen=True)
class Goal:
    """One or more terms that are pursued together.

    initial: terms that are pursued first, so that their composition stays (paper, Algorithm 1). A style among
    them counts as a picture.
    Raises ConfigError if there are no terms.
    """

    terms: tuple[Term, ...]
    initial: tuple[Term, ...] = ()

    def __post_init__(self) -> None:
        if not self.terms:
            raise ConfigError("A goal without any term was given; name at least one picture or some words to paint.")

    def change(self, change: Callable[[Term], Term]) -> Self:
        """Returns the goal with all terms, also the initial ones, changed."""
        return replace(self, terms=tuple(map(change, self.terms)), initial=tuple(map(change, self.initial)))

    def to(self, device: torch.device) -> Self:
        """Returns the goal with its pictures on that device."""
        return self.change(lambda term: term.to(device))

    def fit_to(self, rows: int, columns: int, *, pad: bool = False) -> Self:
        """Returns the goal with all pictures fitted to a canvas of `rows` x `columns`.

        pad: True to show whole pictures on white; False to crop them to their middle
        """
        return self.change(lambda term: term.fit_to(rows, columns, pad=pad))

    @cached_property
    def initial_terms(self) -> tuple[Term, ...]:
        """Terms that a plan begins with: the initial terms, or the terms of the lowest `initial_order`, or all terms.

        If all terms begin unchanged, this is the tuple `terms` itself.
        """
        if self.initial:
            return tuple(term.as_start(self) for term in self.initial)
        orders = [term.initial_order for term in self.terms if term.initial_order is not None]
        if not orders:
            return self.terms
        begun = tuple(term.as_start(self) for term in self.terms if term.initial_order == min(orders))
        return self.terms if [*map(id, begun)] == [*map(id, self.terms)] else begun


def require_weight(weight: float, what: str) -> None:
    """Raises ConfigError unless the weight of `what` is above 0 and finite."""
    if not 0 < weight < math.inf:
        raise ConfigError(f"A weight of {weight} was given to {what}; weights are above 0 and finite.")


_NAME = re.compile("[a-z][a-z0-9_]{0,29}")
_TAKEN = ("goal", "initial", "photo", "weight", "clip", "pictures")


class Gives(Enum):
    """Value that a person gives for a goal; the enum's value is its name in help texts."""

    PICTURE = "FILE"
    WORDS = "WORDS"


@dataclass(frozen=True)
class GoalKind:
    """Kind of goal, for everything that asks people for goals; of this or another package.

    name: name of the option --NAME, of its weight --NAME-weight, and of the key in goal files: lower-case
    letters, digits, _
    gives: a picture file, or words
    help: help text of the option, one sentence
    label: name of the goal in records
    open: makes a term from the file or the words, and the weight; raises ConfigError and ImageError
    begin: makes the term for a painting that only begins with it; None for `open` with weight 1
    initial_help: help text of the option --init-NAME; "" if there is no such option. Goal files may still begin
    with this kind.
    networks: groups of names of weights, best first. One network of each group must have been fetched.

    Raises ConfigError if the name is invalid.
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
        """Command line option for a goal of this kind."""
        return f"--{self.name.replace('_', '-')}"

    @property
    def initial_option(self) -> str:
        """Command line option for a painting that begins with a goal of this kind."""
        return f"--init-{self.name.replace('_', '-')}"

    def open_term(self, value: Any, weight: float, *, beginning: bool) -> Term:
        """Returns the term of a file or of words. Raises ImageError, or ConfigError that names the option."""
        try:
            if not beginning:
                return self.open(value, weight)
            return self.open(value, 1.0) if self.begin is None else self.begin(value)
        except ConfigError as error:
            option = self.initial_option if beginning else self.option
            raise ConfigError(f"{option} {str(value)[:60]}: {error}") from error


@dataclass(frozen=True)
class KnownKinds:
    """Kinds of goals by name, those of this project first.

    complaints: one sentence for each kind that was left out
    """

    by_name: Mapping[str, GoalKind]
    complaints: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> GoalKind:
        """Returns the kind of that name. Raises ConfigError if there is none."""
        if name not in self.by_name:
            raise ConfigError(f"There is no kind of goal called {name[:40]!r}; there are {', '.join(self.by_name)}.")
        return self.by_name[name]


@cache
def goal_kinds() -> KnownKinds:
    """Returns all kinds of goals without loading PyTorch; one that cannot be loaded is left out with a complaint."""
    known: dict[str, GoalKind] = {}
    complaints: list[str] = []
    for name, part in parts(OBJECTIVES).items():
        try:
            known[name] = part.load(GoalKind)
        except FridaError as error:
            complaints.append(f"A kind of goal is left out: {error}")
    return KnownKinds(known, tuple(complaints))


class Objective(Protocol):
    """Differentiable function of a picture [3, H, W] in [0, 1] that returns one number; smaller is nearer to the goal.

    Any function of that form is one:

        >>> import frida_painter as fp
        >>> def unrest(picture):
        ...     return picture.diff(dim=1).abs().mean()
        >>> objective: fp.Objective = unrest
        >>> goal = fp.make_goal("photo.jpg", objective=objective, weights={"objective": 0.5})
    """

    def __call__(self, picture: Tensor, /) -> Tensor: ...  # noqa: D102


class CanvasLoss(Protocol):
    """Loss of a picture [3, H, W] in [0, 1] of the canvas, as planning uses it.

    variance [H, W]: variance of the pixels, if `picture` is the mean of possible results. The loss is then the expected
    loss, as far as the goal can compute it.
    """

    def __call__(self, picture: Tensor, variance: Tensor | None = None) -> Tensor: ...  # noqa: D102


@dataclass(frozen=True)
class Sparing:
    """Objective of one optimisation that computes slow terms in some iterations only.

    anew: loss with all terms computed
    between: loss with slow terms from their gradients at the last call of `anew`
    lasts: number of iterations that one gradient serves
    smooth: True if `lasts` counts full steps of the optimiser in place of iterations
    """

    anew: CanvasLoss
    between: CanvasLoss
    lasts: int
    smooth: bool = False


GRADIENT_LASTS = 3
"""Full steps that one gradient of a slow network serves: in a style, and of edges beside a picture that is compared
pixel by pixel. Measured in docs/lab/goals.md."""


@dataclass(frozen=True)
class ObjectiveContext:
    """Data that terms need to prepare their objectives.

    grid: pixel grid of the pictures
    encoders: available networks
    seed: seed of the run
    in_style: True if a term of the goal is a style
    is_held: True if a term is compared pixel by pixel, so that others may be computed seldom
    shared: what terms of one goal have in common, by names that they agree on, such as a network's last sight
    """

    grid: PixelGrid
    encoders: EncoderRegistry
    seed: int
    in_style: bool = False
    is_held: bool = False
    shared: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ObjectiveTerm:
    """Prepared objective of one term.

    objective: loss of a picture
    validation: steady judgement of a finished picture, best by a network that the optimiser does not use. None
    if `objective` is deterministic and cannot be fooled.
    of_variance: mean increase of the loss by the variance [H, W] of the pixels; None if unknown
    recognizes: True if `validation` measures how well the wish is recognised
    on_rows: makes the term for pictures with some rows of the grid only; None if the loss is no mean over pixels
    lasts: number of iterations that one gradient may serve: above 1 if it is slow
    smooth: True if `lasts` counts full steps of the optimiser
    looks: time of a plan between two gradients, in gradients of the validation
    """

    objective: Objective
    validation: Objective | None = None
    of_variance: Callable[[Tensor], Tensor] | None = None
    recognizes: bool = False
    on_rows: Callable[[Rows], ObjectiveTerm] | None = None
    lasts: int = 1
    smooth: bool = False
    looks: float = 1.0


def require_objective(objective: Objective, what: str, rows: int, columns: int, device: torch.device) -> None:
    """Raises ConfigError unless the objective `what` returns one finite number that PyTorch can derive by the picture.

    It is tried once, on noise [3, rows, columns]: a number that does not change there steers no stroke.
    """
    import torch

    noise = torch.rand(3, rows, columns, generator=torch.Generator().manual_seed(0)).to(device).requires_grad_()
    told = f"{what} was tried on a picture [3, {rows}, {columns}] and"
    wanted = "it returns one number, a tensor that PyTorch computes from the picture"
    try:
        value = objective(noise)
    except FridaError:
        raise
    except Exception as failure:  # somebody's function may raise anything
        why = " ".join(f"{type(failure).__name__}: {failure}".split())[:200]
        raise ConfigError(f"{told} failed ({why}); {wanted}.") from failure
    if not isinstance(value, torch.Tensor):
        raise ConfigError(f"{told} returned {str(value)[:40]} of type {type(value).__name__}; {wanted}.")
    if value.dim() != 0:
        raise ConfigError(f"{told} returned a tensor of shape {tuple(value.shape)}; {wanted}: take its mean().")
    if not math.isfinite(float(value.detach())):
        raise ConfigError(f"{told} returned {float(value.detach())}; {wanted}, and it is finite.")
    if not value.requires_grad:
        raise ConfigError(
            f"{told} returned {float(value):.4g} without a gradient; {wanted}: leave out detach(), item(), numpy() and "
            "no_grad()."
        )
    (gradient,) = torch.autograd.grad(value, noise, allow_unused=True)
    if gradient is None or not bool(gradient.any()):
        raise ConfigError(f"{told} returned {float(value.detach()):.4g} whatever the picture is; {wanted}.")
    if not bool(gradient.isfinite().all()):
        raise ConfigError(f"{told} has a gradient that is not finite; add a small number inside each square root.")
