"""Goal items: things to paint, each a picture file or words, and the goal file (TOML) with several of them."""

import math
import re
import unicodedata
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from frida_painter.errors import ConfigError, FridaError
from frida_painter.objectives.objective import Gives, goal_kinds
from frida_painter.planning.fields import parse_field
from frida_painter.system import storage

MAX_CHARACTERS = 10_000
_MAX_BYTES = 2**20
_TITLE = 60
_EXAMPLE = 'write [[goal]], then lines such as style = "waves.jpg" and weight = 2'
_MIN_CROP = 0.01
_ROUNDING = 1e-9


def _require_inside(box: tuple[float, ...]) -> tuple[float, ...]:
    left, top, width, height = box
    for start, length in ((left, width), (top, height)):
        if not (start >= 0 and length >= _MIN_CROP and start + length <= 1 + _ROUNDING):
            raise ValueError(
                f"A picture was cropped to {[round(side, 4) for side in box]}; left, top, width and height are shares "
                f"of its sides, each side of the part is at least {_MIN_CROP}, and the part lies inside the picture."
            )
    return box


_Share = Annotated[float, Field(allow_inf_nan=False)]
Crop = Annotated[tuple[_Share, _Share, _Share, _Share], AfterValidator(_require_inside)]
"""Part of a picture: left, top, width and height, as shares of the picture's sides."""


class GoalItem(BaseModel):
    """One thing to paint.

    kind: "image", "text" and others.
    value: path of a file, or words.
    weight: its importance, above 0.
    crop: part of its picture; None for the whole one.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: str
    value: str
    weight: float = 1.0
    crop: Crop | None = None

    @model_validator(mode="after")
    def _matters(self) -> Self:
        if not 0 < self.weight < math.inf:
            raise ValueError(
                f"A weight of {self.weight} was given to {self.kind[:40]} {self.value[:40]!r}; weights are above 0 "
                "and finite"
            )
        if self.crop is not None and self.kind in goal_kinds().by_name and self.path is None:
            raise ValueError(f"A crop was given to {self.kind[:40]} {self.value[:40]!r}; only pictures are cropped")
        return self

    @classmethod
    def of(cls, value: Any) -> Any:
        """Returns an item from {"text": "a lemon", "weight": 2}.

        Another value stays as it is, for pydantic to check.
        """
        more = dict(value) if isinstance(value, dict) and "kind" not in value else {}
        kinds = [name for name in more if name not in ("weight", "crop")]
        return cls(kind=kinds[0], value=str(more.pop(kinds[0])), **more) if len(kinds) == 1 else value

    def plain(self, *, beginning: bool) -> Self:
        """Returns the item with its words as one plain line. Raises ConfigError.

        beginning: True for a goal of the start.
        """
        kind = goal_kinds()[self.kind]
        if kind.gives is not Gives.WORDS:
            return self
        words = read_prompt(self.value, kind.initial_option if beginning else kind.option)
        return self.model_copy(update={"value": words})

    @property
    def path(self) -> Path | None:
        """File of a picture; None for words."""
        return None if goal_kinds()[self.kind].gives is Gives.WORDS else Path(self.value)

    @property
    def label(self) -> str:
        """Name of its kind in records."""
        return goal_kinds()[self.kind].label

    @property
    def described(self) -> str:
        """Description for records: the file's name, or the words, and the weight."""
        name = f"“{title_of(self.value)}”" if self.path is None else self.path.name
        name = name if self.crop is None else f"{name}, cropped"
        return name if self.weight == 1 else f"{name} (weight {self.weight:g})"

    @property
    def title(self) -> str:
        """Title for a painting of it."""
        if self.path is None:
            return title_of(self.value)
        return self.path.stem.replace("_", " ").replace("-", " ").strip().capitalize() or "Untitled"

    @property
    def name(self) -> str:
        """File name for a painting of it."""
        return name_of(self.value) if self.path is None else self.path.stem


