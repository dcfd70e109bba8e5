"""What shall be painted, as it is said on the command line or in a TOML file, made into a goal."""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from torch import Tensor

from frida_painter import images, storage
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.goal import Goal, ImageTerm, SemanticTerm, SketchTerm, StyleTerm, Term, TextTerm
from frida_painter.runs.prompts import name_of, read_prompt, title_of

_KINDS = ("image", "semantic", "sketch", "text", "style")
_MOST_BYTES = 2**20
_MOST_TERMS = 20
_STYLE_LONGEST = 1024  # pixels; styles are compared in small pictures

Wish = tuple[str, Any, float]
"""The kind of a term, a file, and how much it matters."""


@dataclass(frozen=True)
class Wanted:
    """What a person asked for: the goal, in words for the record, a title, a name for files, and the first picture.

    picture is None where nothing but words, or words and a style, was asked for. wishes, begins: the same
    as (kind, file or words, weight), what the painting is to be and what it begins with.
    """

    goal: Goal
    facts: tuple[tuple[str, str], ...]
    title: str
    name: str
    picture: Tensor | None
    wishes: tuple[Wish, ...]
    begins: tuple[Wish, ...]

    def fitted(self, grid: PixelGrid, place: Callable[[Tensor, int, int], Tensor] = images.fit) -> "Wanted":
        """The same, with the pictures that are to fill the canvas as they will fill it: cropped, or as `place` does."""

        def fit(term: Term) -> Term:
            if isinstance(term, StyleTerm | TextTerm):
                return term
            return replace(term, image=place(term.image, grid.rows, grid.columns))

        terms, initial = (tuple(map(fit, some)) for some in (self.goal.terms, self.goal.initial))
        return replace(self, goal=Goal(terms, initial))


def read_goal(photo: Path | None, given: Mapping[str, Any]) -> Wanted:
    """The goal of PHOTO, which counts as the first --image, and of the options by their names.

    Raises ConfigError and ImageError, before anything is planned, for what makes no goal.
    """
    return open_goal(*listed(photo, given))


def listed(photo: Path | None, given: Mapping[str, Any]) -> tuple[list[Wish], list[Wish]]:
    """What PHOTO and the options name: things to paint, and to begin with. Raises ConfigError."""
    wishes: list[Wish] = [] if photo is None else [("image", photo, _photo_weight(given))]
    begins: list[Wish] = []
    for kind in _KINDS:
        values = _read(kind, given.get(kind) or [], f"--{kind}")
        wishes += zip([kind] * len(values), values, _weights(kind, photo, values, given), strict=True)
        begins += [(kind, value, 1.0) for value in _read(kind, given.get(f"init_{kind}") or [], f"--init-{kind}")]
    if given.get("goal") is not None:
        more, first = _from_toml(given["goal"])
        wishes, begins = wishes + more, begins + first
    return wishes, begins


def open_goal(wishes: Sequence[Wish], begins: Sequence[Wish] = ()) -> Wanted:
    """The goal of these things to paint, and to begin with. Raises ConfigError and ImageError."""
    if not wishes:
        raise ConfigError(
            "There is nothing to paint; give a PHOTO, --text with words, or --semantic, --sketch or --style with a "
            "picture."
        )
    if len(wishes) + len(begins) > _MOST_TERMS:
        raise ConfigError(f"{len(wishes) + len(begins)} goals were given; at most {_MOST_TERMS} are pursued together.")
    terms = [_term(*wish) for wish in wishes]
    initial = [_term(*begin, beginning=True) for begin in begins]
    facts = [(_label(kind), _described(value, weight)) for kind, value, weight in wishes]
    facts += [(f"Begun with {kind}", _described(value, 1.0)) for kind, value, _ in begins]
    pictures = [term.image for term in (*terms, *initial) if not isinstance(term, StyleTerm | TextTerm)]
    pictures += [term.image for term in initial if isinstance(term, StyleTerm)]
    if not any(isinstance(term, TextTerm) for term in (*terms, *initial)):
        pictures += [term.image for term in terms if isinstance(term, StyleTerm)]
    goal, picture = Goal(tuple(terms), tuple(initial)), pictures[0] if pictures else None
    return Wanted(goal, tuple(facts), *_names(wishes[0][1]), picture, tuple(wishes), tuple(begins))


