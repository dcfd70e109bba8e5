"""Commands from the page to a painting, and answers to questions: their forms, and the files that carry them."""

import secrets
import time
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StrictBool,
    TypeAdapter,
    ValidationError,
    model_validator,
)

from frida_painter.easel.dialogue import Answer, EnterAddress, GuideMove, JogMove
from frida_painter.errors import ConfigError, Interrupted
from frida_painter.event_log import FEED, EventLog, LogReader
from frida_painter.session.events import PEN_LIMITS
from frida_painter_studio.picture_choosing import MakerLabel, PlainWords
from frida_painter_studio.studio_folder import Identifier, PaintingFolder, PaintingRequest

LEAD_GOOD_FOR = 10.0
"""Seconds within which a command must arrive."""


class Role(IntEnum):
    """Role of a user of the studio; each role includes the rights of the lower ones."""

    watch = 1
    plan = 2
    operate = 3


# Commands to a running painting; each is done between two strokes, or in a pause.
#
# A command has one form from the page to the painter: the page sends it as JSON, pydantic checks it at the door, the
# file carries it, and the painter performs it.

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
    keep: Literal["welcome", "protect"] = "welcome"
    kind: Literal["turns"] = "turns"


@dataclass(frozen=True)
class Protect(_Command):
    """Command to protect a region, or, with `only`, to paint only inside it.

    picture: id of an uploaded drawing of the region, light on dark.
    """

    picture: Identifier
    only: StrictBool
    kind: Literal["protect"] = "protect"


@dataclass(frozen=True)
class GivePicture(_Command):
    """Command to take a person's picture of the canvas for a look, in a painting without a camera.

    picture: id of the uploaded picture.
    """

    picture: Identifier
    kind: Literal["picture"] = "picture"


@dataclass(frozen=True)
class ChangeGoal(_Command):
    """Command to paint towards the goals of another request; canvas, brush and paints stay."""

    request: PaintingRequest
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


Command = Annotated[
    Simple | LeaveOut | TakeTurns | Protect | GivePicture | ChangeGoal | Propose | PaintStroke,
    Field(discriminator="kind"),
]


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


def describe(command: Command) -> str:
    """Returns a command in a line, for the record of the studio."""
    unshown = "kind", "points", "request", "words"
    facts = [f"{name} {value}" for name, value in to_plain(command).items() if name not in unshown]
    return ", ".join([command.kind, *facts])


# Answers to a worker's question, checked by the page's process and again by the worker.

_Pixel = Annotated[float, Field(ge=-(2.0**16), le=2.0**16, allow_inf_nan=False)]
_Metres = Annotated[float, Field(ge=-1, le=1, allow_inf_nan=False)]
_Corner = Annotated[list[_Pixel], Field(min_length=2, max_length=2)]