def read_goal_file(path: Path) -> dict[str, list[dict[str, Any]]]:
    """Reads "goal" and "initial" of a goal file, in the form of RunSpec; picture paths are relative to the file.

    Raises ConfigError.
    """
    record = storage.read_toml(path, "a goal file (TOML)", _MAX_BYTES, _EXAMPLE)
    unknown = set(record) - {"goal", "initial"}
    if unknown:
        raise ConfigError(
            f"{path} speaks of {sorted(unknown)[0][:40]!r}; it may hold [[goal]] and [[initial]]; {_EXAMPLE}."
        )
    known = goal_kinds().by_name
    found: dict[str, list[dict[str, Any]]] = {"goal": [], "initial": []}
    for table, items in found.items():
        entries = record.get(table, [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise ConfigError(f"{path}: {table} is not a list of tables; {_EXAMPLE}.")
        for entry in entries:
            kinds = [name for name in known if isinstance(entry.get(name), str)]
            weight = entry.get("weight", 1.0)
            if len(kinds) != 1 or set(entry) - {*kinds, "weight", "crop"} or type(weight) not in (int, float):
                raise ConfigError(
                    f"{path}: a [[{table}]] has one of {', '.join(known)}, and perhaps a weight and a crop; {_EXAMPLE}."
                )
            said, more = entry[kinds[0]], {name: value for name, value in entry.items() if name not in kinds}
            value = said if known[kinds[0]].gives is Gives.WORDS else str(path.parent / said)
            items.append({**more, "kind": kinds[0], "value": value, "weight": float(weight)})
    return found


def read_prompt(text: str, option: str) -> str:
    """Returns words as one line, with symbols such as emoji replaced by their names.

    option: option of the words, for messages.
    Raises ConfigError for no words, more than 10,000 characters, or control characters, such as an escape sequence
    of a terminal. The goal term itself checks if it understands the words.
    """
    if len(text) > MAX_CHARACTERS:
        raise ConfigError(f"{option} was given {len(text)} characters; say it in at most {MAX_CHARACTERS}.")
    line = " ".join(text.split())
    bad = next((mark for mark in line if unicodedata.category(mark) in ("Cc", "Cs", "Co", "Cn")), None)
    if bad is not None:
        raise ConfigError(
            f"{option} was given a control character (U+{ord(bad):04X}), which is no word; "
            "say what shall be painted in plain words."
        )
    marks = []
    for mark in line:
        category = unicodedata.category(mark)
        is_silent = category in ("Cf", "Mn", "Sk") and not unicodedata.combining(mark)
        marks.append(f" {unicodedata.name(mark, '').lower()} " if category == "So" else "" if is_silent else mark)
    spoken = " ".join("".join(marks).split())
    if not spoken:
        raise ConfigError(f'{option} was given no words; say what shall be painted, such as {option} "a sailing ship".')
    return spoken


def title_of(prompt: str) -> str:
    """Returns the words as a title; only their beginning if they are long."""
    short = prompt if len(prompt) <= _TITLE else f"{prompt[: _TITLE - 1].rstrip()}…"
    return short[0].upper() + short[1:]


def name_of(prompt: str) -> str:
    """Returns the words as a file name: small letters, digits and hyphens, at most 40 characters."""
    plain = unicodedata.normalize("NFKD", prompt).encode("ascii", "ignore").decode().lower()
    return re.sub("[^a-z0-9]+", "-", plain)[:40].strip("-") or "words"


# Records of pictures that were made from words (frida_painter_words/picture_makers/making.py)

MAKING = "making.json"
"""Record of a making, beside its pictures."""
MAKING_FORMAT, MAKING_VERSION = "frida-painter making", 1


def making_file(picture: Path) -> Path | None:
    """Returns the file beside a picture that records its making, of this picture alone or of several; else None."""
    files = (picture.with_suffix(f".{MAKING}"), picture.parent / MAKING)
    return next((file for file in files if storage.exists(file)), None)


def read_making(picture: Path) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """Returns the record of the making of a picture, and the entry of this picture in it, known by its hash.

    None if there is no record beside the picture, or if the record is of other pictures.
    """
    if (file := making_file(picture)) is None:
        return None
    try:
        record = storage.read_json(file, "the record of a making")
        content = storage.sha256(picture, "a made picture")
        same = [one for one in record.get("pictures", ()) if one.get("sha256") == content]
        mine = next((one for one in same if one["file"] == record.get("chosen")), same[0] if same else None)
        known = record.get("format") == MAKING_FORMAT and record.get("version") == MAKING_VERSION
    except (FridaError, AttributeError, KeyError, TypeError):  # it belongs to nothing
        return None
    return (record, mine) if known and mine is not None else None


def making_facts(*items: GoalItem) -> tuple[tuple[str, str], ...]:
    """Returns how pictures of the goal were made, for page and record, as (label, description)."""
    found = []
    for item in items:
        if item.path is not None and (made := read_making(item.path)) is not None:
            record, picture = made
            facts = [str(fact) for name, fact in record["facts"].items() if name != "sha256"]
            maker = ", ".join((record["maker"], *facts))
            found.append(("Made", f"{picture['file']} from “{record['words']}” by {maker}, seed {picture['seed']}"))
    return tuple(found)


def _plain(items: tuple[GoalItem, ...], *, beginning: bool) -> tuple[GoalItem, ...]:
    return tuple(parse_field(partial(GoalItem.plain, beginning=beginning), item) for item in items)


_AsItems = BeforeValidator(
    lambda value: tuple(map(GoalItem.of, value)) if isinstance(value, list | tuple) else value,
    json_schema_input_type=Sequence[GoalItem | Mapping[str, Any]],
)
Items = Annotated[tuple[GoalItem, ...], _AsItems, AfterValidator(partial(_plain, beginning=False))]
InitialItems = Annotated[tuple[GoalItem, ...], _AsItems, AfterValidator(partial(_plain, beginning=True))]
