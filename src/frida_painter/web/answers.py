"""What a person answers to a worker's question, checked by the page and again by the worker that waits for it."""

import time
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from frida_painter.errors import ConfigError
from frida_painter.event_log import FEED, EventLog
from frida_painter.session.procedures.dialogue import Answer, Corners, JogMove
from frida_painter.web.folder import PaintingFolder
from frida_painter.web.lead import GOOD_FOR

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
        writer.append(_Sent(until=time.time() + GOOD_FOR, by=by, reply=answer).model_dump(mode="json"))
    finally:
        writer.close()


def understood(line: dict[str, Any], number: str, asked: dict[str, Any]) -> Answer | None:
    """The answer in a line to question `number`; None where it is none, or came too late."""
    try:
        sent = _Sent.model_validate(line)
        answer = sent.reply.answering(asked["kind"], asked)
    except (ValidationError, ConfigError):
        return None
    good = time.time() <= sent.until <= time.time() + GOOD_FOR
    return answer if good and sent.reply.question == number else None


def _within(corners: list[list[float]], asked: dict[str, Any]) -> Corners:
    most = asked["columns"], asked["rows"]
    if not all(-1 <= place <= end for corner in corners for place, end in zip(corner, most, strict=True)):
        raise ConfigError("A corner lies outside the photograph; drag it back into it.")
    return tuple((column, row) for column, row in corners)


def _millimetres(asked: dict[str, Any]) -> str:
    return f"{1000 * asked['lowest']:.1f} to {1000 * asked['highest']:.1f} mm"
