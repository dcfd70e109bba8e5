"""Commands of people who paint along: their forms, from a page to the painter, whoever started it.

A command has one form: the page sends it as JSON, pydantic checks it at the door, the inbox carries it, the painter
performs it, and the journal keeps it. It names a picture by its id: the file lies in `given` of the painting's folder.
"""

import unicodedata
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StrictBool,
    StringConstraints,
    TypeAdapter,
    ValidationError,
    model_validator,
)

from frida_painter.objectives.objective import Gives, goal_kinds
from frida_painter.runs.goal_item import Crop, GoalItem
from frida_painter.session.events import PEN_LIMITS


class Role(IntEnum):
    """Role of a user of the studio; each role includes the rights of the lower ones."""

    watch = 1
    plan = 2
    operate = 3


# Parts of commands: pictures, words and goals.

Identifier = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{32}$")]
_JOINERS = "\N{ZERO WIDTH JOINER}\N{ZERO WIDTH NON-JOINER}"  # parts of emoji, and of words in Persian and Hindi


def tidy(words: Any) -> Any:
    """Returns a text as one line of composed signs (NFC) between single spaces, without signs that nobody sees."""
    if not isinstance(words, str):
        return words

    def seen(mark: str) -> str:
        if mark.isprintable() or mark in _JOINERS:
            return mark
        return "" if unicodedata.category(mark) in ("Cf", "Cs") else " "

    return " ".join("".join(map(seen, unicodedata.normalize("NFC", words))).split())


Words = Annotated[str, BeforeValidator(tidy), StringConstraints(min_length=1, max_length=300)]


def _require_plain(words: str) -> str:
    """Refuses what a program could take for an option or for a file, because a visitor may type anything."""
    if not words[0].isalnum():
        raise ValueError(f"The words begin with {words[0]!r}; begin them with a letter or a digit.")
    return words


PlainWords = Annotated[Words, AfterValidator(_require_plain)]
"""Words that a picture maker may be given."""
MakerLabel = Annotated[str, Field(max_length=200)]


def _find_known(kind: str) -> str:
    known = goal_kinds().by_name
    if kind not in known:
        raise ValueError(f"There is no such kind of goal; there are {', '.join(known)}.")
    return kind


class GoalRequest(BaseModel):
    """One goal: words or the id of an uploaded picture, depending on its kind.

    weight: its importance.
    crop: part of the picture; None for the whole one.
    made: line about how the picture was made from words, for the page.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Annotated[str, AfterValidator(_find_known)]
    picture: Identifier | None = None
    words: Words | None = None
    weight: float = Field(1.0, ge=0.01, le=100, allow_inf_nan=False)
    crop: Crop | None = None
    made: Annotated[str, StringConstraints(max_length=600)] | None = None

    @model_validator(mode="after")
    def _is_one_thing(self) -> Self:
        given, other = (self.words, self.picture) if self._is_of_words else (self.picture, self.words)
        if given is None or other is not None:
            raise ValueError("A goal is either words or a picture; say which words, or choose a picture.")
        if self.words is not None and self.crop is not None:
            raise ValueError("Words cannot be cropped; take the crop away.")
        return self

    @property
    def _is_of_words(self) -> bool:
        return goal_kinds()[self.kind].gives is Gives.WORDS

    def item(self, pictures: Path) -> GoalItem:
        """Returns the goal as a goal item.

        pictures: folder of the pictures, which are named by their ids.
        """
        value = self.words if self.words is not None else str(pictures / f"{self.picture}.png")
        return GoalItem(kind=self.kind, value=value, weight=self.weight, crop=self.crop)


# Commands to a running painting; each is done between two strokes, or in a pause.

_Strokes = Annotated[int, Field(strict=True, ge=0, le=20_000)]


class _Command:
    __pydantic_config__ = ConfigDict(extra="forbid")


@dataclass(frozen=True)
class Simple(_Command):
    """Command without details.

    pause: finish the stroke, clean the brush, move the arm home and wait.
    go on: end the pause.
    finish: finish a painting without a goal as it is.
    look: look at the canvas and replan the rest.
    free: end the protection of a region.
    end making: end the making of pictures, and no other work.
    """

    kind: Literal["pause", "go on", "finish", "look", "free", "end making"]


PAUSE, GO_ON, FINISH, LOOK = Simple("pause"), Simple("go on"), Simple("finish"), Simple("look")
FREE, END_MAKING = Simple("free"), Simple("end making")


@dataclass(frozen=True)
class LeaveOut(_Command):
    """Command to leave out the last `count` strokes of the plan."""

    count: _Strokes
    kind: Literal["leave out"] = "leave out"


@dataclass(frozen=True)
class TakeTurns(_Command):
    """Command to take turns: the robot paints `count` strokes or `minutes`, then the person paints. 0: no turns.

    policy: name of the turn policy by which the robot answers what the person painted.
    keep: "protect" if no stroke may touch the person's paint, "welcome" if it is the beginning of the painting.
    """

    count: _Strokes
    minutes: Annotated[float, Field(ge=0, le=24 * 60, allow_inf_nan=False)] = 0.0
    policy: Annotated[str, Field(strict=True, min_length=1, max_length=40)] = "alternate"
    keep: Literal["welcome", "protect"] = "protect"
    kind: Literal["turns"] = "turns"


@dataclass(frozen=True)
class Protect(_Command):
    """Command to protect a region, or, with `only`, to paint only inside it.

    picture: id of a drawing of the region, light on dark.
    """

    picture: Identifier
    only: StrictBool
    kind: Literal["protect"] = "protect"


@dataclass(frozen=True)
class GivePicture(_Command):
    """Command to take a person's picture of the canvas for a look, in a painting without a camera.

    picture: id of the picture.
    """

    picture: Identifier
    kind: Literal["picture"] = "picture"


@dataclass(frozen=True)
class ChangeGoal(_Command):
    """Command to paint towards other goals, which `terms` and `initial` name as in a request for a painting.

    Canvas, brush and paints stay.
    """

    terms: Annotated[tuple[GoalRequest, ...], Field(min_length=1, max_length=8)]
    initial: Annotated[tuple[GoalRequest, ...], Field(max_length=2)] = ()
    kind: Literal["goal"] = "goal"


@dataclass(frozen=True)
class Propose(_Command):
    """Command to have pictures made that begin from the canvas; the person then chooses one, or goes on.

    words: what is to change.
    maker: label of a maker that is allowed here; its order lies in the painting's folder.
    """

    words: PlainWords
    maker: MakerLabel
    kind: Literal["propose"] = "propose"


@dataclass(frozen=True)
class ChoosePicture(_Command):
    """Command of the terminal, which no page has, to paint towards a proposed picture by its file in the folder."""

    file: Annotated[str, Field(strict=True, max_length=400, pattern=r"^changes/\d{1,6}/[^/\x00-\x1f]+\.png$")]
    kind: Literal["choose"] = "choose"


IN_A_PAUSE = "The robot is painting, and this can be done only in a pause: press Pause, wait, then ask for it again."
ROBOT_MOVES = (
    "The robot is painting, and nobody paints beside an arm that moves: your stroke was not painted. Press Pause, wait "
    "until the arm is aside, then paint."
)
MAX_POINTS = 4000
"""Largest number of points of a person's stroke; the page sends only the points that its mark needs."""


