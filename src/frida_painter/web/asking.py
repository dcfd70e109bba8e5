"""Questions that a worker asks the person at the page, and waits for: calibration, paints to fill, strokes in doubt."""

import secrets
import time
from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from torch import Tensor

from frida_painter import images
from frida_painter.errors import ConfigError
from frida_painter.session.procedures.dialogue import (
    Answer,
    Confirm,
    Corners,
    Jog,
    JogMove,
    Measure,
    PointCorners,
    Question,
)
from frida_painter.web.feed import Feed
from frida_painter.web.folder import PaintingFolder
from frida_painter.web.lines import LineReader, LineWriter
from frida_painter.web.stop import Stop

GOOD_FOR = 10.0  # seconds
_BETWEEN_GLANCES = 0.04


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
    writer = LineWriter(folder.replies)
    try:
        writer.add(_Sent(until=time.time() + GOOD_FOR, by=by, reply=answer).model_dump(mode="json"))
    finally:
        writer.close()


@dataclass
class Asker:
    """Puts questions on the page; `answer` is what a procedure's dialogue and an attendant want."""

    folder: PaintingFolder
    feed: Feed
    stop: Stop
    _pictures: int = field(default=0, init=False)

    def answer(self, question: Question) -> Answer:
        """What the person says, who is waited for. Raises StopPressed where they stop everything."""
        number = secrets.token_hex(8)
        asked = described(question)
        picture = None if isinstance(question, Measure) else question.picture
        if picture is not None:
            asked |= {"picture": self._show(picture), "rows": picture.shape[1], "columns": picture.shape[2]}
        reader = LineReader(self.folder.replies)
        reader.read()  # what was said before does not count
        self.feed.tell("asked", question={"id": number, **asked})
        while True:
            self.stop.heed()
            for line in reader.read():
                answer = _understood(line, number, asked)
                if answer is not None:
                    self.feed.tell("answered")
                    return answer
            time.sleep(_BETWEEN_GLANCES)

    def _show(self, picture: Tensor) -> str:
        self._pictures += 1
        name = f"question-{self._pictures:04d}.jpg"
        images.save(picture, self.folder.live / name)
        (self.folder.live / f"question-{self._pictures - 2:04d}.jpg").unlink(missing_ok=True)
        return name


def described(question: Question) -> dict[str, Any]:
    """A question as plain values, but for its picture."""
    match question:
        case Confirm(text=text, proposal=proposal):
            return {"kind": "confirm", "text": text, "proposal": proposal}
        case PointCorners(text=text, proposal=proposal):
            corners = None if proposal is None else [[float(x), float(y)] for x, y in proposal]
            return {"kind": "corners", "text": text, "proposal": corners}
        case Jog():
            step = None if question.proposal is None else question.proposal.step
            told = {"kind": "jog", "text": question.text, "height": question.height, "proposal": step}
            return told | {"lowest": question.lowest, "highest": question.highest}
        case Measure():
            told = {"kind": "measure", "text": question.text, "proposal": question.proposal}
            return told | {"lowest": question.lowest, "highest": question.highest}


def _understood(line: dict[str, Any], number: str, asked: dict[str, Any]) -> Answer | None:
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
