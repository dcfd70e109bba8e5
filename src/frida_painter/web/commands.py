"""Commands from the page to a painting, and answers to questions: their forms, and the files that carry them."""

import secrets
import time
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from frida_painter.easel.dialogue import Answer, Corners, JogMove
from frida_painter.errors import ConfigError
from frida_painter.event_log import FEED, EventLog, LogReader
from frida_painter.web.studio_folder import PaintingFolder

LEAD_GOOD_FOR = 10.0
"""Seconds within which a command must arrive."""


class Role(IntEnum):
    """Role of a user of the studio; each role includes the rights of the lower ones."""

    watch = 1
    plan = 2
    operate = 3


# Commands to a running painting; each is done between two strokes, or in a pause.

Kind = Literal["pause", "go on", "look", "leave out", "turns", "spare", "only", "free", "goal"]


@dataclass(frozen=True)
class Pause:
    """Command to finish the stroke, clean the brush, move the arm home and wait."""


@dataclass(frozen=True)
class GoOn:
    """Command to end the pause."""


@dataclass(frozen=True)
class LookAgain:
    """Command to look at the canvas and replan the rest."""


@dataclass(frozen=True)
class LeaveOut:
    """Command to leave out the last `count` strokes of the plan."""

    count: int


@dataclass(frozen=True)
class TakeTurns:
    """Command to take turns: the robot paints `count` strokes, then the person paints. 0: no turns."""

    count: int


@dataclass(frozen=True)
class Protect:
    """Command to protect the region with this number, or, with `only`, to paint only inside it."""

    record: int
    only: bool


@dataclass(frozen=True)
class Free:
    """Command to end the protection of a region."""


@dataclass(frozen=True)
class ChangeGoal:
    """Command to paint towards the goal with this number; the paints stay."""

    record: int


PaintingCommand = Pause | GoOn | LookAgain | LeaveOut | TakeTurns | Protect | Free | ChangeGoal


def command(kind: str, *, count: int = 0, record: int = 0) -> PaintingCommand:
    """Returns the command of a kind. Raises ConfigError for an unknown kind."""
    match kind:
        case "pause":
            return Pause()
        case "go on":
            return GoOn()
        case "look":
            return LookAgain()
        case "leave out":
            return LeaveOut(count)
        case "turns":
            return TakeTurns(count)
        case "spare" | "only":
            return Protect(record, only=kind == "only")
        case "free":
            return Free()
        case "goal":
            return ChangeGoal(record)
        case _:
            raise ConfigError(
                f"There is no command {kind[:40]!r}; there are pause, go on, look, leave out, turns, spare, only, "
                "free and goal."
            )


# File of commands from the page: each command is good once and for seconds, and the file only grows.
#
# So no command is done twice. A command that the painter missed is not done later, when nobody expects it.