def _require_points(given: Any) -> Any:
    """Refuses what are no points of a pen with a sentence; the painter, who knows the canvas, checks more."""
    count = len(given) if isinstance(given, list | tuple) else 0
    if not 1 <= count <= MAX_POINTS:
        raise ValueError(f"The stroke has {count} points, and a stroke has 1 to {MAX_POINTS}; lift the brush sooner.")
    for number, point in enumerate(given, 1):
        whole = isinstance(point, list | tuple) and len(point) == len(PEN_LIMITS)
        if not whole or not all(type(value) in (int, float) for value in point):
            raise ValueError(
                f"Point {number} of the stroke is not made of {len(PEN_LIMITS)} numbers; reload the page, and paint "
                "it again."
            )
        for (name, least, most), value in zip(PEN_LIMITS, point, strict=True):
            if not least <= value <= most:
                raise ValueError(
                    f"Point {number} of the stroke has a {name} of {value}; it is a number from {least:g} to "
                    f"{most:.4g}. Nothing was painted; paint the stroke again."
                )
    return given


@dataclass(frozen=True)
class PaintStroke(_Command):
    """Command to paint a stroke of the person on the canvas of the virtual studio, in a pause.

    brush: name of a brush of the easel.
    paint: number of a well, from 0.
    points: as in together.turns.PenStroke.
    """

    brush: Annotated[str, Field(strict=True, min_length=1, max_length=40)]
    paint: Annotated[int, Field(strict=True, ge=0, le=99)]
    points: Annotated[tuple[tuple[float, float, float, float, float, float], ...], BeforeValidator(_require_points)]
    kind: Literal["paint"] = "paint"


PageCommand = Annotated[
    Simple | LeaveOut | TakeTurns | Protect | GivePicture | ChangeGoal | Propose | PaintStroke,
    Field(discriminator="kind"),
]
Command = PageCommand | ChoosePicture
_COMMAND: TypeAdapter[Command] = TypeAdapter(Command)


def to_plain(command: Command) -> dict[str, Any]:
    """Returns a command in the form in which the page sends it."""
    return dict(_COMMAND.dump_python(command, mode="json"))


def command_of(plain: dict[str, Any]) -> Command | None:
    """Returns the command of its plain form; None if there is none like that."""
    try:
        return _COMMAND.validate_python(plain)
    except ValidationError:
        return None


def pictures_of(*goals: GoalRequest) -> frozenset[str]:
    """Returns the ids of the pictures that goals need."""
    return frozenset(goal.picture for goal in goals if goal.picture is not None)


def goal_items(pictures: Path, terms: tuple[GoalRequest, ...], initial: tuple[GoalRequest, ...]) -> dict[str, Any]:
    """Returns goals, and goals of the start, in the form of RunSpec; `pictures` as in GoalRequest.item."""
    return {
        "goal": tuple(term.item(pictures) for term in terms),
        "initial": tuple(term.item(pictures) for term in initial),
    }


def describe(command: Command) -> str:
    """Returns a command in a line, for the record of the studio."""
    unshown = "kind", "points", "terms", "initial", "words"
    facts = [f"{name} {value}" for name, value in to_plain(command).items() if name not in unshown]
    return ", ".join([command.kind, *facts])
