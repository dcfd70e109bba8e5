"""Goals: the pictures and words of a painting's description are opened, or given in one line by a notebook."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from torch import Tensor

from frida_painter.errors import ConfigError
from frida_painter.goal import Goal, Term, require_weight
from frida_painter.objectives.kind import goal_kinds
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.kinds.semantic import SemanticTerm
from frida_painter.objectives.kinds.sketch import SketchTerm
from frida_painter.objectives.kinds.style import StyleTerm
from frida_painter.objectives.objective import ObjectiveContext, ObjectiveTerm
from frida_painter.runs.goal_item import GoalItem
from frida_painter.runs.spec import RunSpec

_MOST_TERMS = 20

Picture = str | Path | Tensor
"""A picture file, or sRGB [3, H, W] in [0, 1]."""
_KINDS = ("image", "semantic", "sketch", "text", "style")
Scores = Callable[[Tensor], Tensor]
"""A picture [3, H, W] in [0, 1] to a differentiable number; smaller is nearer."""
_OBJECTIVE = "objective"


def open_goal(spec: RunSpec) -> Goal:
    """What the description asks for, its pictures read. Raises ConfigError for what makes no goal, and ImageError."""
    if not spec.goal:
        options = ", ".join(f"{kind.option} {kind.gives.value}" for kind in goal_kinds().by_name.values())
        raise ConfigError(f"There is nothing to paint; give a PHOTO, or one or more of {options}.")
    count = len(spec.goal) + len(spec.initial)
    if count > _MOST_TERMS:
        raise ConfigError(f"{count} goals were given; at most {_MOST_TERMS} are pursued together.")
    return Goal(
        tuple(_opened(item, beginning=False) for item in spec.goal),
        tuple(_opened(item, beginning=True) for item in spec.initial),
    )


def picture_of(goal: Goal) -> Tensor | None:
    """The first picture that says what is where, or else that of a style where no words say what to paint in it."""
    every: tuple[Term, ...] = (*goal.terms, *goal.initial)
    pictures = [term.guide for term in every] + [term.colors for term in goal.initial]
    if all(term.words is None for term in every):
        pictures += [term.colors for term in goal.terms]
    return next((picture for picture in pictures if picture is not None), None)


def _opened(item: GoalItem, *, beginning: bool) -> Term:
    return goal_kinds()[item.kind].opened(item.path or item.value, item.weight, beginning=beginning)


def make_goal(
    image: Picture | Sequence[Picture] = (),
    *,
    semantic: Picture | Sequence[Picture] = (),
    sketch: Picture | Sequence[Picture] = (),
    text: str | Sequence[str] = (),
    style: Picture | Sequence[Picture] = (),
    objective: Scores | Sequence[Scores] = (),
    weights: Mapping[str, float] | None = None,
) -> Goal:
    """What shall be painted: one or more of these, each a single one or a sequence; `make_goal("photo.jpg")`.

    image: to come near to, pixel by pixel; semantic: to paint by what it shows; sketch: a drawing to follow;
    text: words; style: a picture whose colours and marks the painting shall have; objective: a function of one's
    own. weights: how much a kind matters, by its name, above 0; 1 where it is not named. Semantic, sketch, text and
    style are seen through networks that `frida-painter models fetch` gets. Raises ConfigError where there is nothing
    to paint or a kind is not known, and ImageError where a picture cannot be read.
    """
    given = dict(zip(_KINDS, (image, semantic, sketch, text, style), strict=True))
    weights = weights or {}
    if unknown := sorted(set(weights) - {*_KINDS, _OBJECTIVE}):
        known = ", ".join((*_KINDS, _OBJECTIVE))
        raise ConfigError(f"A weight was given to {unknown[0][:40]!r}; weights are given to {known}.")
    terms = [_term(kind, one, float(weights.get(kind, 1.0))) for kind, some in given.items() for one in _each(some)]
    functions = [objective] if callable(objective) else objective
    terms += [_FunctionTerm(float(weights.get(_OBJECTIVE, 1.0)), function) for function in functions]
    return Goal(tuple(terms))


@dataclass(frozen=True)
class _FunctionTerm(Term):
    """A function of the picture as a goal. Raises ConfigError for a weight that is none."""

    weight: float
    function: Scores

    def __post_init__(self) -> None:
        require_weight(self.weight, "an objective")

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """The function as it is."""
        return ObjectiveTerm(self.function)


def _each(some: Picture | Sequence[Picture]) -> Sequence[Picture]:
    return [some] if isinstance(some, str | Path | Tensor) else some


def _term(kind: str, one: Picture, weight: float) -> Term:
    if not isinstance(one, Tensor):
        return goal_kinds()[kind].opened(one if kind == "text" else Path(one), weight, beginning=False)
    if one.dim() != 3 or one.shape[0] != 3:
        raise ConfigError(f"A picture of shape {tuple(one.shape)} was given to {kind}; it is [3, height, width].")
    terms = {"image": ImageTerm, "semantic": SemanticTerm, "sketch": SketchTerm, "style": StyleTerm}
    return cast(Term, terms[kind](one, weight))
