"""A person's say in a painting: heard from the page after every stroke, and done while the painting has paused."""

import secrets
import time
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from frida_painter.easel.dialogue import Answer, Corners, JogMove
from frida_painter.errors import ConfigError
from frida_painter.event_log import FEED, EventLog, LogReader
from frida_painter.web.folder import PaintingFolder

LEAD_GOOD_FOR = 10.0
"""Seconds in which an order has to arrive after it was given."""


class Role(IntEnum):
    """What somebody who uses the studio may do; each may do what those before may."""

    watch = 1
    plan = 2
    operate = 3


# What a person may tell a painting that is being painted; each command is done between two strokes, or in a pause.

Kind = Literal["pause", "go on", "look", "leave out", "turns", "spare", "only", "free", "goal"]


@dataclass(frozen=True)
class Pause:
    """Finish the stroke, clean the brush, step aside and wait."""


@dataclass(frozen=True)
class GoOn:
    """The pause is over."""


@dataclass(frozen=True)
class LookAgain:
    """See what was made of the canvas, and plan the rest again."""


@dataclass(frozen=True)
class LeaveOut:
    """Leave out the last `count` strokes of the plan."""

    count: int


@dataclass(frozen=True)
class TakeTurns:
    """Paint `count` strokes, then it is the person's turn; 0: no turns any more."""

    count: int


@dataclass(frozen=True)
class Protect:
    """Keep clear of what was drawn under this number, or, where `only`, paint there alone."""

    record: int
    only: bool


@dataclass(frozen=True)
class Free:
    """Nothing is protected any more."""


@dataclass(frozen=True)
class ChangeGoal:
    """Go on towards the goal that was put down under this number; the paints stay."""

    record: int


PaintingCommand = Pause | GoOn | LookAgain | LeaveOut | TakeTurns | Protect | Free | ChangeGoal


def command(kind: str, *, count: int = 0, record: int = 0) -> PaintingCommand:
    """The command of a kind. Raises ConfigError where there is none such."""
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


# What the page tells the painter: a few commands, each good once and for seconds, in a file that only grows.
#
# Nothing is done twice, and nothing that was asked while the painter could not hear is done later, when
# nobody expects it.


class Command(BaseModel):
    """Something that a person wants of the painter.

    nonce: used once; until: when it is no longer good, seconds since 1970; by: which browser; count: of
    strokes to leave out, or that the robot paints before it is the person's turn, 0 for all; record:
    the number under which a region or a goal was put into the painting's folder.
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
        """What the painter is to do."""
        return command(self.kind, count=self.count, record=self.record)


def tell_painter(folder: PaintingFolder, kind: Kind, by: str, *, count: int = 0, record: int = 0) -> None:
    """Tells the painter. Raises StorageError."""
    nonce, until = secrets.token_hex(16), time.time() + LEAD_GOOD_FOR
    told = Command(kind=kind, nonce=nonce, until=until, by=by, count=count, record=record)
    writer = EventLog(folder.commands, FEED)
    try:
        writer.append(told.model_dump())
    finally:
        writer.close()


class CommandReader:
    """The painter's end: hears each command that is still good, once.

    since: when this painter began, seconds since 1970; what was said before was said to the one before it.
    """

    def __init__(self, folder: PaintingFolder, since: float) -> None:
        self._since = since
        self._reader = LogReader(folder.commands)
        self._heard: set[str] = set()

    def listen(self) -> list[PaintingCommand]:
        """Commands that came since, in order; those that make no sense, came before or came too late are left out."""
        told = [each for line in self._reader.read() if (each := self._understood(line)) is not None]
        self._heard |= {each.nonce for each in told}
        return [each.meaning for each in told]

    def _understood(self, line: dict[str, Any]) -> Command | None:
        try:
            told = Command.model_validate(line)
        except ValidationError:
            return None
        good = max(time.time(), self._since + LEAD_GOOD_FOR) <= told.until <= time.time() + LEAD_GOOD_FOR
        return told if good and told.nonce not in self._heard else None


# What a person answers to a worker's question, checked by the page and again by the worker that waits for it.

_Pixel = Annotated[float, Field(ge=-(2.0**16), le=2.0**16, allow_inf_nan=False)]
_Corner = Annotated[list[_Pixel], Field(min_length=2, max_length=2)]


class Reply(BaseModel):
    """What a person answers: one of the four, as it suits the question.

    yes: to Confirm; corners: (column, row) pixels, clockwise from the top left; step: metres, one press of a jog
    key, with `settled` where the height is right; length: metres.
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
        """The answer in a few words, for whoever reads later what was asked of the robot."""
        if self.step is not None and not self.settled:
            return f"moved by {1000 * self.step:+.1f} mm"
        if self.length is not None:
            return f"{1000 * self.length:.1f} mm"
        if self.yes is not None:
            return "yes" if self.yes else "no"
        return "corners" if self.corners is not None else "settled"

    def answering(self, kind: str, asked: dict[str, Any]) -> Answer:
        """The answer to a question, as `described` tells of it. Raises ConfigError where it is none."""
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
    """A reply on its way to the worker; until: when it is no longer good, seconds since 1970."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    until: float = Field(allow_inf_nan=False)
    by: str = Field(max_length=64)
    reply: Reply


def reply(folder: PaintingFolder, answer: Reply, by: str) -> None:
    """Hands a person's reply to the worker. Raises StorageError."""
    writer = EventLog(folder.replies, FEED)
    try:
        writer.append(_Sent(until=time.time() + LEAD_GOOD_FOR, by=by, reply=answer).model_dump(mode="json"))
    finally:
        writer.close()


def understood(line: dict[str, Any], number: str, asked: dict[str, Any]) -> Answer | None:
    """The answer in a line to question `number`; None where it is none, or came too late."""
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
