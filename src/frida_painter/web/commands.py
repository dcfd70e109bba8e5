"""What the page tells the painter: a few commands, each good once and for seconds, in a file that only grows.

Nothing is done twice, and nothing that was asked while the painter could not hear is done later, when
nobody expects it.
"""

import secrets
import time
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from frida_painter.event_log import FEED, EventLog, LogReader
from frida_painter.session.commands import Kind, PaintingCommand, command
from frida_painter.web.folder import PaintingFolder
from frida_painter.web.lead import GOOD_FOR


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
    nonce, until = secrets.token_hex(16), time.time() + GOOD_FOR
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
        good = max(time.time(), self._since + GOOD_FOR) <= told.until <= time.time() + GOOD_FOR
        return told if good and told.nonce not in self._heard else None
