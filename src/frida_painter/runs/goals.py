"""What shall be painted, as it is said on the command line or in a TOML file, made into a goal."""

import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, cast

from torch import Tensor

from frida_painter import storage
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.goal import Goal, Term
from frida_painter.objectives.kind import Gives, GoalKind, goal_kinds
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.kinds.semantic import SemanticTerm
from frida_painter.objectives.kinds.sketch import SketchTerm
from frida_painter.objectives.kinds.style import StyleTerm
from frida_painter.runs.spec import GoalItem

_PHOTO = "image"  # the kind of goal that PHOTO is
_MOST_BYTES = 2**20
_MOST_TERMS = 20


class GoalInput(NamedTuple):
    """One goal as a person gives it: the name of its kind, a picture's file or words, and how much it matters."""

    kind: str
    value: Path | str
    weight: float


@dataclass(frozen=True)
class OpenedGoal:
    """A goal whose pictures are read, with its facts for the record, a title, and a name for files.

    picture: the first picture, None where only words, or words and a style, were given. items: what the painting is
    to show, as it was given; initial: what it begins with, as it was given.
    """

    goal: Goal
    facts: tuple[tuple[str, str], ...]
    title: str
    name: str
    picture: Tensor | None
    items: tuple[GoalInput, ...]
    initial: tuple[GoalInput, ...]

    def fitted(self, grid: PixelGrid, *, pad: bool = False) -> "OpenedGoal":
        """The same, with the pictures that are to fill the canvas as they will fill it: cropped, or padded."""
        return replace(self, goal=self.goal.fitted(grid.rows, grid.columns, pad=pad))


def read_goal(photo: Path | None, given: Mapping[str, Any]) -> OpenedGoal:
    """The goal of PHOTO, which counts as the first --image, and of the options by their names.

    Raises ConfigError and ImageError, before anything is planned, for what makes no goal.
    """
    return open_goal(*listed(photo, given))


def listed(photo: Path | None, given: Mapping[str, Any]) -> tuple[list[GoalInput], list[GoalInput]]:
    """What PHOTO and the options name: things to paint, and to begin with. Raises ConfigError."""
    items = [] if photo is None else [GoalInput(_PHOTO, photo, _photo_weight(given))]
    initial_items: list[GoalInput] = []
    kinds = goal_kinds()
    for name, kind in kinds.by_name.items():
        values = _read(kind, given.get(name) or [], kind.option)
        items += map(GoalInput, [name] * len(values), values, _weights(kind, photo, values, given))
        first = _read(kind, given.get(f"init_{name}") or [], kind.initial_option)
        initial_items += [GoalInput(name, value, 1.0) for value in first]
    if given.get("goal") is not None:
        more, more_initial = _from_toml(given["goal"])
        items, initial_items = items + more, initial_items + more_initial
    return items, initial_items


def open_goal(items: Sequence[GoalInput], initial_items: Sequence[GoalInput] = ()) -> OpenedGoal:
    """The goal of these things to paint, and to begin with. Raises ConfigError and ImageError."""
    kinds = goal_kinds()
    if not items:
        options = ", ".join(f"{kind.option} {kind.gives.value}" for kind in kinds.by_name.values())
        raise ConfigError(f"There is nothing to paint; give a PHOTO, or one or more of {options}.")
    if len(items) + len(initial_items) > _MOST_TERMS:
        count = len(items) + len(initial_items)
        raise ConfigError(f"{count} goals were given; at most {_MOST_TERMS} are pursued together.")
    terms = tuple(kinds[item.kind].opened(item.value, item.weight, beginning=False) for item in items)
    initial = tuple(kinds[item.kind].opened(item.value, item.weight, beginning=True) for item in initial_items)
    facts = [(kinds[item.kind].label, _described(item)) for item in items]
    facts += [(f"Begun with {item.kind}", _described(item)) for item in initial_items]
    title, name = _names(items[0].value)
    goal = Goal(terms, initial)
    return OpenedGoal(goal, tuple(facts), title, name, _first_picture(goal), tuple(items), tuple(initial_items))