class Command(BaseModel):
    """Command to the painter, as it is written.

    nonce: random text that is used once.
    until: end of its validity, seconds since 1970.
    by: id of the browser.
    count: strokes to leave out, or strokes of a turn.
    record: number of a region or a goal in the painting's folder.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    kind: Kind
    nonce: str = Field(min_length=16, max_length=64)
    until: float = Field(allow_inf_nan=False)
    by: str = Field(max_length=64)
    count: int = Field(0, ge=0, le=20_000)
    record: int = Field(0, ge=0, le=100_000)

    @property
    def meaning(self) -> PaintingCommand:
        """Command as an object for the painter."""
        return command(self.kind, count=self.count, record=self.record)


def tell_painter(folder: PaintingFolder, kind: Kind, by: str, *, count: int = 0, record: int = 0) -> None:
    """Writes a command for the painter. Raises StorageError."""
    nonce, until = secrets.token_hex(16), time.time() + LEAD_GOOD_FOR
    told = Command(kind=kind, nonce=nonce, until=until, by=by, count=count, record=record)
    writer = EventLog(folder.commands, FEED)
    try:
        writer.append(told.model_dump())
    finally:
        writer.close()


class CommandReader:
    """Reads the commands on the painter's side; each valid command once.

    since: start of this painter, seconds since 1970; earlier commands were for the one before it.
    """

    def __init__(self, folder: PaintingFolder, since: float) -> None:
        self._since = since
        self._reader = LogReader(folder.commands)
        self._heard: set[str] = set()

    def listen(self) -> list[PaintingCommand]:
        """Returns new commands in order, without invalid, late or earlier ones."""
        told = [each for line in self._reader.read() if (each := self._parse(line)) is not None]
        self._heard |= {each.nonce for each in told}
        return [each.meaning for each in told]

    def _parse(self, line: dict[str, Any]) -> Command | None:
        try:
            told = Command.model_validate(line)
        except ValidationError:
            return None
        good = max(time.time(), self._since + LEAD_GOOD_FOR) <= told.until <= time.time() + LEAD_GOOD_FOR
        return told if good and told.nonce not in self._heard else None


# Answers to a worker's question, checked by the page's process and again by the worker.

_Pixel = Annotated[float, Field(ge=-(2.0**16), le=2.0**16, allow_inf_nan=False)]
_Corner = Annotated[list[_Pixel], Field(min_length=2, max_length=2)]


class Reply(BaseModel):
    """Answer of a person; exactly one field suits the question.

    yes: answer to Confirm.
    corners: (column, row) pixels, clockwise from the top left.
    step: metres of one press of a jog key; `settled` if the height is right.
    length: metres.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    question: str = Field(min_length=16, max_length=64)
    yes: bool | None = None
    corners: list[_Corner] | None = Field(None, min_length=4, max_length=4)
    step: float | None = Field(None, ge=-1, le=1, allow_inf_nan=False)
    settled: bool = False
    length: float | None = Field(None, ge=0, le=10, allow_inf_nan=False)

    @property
    def words(self) -> str:
        """Answer in a few words, for the record of the studio."""
        if self.step is not None and not self.settled:
            return f"moved by {1000 * self.step:+.1f} mm"
        if self.length is not None:
            return f"{1000 * self.length:.1f} mm"
        if self.yes is not None:
            return "yes" if self.yes else "no"
        return "corners" if self.corners is not None else "settled"

    def answering(self, kind: str, asked: dict[str, Any]) -> Answer:
        """Returns the answer to a question in the form of `described`. Raises ConfigError if it does not fit."""
        if kind == "confirm" and self.yes is not None:
            return self.yes
        if kind == "corners" and self.corners is not None:
            return _within(self.corners, asked)
        if kind == "jog" and (self.settled or self.step is not None):
            move = JogMove(self.step or 0.0, self.settled)
            if self.settled or asked["lowest"] <= asked["height"] + move.step <= asked["highest"]:
                return move
            raise ConfigError(f"The brush moves from {_millimetres(asked)}; it cannot go further that way.")
        if kind == "measure" and self.length is not None:
            if asked["lowest"] <= self.length <= asked["highest"]:
                return self.length
            raise ConfigError(f"It is from {_millimetres(asked)}; measure again.")
        raise ConfigError("This is no answer to what is asked; reload the page.")


class _Sent(BaseModel):
    """Reply on its way to the worker.

    until: end of its validity, seconds since 1970.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    until: float = Field(allow_inf_nan=False)
    by: str = Field(max_length=64)
    reply: Reply


def reply(folder: PaintingFolder, answer: Reply, by: str) -> None:
    """Writes a person's reply for the worker. Raises StorageError."""
    writer = EventLog(folder.replies, FEED)
    try:
        writer.append(_Sent(until=time.time() + LEAD_GOOD_FOR, by=by, reply=answer).model_dump(mode="json"))
    finally:
        writer.close()


def parse_answer(line: dict[str, Any], number: str, asked: dict[str, Any]) -> Answer | None:
    """Returns the answer of a line to question `number`; None if it is not valid or too late."""
    try:
        sent = _Sent.model_validate(line)
        answer = sent.reply.answering(asked["kind"], asked)
    except (ValidationError, ConfigError):
        return None
    good = time.time() <= sent.until <= time.time() + LEAD_GOOD_FOR
    return answer if good and sent.reply.question == number else None


def _within(corners: list[list[float]], asked: dict[str, Any]) -> Corners:
    most = asked["columns"], asked["rows"]
    if not all(-1 <= place <= end for corner in corners for place, end in zip(corner, most, strict=True)):
        raise ConfigError("A corner lies outside the photograph; drag it back into it.")
    return tuple((column, row) for column, row in corners)


def _millimetres(asked: dict[str, Any]) -> str:
    return f"{1000 * asked['lowest']:.1f} to {1000 * asked['highest']:.1f} mm"
