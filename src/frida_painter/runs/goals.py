"""Goals: opened from a painting's description, or made in one line in a notebook."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

from torch import Tensor

from frida_painter.errors import ConfigError
from frida_painter.objectives.objective import (
    Gives,
    Goal,
    Objective,
    ObjectiveContext,
    ObjectiveTerm,
    Term,
    goal_kinds,
    require_weight,
)
from frida_painter.objectives.word_settings import WordSettings
from frida_painter.registry import Later
from frida_painter.runs.spec import RunSpec
from frida_painter.system.images import AnyPicture, as_picture

_MAX_TERMS = 20

OF_PICTURES = {
    name: Later(f"frida_painter.objectives.{name}:{name.title()}Term")
    for name in ("image", "semantic", "sketch", "style")
}
"""Goals that are one picture, by their names."""
_OBJECTIVE = "objective"


def open_goal(spec: RunSpec) -> Goal:
    """Returns the goal of a description, with its pictures read.

    Raises ConfigError for an invalid goal, and ImageError.
    """
    if spec.together:
        return Goal((_NoGoal(),))
    if not spec.goal:
        options = ", ".join(f"{kind.option} {kind.gives.value}" for kind in goal_kinds().by_name.values())
        raise ConfigError(
            f"There is nothing to paint; give a PHOTO, one or more of {options}, or --together, to begin yourself."
        )
    count = len(spec.goal) + len(spec.initial)
    if count > _MAX_TERMS:
        raise ConfigError(f"{count} goals were given; at most {_MAX_TERMS} are pursued together.")
    opened: dict[bool, list[Term]] = {False: [], True: []}
    for beginning, items in ((False, spec.goal), (True, spec.initial)):
        for item in items:
            kind = goal_kinds()[item.kind]
            term = kind.open_term(item.path or item.value, item.weight, beginning=beginning)
            opened[beginning].append(term if item.crop is None else term.crop(item.crop))
    return Goal(tuple(opened[False]), tuple(opened[True]))


def tell_terms(goal: Goal, settings: WordSettings, freedom: float) -> Goal:
    """Returns the goal with these settings of its words, and this freedom of its colours."""
    both = (goal.terms, goal.initial)
    terms, initial = (tuple(term.say(settings).free_colors(freedom) for term in some) for some in both)
    return replace(goal, terms=terms, initial=initial)


def picture_of(goal: Goal) -> Tensor | None:
    """Returns the first picture that shows the content; without one, and without words, the picture of a style."""
    every: tuple[Term, ...] = (*goal.terms, *goal.initial)
    pictures = [term.guide for term in every] + [term.colors for term in goal.initial]
    if all(term.words is None for term in every):
        pictures += [term.colors for term in goal.terms]
    return next((picture for picture in pictures if picture is not None), None)


def make_goal(
    image: AnyPicture | Sequence[AnyPicture] = (),
    *,
    semantic: AnyPicture | Sequence[AnyPicture] = (),
    sketch: AnyPicture | Sequence[AnyPicture] = (),
    text: str | Sequence[str] = (),
    style: AnyPicture | Sequence[AnyPicture] = (),
    objective: Objective | Sequence[Objective] = (),
    kinds: Mapping[str, AnyPicture | Sequence[AnyPicture]] | None = None,
    weights: Mapping[str, float] | None = None,
) -> Goal:
    """Returns a goal from one or more of these inputs, each a single one or a sequence: `make_goal("photo.jpg")`.

    image: picture to match pixel by pixel.
    semantic: picture to match by its content.
    sketch: drawing to follow.
    text: words.
    style: picture whose colours and marks the painting takes.
    objective: function of your own.
    kinds: goals of any registered kind by its name, also of other packages: {"mirror": "left-right"}.
    weights: weight of each of these, by its name, above 0; 1 by default.

    Semantic, sketch, text and style need networks that `frida-painter models fetch` gets.
    Raises ConfigError if no input is given, or for an unknown kind or a wrong weight. Raises ImageError if a picture
    cannot be read.

        >>> import frida_painter as fp
        >>> goal = fp.make_goal("photo.jpg", objective=lambda picture: picture.diff(dim=2).abs().mean())
        >>> [term.weight for term in goal.terms]
        [1.0, 1.0]
    """
    named = {"image": image, "semantic": semantic, "sketch": sketch, "text": text, "style": style}
    given = {name: _each(some) for name, some in named.items()}
    for name, some in (kinds or {}).items():
        goal_kinds()[name]
        given[name] = [*given.get(name, ()), *_each(some)]
    functions = [objective] if callable(objective) else list(objective)
    if strange := [one for one in functions if not callable(one)]:
        raise ConfigError(f"An objective was given as {type(strange[0]).__name__}; it is a function of a picture.")
    there = [*(name for name, some in given.items() if some), *([_OBJECTIVE] if functions else [])]
    weights, known = weights or {}, (*goal_kinds().by_name, _OBJECTIVE)
    if unknown := sorted(set(weights) - set(known)):
        raise ConfigError(f"A weight was given to {unknown[0][:40]!r}; weights are given to {', '.join(known)}.")
    if absent := sorted(set(weights) - set(there)):
        raise ConfigError(
            f"A weight was given to {absent[0]!r}, and this goal is made of {', '.join(there) or 'nothing'}; give that "
            "as well, or leave the weight out."
        )
    terms = [_term(kind, one, float(weights.get(kind, 1.0))) for kind, some in given.items() for one in some]
    terms += [_FunctionTerm(float(weights.get(_OBJECTIVE, 1.0)), function) for function in functions]
    return Goal(tuple(terms))


@dataclass(frozen=True)
class _FunctionTerm(Term):
    """Goal term from a function of the picture. Raises ConfigError for an invalid weight."""

    weight: float
    function: Objective

    def __post_init__(self) -> None:
        require_weight(self.weight, "an objective")

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """Returns the function itself as the objective term."""
        return ObjectiveTerm(self.function)


@dataclass(frozen=True)
class _NoGoal(Term):
    """Goal term of a painting without a goal: every picture is as good as any other."""

    weight: float = 1.0
    is_tried = False

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """Returns an objective that is 0 for every picture."""
        return ObjectiveTerm(lambda picture: 0 * picture.sum())


def _each(some: AnyPicture | Sequence[AnyPicture]) -> list[AnyPicture]:
    """Returns one thing, or a list of them, as a list."""
    return list(some) if isinstance(some, list | tuple) else [cast(AnyPicture, some)]


def _term(kind: str, one: AnyPicture, weight: float) -> Term:
    """Returns the term of a file, words or a picture. Raises ConfigError and ImageError."""
    known = goal_kinds()[kind]
    if isinstance(one, str | Path):
        return known.open_term(str(one) if known.gives is Gives.WORDS else Path(one), weight, beginning=False)
    if kind not in OF_PICTURES:
        wanted = "words" if known.gives is Gives.WORDS else "the file of a picture"
        raise ConfigError(f"A {type(one).__name__} was given to {kind}, which takes {wanted}; give that.")
    opened: Term = OF_PICTURES[kind](as_picture(one).float(), weight)
    return opened