def _read(kind: str, values: Sequence[Any], option: str) -> list[Any]:
    """The values of an option: words as one plain line, files as they are."""
    return [read_prompt(value, option) for value in values] if kind == "text" else list(values)


def _photo_weight(given: Mapping[str, Any]) -> float:
    weights = given.get("image_weight") or [1.0]
    return float(weights[0])


def _weights(kind: str, photo: Path | None, values: Sequence[Any], given: Mapping[str, Any]) -> list[float]:
    """A weight for each of the values; PHOTO has the first of the images' weights."""
    weights = given.get(f"{kind}_weight") or []
    ahead = int(kind == "image" and photo is not None)
    count = len(values) + ahead
    if weights and len(weights) != count:
        photo_too = ", PHOTO among them" if ahead else ""
        raise ConfigError(
            f"--{kind}-weight was given {len(weights)} times for {count} goals{photo_too}; "
            "give one weight for each, or none at all."
        )
    return [float(weight) for weight in weights[ahead:]] or [1.0] * len(values)


def _term(kind: str, value: Any, weight: float, *, beginning: bool = False) -> Term:
    """A term to paint, or to begin with: then what a picture shows, or a drawing of it, is the picture itself."""
    try:
        if kind == "text":
            return TextTerm(value, weight)
        if kind == "style":
            return StyleTerm(images.load(value, longest=_STYLE_LONGEST), weight)
        kinds: dict[str, Callable[[Tensor, float], Term]] = {
            "image": ImageTerm, "semantic": SemanticTerm, "sketch": SketchTerm,
        }  # fmt: skip
        return (ImageTerm if beginning else kinds[kind])(images.load(value), weight)
    except ConfigError as error:
        option = f"--init-{kind}" if beginning else f"--{kind}"
        raise ConfigError(f"{option} {str(value)[:60]}: {error}") from error


def _from_toml(path: Path) -> tuple[list[Wish], list[Wish]]:
    """The wishes and the beginnings of a goal file; pictures are named relative to it."""
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
    found: dict[str, list[Wish]] = {"goal": [], "initial": []}
    for table, wishes in found.items():
        entries = record.get(table, [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise ConfigError(f"{path}: {table} is not a list of tables; {example}.")
        for entry in entries:
            kinds = [kind for kind in _KINDS if isinstance(entry.get(kind), str)]
            weight = entry.get("weight", 1.0)
            if len(kinds) != 1 or set(entry) - {kinds[0], "weight"} or type(weight) not in (int, float):
                known = ", ".join(_KINDS)
                raise ConfigError(f"{path}: a [[{table}]] has one of {known}, and perhaps a weight; {example}.")
            value = entry[kinds[0]]
            said = read_prompt(value, f"{path}: text") if kinds[0] == "text" else path.parent / value
            wishes.append((kinds[0], said, float(weight)))
    return found["goal"], found["initial"]


def _label(kind: str) -> str:
    labels = {
        "image": "Picture", "semantic": "What is shown in", "sketch": "Sketch", "style": "Style of", "text": "Words",
    }  # fmt: skip
    return labels[kind]


def _described(value: Any, weight: float) -> str:
    name = value.name if isinstance(value, Path) else f"“{title_of(value)}”"
    return name if weight == 1 else f"{name} (weight {weight:g})"


def _names(first: Any) -> tuple[str, str]:
    """A title, and a name for files, from the first thing wanted."""
    if isinstance(first, str):
        return title_of(first), name_of(first)
    stem = first.stem
    return stem.replace("_", " ").replace("-", " ").strip().capitalize() or "Untitled", stem
