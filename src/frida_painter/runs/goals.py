"""What shall be painted, as it is said on the command line or in a TOML file, made into a goal."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from torch import Tensor

from frida_painter import storage
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.goal import Goal, Term
from frida_painter.objectives.kind import Gives, GoalKind
from frida_painter.objectives.registry import goal_kinds
from frida_painter.runs.prompts import name_of, read_prompt, title_of
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
    content = storage.read_bytes(path, "a goal file (TOML)", _MOST_BYTES, ConfigError)
    example = 'write [[goal]], then lines such as style = "waves.jpg" and weight = 2'
    try:
        record = tomllib.loads(content.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path} is not TOML ({error}); {example}.") from error
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