def input_of(item: GoalItem) -> GoalInput:
    """An item of a painting's description: its value is a file, or words. Raises ConfigError for an unknown kind."""
    words = goal_kinds()[item.kind].gives is Gives.WORDS
    return GoalInput(item.kind, item.value if words else Path(item.value), item.weight)


def _first_picture(goal: Goal) -> Tensor | None:
    """The first picture that says what is where, or else that of a style where no words say what to paint in it."""
    every: tuple[Term, ...] = (*goal.terms, *goal.initial)
    pictures = [term.guide for term in every] + [term.colors for term in goal.initial]
    if all(term.words is None for term in every):
        pictures += [term.colors for term in goal.terms]
    return next((picture for picture in pictures if picture is not None), None)


def _read(kind: GoalKind, values: Sequence[Any], option: str) -> list[Any]:
    """The values of an option: words as one plain line, files as they are."""
    return [read_prompt(value, option) for value in values] if kind.gives is Gives.WORDS else list(values)


def _photo_weight(given: Mapping[str, Any]) -> float:
    weights = given.get(f"{_PHOTO}_weight") or [1.0]
    return float(weights[0])


def _weights(kind: GoalKind, photo: Path | None, values: Sequence[Any], given: Mapping[str, Any]) -> list[float]:
    """A weight for each of the values; PHOTO has the first of the images' weights."""
    weights = given.get(f"{kind.name}_weight") or []
    ahead = int(kind.name == _PHOTO and photo is not None)
    count = len(values) + ahead
    if weights and len(weights) != count:
        photo_too = ", PHOTO among them" if ahead else ""
        raise ConfigError(
            f"{kind.option}-weight was given {len(weights)} times for {count} goals{photo_too}; "
            "give one weight for each, or none at all."
        )
    return [float(weight) for weight in weights[ahead:]] or [1.0] * len(values)