class Reply(BaseModel):
    """Answer of a person; exactly one field suits the question.

    yes: answer to Confirm.
    corners: (column, row) pixels, clockwise from the top left.
    step: metres of one press of a jog key; `settled` if the height or the place is right.
    length: metres.
    move: metres along x, y and z, of one press of a guiding key.
    choice: index of the chosen thing.
    address: on the network, or the name of a port.
    leave: True to leave a dialogue that can be continued later.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    question: str = Field(min_length=16, max_length=64)
    yes: bool | None = None
    corners: list[_Corner] | None = Field(None, min_length=4, max_length=4)
    step: float | None = Field(None, ge=-1, le=1, allow_inf_nan=False)
    settled: bool = False
    length: float | None = Field(None, ge=0, le=10, allow_inf_nan=False)
    move: list[_Metres] | None = Field(None, min_length=3, max_length=3)
    choice: int | None = Field(None, ge=0, le=999)
    address: str | None = Field(None, max_length=160)
    leave: bool = False

    @property
    def words(self) -> str:
        """Answer in a line, for the record of the studio."""
        given = self.model_dump(exclude={"question"}, exclude_defaults=True)
        return ", ".join(f"{name} {value}" for name, value in given.items())

    def answering(self, kind: str, asked: dict[str, Any]) -> Answer:
        """Returns the answer to a question as `describe_question` tells it. Raises ConfigError if it does not fit."""
        limits = f"{1000 * asked.get('lowest', 0):.1f} to {1000 * asked.get('highest', 0):.1f} mm"
        if kind == "confirm" and self.yes is not None:
            return self.yes
        if kind == "corners" and self.corners is not None:
            most = asked["columns"], asked["rows"]
            if all(-1 <= place <= end for corner in self.corners for place, end in zip(corner, most, strict=True)):
                return tuple((column, row) for column, row in self.corners)
            raise ConfigError("A corner lies outside the photograph; drag it back into it.")
        if kind == "jog" and (self.settled or self.step is not None):
            move = JogMove(self.step or 0.0, self.settled)
            if self.settled or asked["lowest"] <= asked["height"] + move.step <= asked["highest"]:
                return move
            raise ConfigError(f"The brush moves from {limits}; it cannot go further that way.")
        if kind == "measure" and self.length is not None:
            if asked["lowest"] <= self.length <= asked["highest"]:
                return self.length
            raise ConfigError(f"It is from {limits}; measure again.")
        if kind == "guide" and (self.settled or self.move is not None):
            x, y, z = self.move or (0.0, 0.0, 0.0)
            return GuideMove((x, y, z), self.settled)
        if kind == "choose" and self.choice is not None and self.choice < len(asked["things"]):
            return self.choice
        if kind == "address" and self.address is not None:
            question = EnterAddress("", asked["port"])
            if question.allows(self.address):
                return self.address
            raise ConfigError(f"It has a form like {question.example}; type it again.")
        raise ConfigError("This is no answer to what is asked; reload the page.")


# Inbox of a worker: each message is good once and for seconds, and the file only grows.
#
# So nothing is done twice. A message that the worker missed is not heeded later, when nobody expects it.


class Message(BaseModel):
    """Message of a person from the page to the worker: a command, or the answer to a question.

    nonce: random text that is used once.
    until: end of its validity, seconds since 1970.
    by: id of the browser.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    nonce: str = Field(strict=True, min_length=16, max_length=64)
    until: float = Field(strict=True, allow_inf_nan=False)
    by: str = Field(strict=True, max_length=64)
    command: Command | None = None
    reply: Reply | None = None

    @model_validator(mode="after")
    def _is_one_thing(self) -> Self:
        if (self.command is None) == (self.reply is None):
            raise ValueError("A message is either a command or an answer.")
        return self


def tell_worker(folder: PaintingFolder, said: Command | Reply, by: str) -> None:
    """Writes a command or an answer for the worker. Raises StorageError."""
    what = {"reply": said} if isinstance(said, Reply) else {"command": said}
    until = time.time() + LEAD_GOOD_FOR
    message = Message.model_validate({"nonce": secrets.token_hex(16), "until": until, "by": by, **what})
    with EventLog(folder.inbox, FEED) as log:
        log.append(message.model_dump(mode="json", exclude_none=True))


class Inbox:
    """Reads the messages on the worker's side; each valid one once.

    since: moment from which on they count, seconds since 1970; earlier ones were for another worker or question.
    """

    def __init__(self, folder: PaintingFolder, since: float) -> None:
        self._since = since
        self._reader = LogReader(folder.inbox)
        self._heard: set[str] = set()

    def listen(self) -> list[Message]:
        """Returns new messages in order, without invalid, late or earlier ones."""
        found: dict[str, Message] = {}
        for line in self._reader.read():
            with suppress(ValidationError):
                sent, now = Message.model_validate(line), time.time()
                good = max(now, self._since + LEAD_GOOD_FOR) <= sent.until <= now + LEAD_GOOD_FOR
                if good and sent.nonce not in self._heard:
                    found[sent.nonce] = sent
        self._heard |= found.keys()
        return list(found.values())


def accept_reply(given: Reply | None, number: str, asked: dict[str, Any]) -> Answer | None:
    """Returns the answer to question `number`; None if it is none.

    Raises Interrupted if the person leaves a dialogue that may be left.
    """
    if given is None or given.question != number:
        return None
    if given.leave and asked.get("leave") is True:
        raise Interrupted("You left; what was done before is kept.")
    try:
        return given.answering(asked["kind"], asked)
    except ConfigError:
        return None