def _from_toml(path: Path) -> tuple[list[GoalInput], list[GoalInput]]:
    """The items and the initial items of a goal file; pictures are named relative to it."""
    example = 'write [[goal]], then lines such as style = "waves.jpg" and weight = 2'
    record = storage.read_toml(path, "a goal file (TOML)", _MOST_BYTES, example)
    unknown = set(record) - {"goal", "initial"}
    if unknown:
        raise ConfigError(
            f"{path} speaks of {sorted(unknown)[0][:40]!r}; it may hold [[goal]] and [[initial]]; {example}."
        )
    known = goal_kinds()
    found: dict[str, list[GoalInput]] = {"goal": [], "initial": []}
    for table, items in found.items():
        entries = record.get(table, [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise ConfigError(f"{path}: {table} is not a list of tables; {example}.")
        for entry in entries:
            kinds = [kind for name, kind in known.by_name.items() if isinstance(entry.get(name), str)]
            weight = entry.get("weight", 1.0)
            if len(kinds) != 1 or set(entry) - {kinds[0].name, "weight"} or type(weight) not in (int, float):
                names = ", ".join(known.by_name)
                raise ConfigError(f"{path}: a [[{table}]] has one of {names}, and perhaps a weight; {example}.")
            (kind,) = kinds
            said = entry[kind.name]
            words = kind.gives is Gives.WORDS
            value = read_prompt(said, f"{path}: {kind.name}") if words else path.parent / said
            items.append(GoalInput(kind.name, value, float(weight)))
    return found["goal"], found["initial"]


def _described(item: GoalInput) -> str:
    name = item.value.name if isinstance(item.value, Path) else f"“{title_of(item.value)}”"
    return name if item.weight == 1 else f"{name} (weight {item.weight:g})"


def _names(first: Path | str) -> tuple[str, str]:
    """A title, and a name for files, from the first thing wanted."""
    if isinstance(first, str):
        return title_of(first), name_of(first)
    stem = first.stem
    return stem.replace("_", " ").replace("-", " ").strip().capitalize() or "Untitled", stem


MOST = 10_000  # characters
_TITLE = 60


def read_prompt(text: str, option: str) -> str:
    """The words as one line; signs such as emoji become what they are called.

    Raises ConfigError for no words, more than 10,000 characters, and control characters (an escape sequence
    of a terminal, say). Which words a kind of goal understands, its own term says.
    """
    if len(text) > MOST:
        raise ConfigError(f"{option} was given {len(text)} characters; say it in at most {MOST}.")
    line = " ".join(text.split())
    bad = next((mark for mark in line if unicodedata.category(mark) in ("Cc", "Cs", "Co", "Cn")), None)
    if bad is not None:
        raise ConfigError(
            f"{option} was given a control character (U+{ord(bad):04X}), which is no word; "
            "say what shall be painted in plain words."
        )
    spoken = " ".join("".join(_spoken(mark) for mark in line).split())
    if not spoken:
        raise ConfigError(f'{option} was given no words; say what shall be painted, such as {option} "a sailing ship".')
    return spoken


def title_of(prompt: str) -> str:
    """The words as a title: their beginning where they are many."""
    short = prompt if len(prompt) <= _TITLE else f"{prompt[: _TITLE - 1].rstrip()}…"
    return short[0].upper() + short[1:]


def name_of(prompt: str) -> str:
    """The words as a name for files: small letters, digits and hyphens, at most 40 of them."""
    plain = unicodedata.normalize("NFKD", prompt).encode("ascii", "ignore").decode().lower()
    return re.sub("[^a-z0-9]+", "-", plain)[:40].strip("-") or "words"


def _spoken(mark: str) -> str:
    category = unicodedata.category(mark)
    if category == "So":
        return f" {unicodedata.name(mark, '').lower()} "
    return "" if category in ("Cf", "Mn", "Sk") and not unicodedata.combining(mark) else mark


Picture = str | Path | Tensor
"""A picture file, or sRGB [3, H, W] in [0, 1]."""
_KINDS = ("image", "semantic", "sketch", "text", "style")


def make_goal(
    image: Picture | Sequence[Picture] = (),
    *,
    semantic: Picture | Sequence[Picture] = (),
    sketch: Picture | Sequence[Picture] = (),
    text: str | Sequence[str] = (),
    style: Picture | Sequence[Picture] = (),
    weights: Mapping[str, float] | None = None,
) -> Goal:
    """What shall be painted: one or more of these, each a single one or a sequence; `make_goal("photo.jpg")`.

    image: to come near to, pixel by pixel; semantic: to paint by what it shows; sketch: a drawing to follow;
    text: words; style: a picture whose colours and marks the painting shall have. weights: how much a kind
    matters, by its name, above 0; 1 where it is not named. Everything but images is seen through networks that
    `frida-painter models fetch` gets. Raises ConfigError where there is nothing to paint or a kind is not
    known, and ImageError where a picture cannot be read.
    """
    given = dict(zip(_KINDS, (image, semantic, sketch, text, style), strict=True))
    weights = weights or {}
    if unknown := sorted(set(weights) - set(_KINDS)):
        raise ConfigError(f"A weight was given to {unknown[0][:40]!r}; weights are given to {', '.join(_KINDS)}.")
    return Goal(
        tuple(_term(kind, one, float(weights.get(kind, 1.0))) for kind, some in given.items() for one in _each(some))
    )


def _each(some: Picture | Sequence[Picture]) -> Sequence[Picture]:
    return [some] if isinstance(some, str | Path | Tensor) else some


def _term(kind: str, one: Picture, weight: float) -> Term:
    if not isinstance(one, Tensor):
        return goal_kinds()[kind].opened(one if kind == "text" else Path(one), weight, beginning=False)
    if one.dim() != 3 or one.shape[0] != 3:
        raise ConfigError(f"A picture of shape {tuple(one.shape)} was given to {kind}; it is [3, height, width].")
    terms = {"image": ImageTerm, "semantic": SemanticTerm, "sketch": SketchTerm, "style": StyleTerm}
    return cast(Term, terms[kind](one, weight))
