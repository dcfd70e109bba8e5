"""Inbox of a painting or of another job: commands, and answers to questions, from any page to the process that works.

It is a file in the folder of the painting, or of the job. Each message is good once and for seconds, and the file only
grows. So nothing is done twice, and a message that nobody heard is not heeded later, when nobody expects it.
"""

import secrets
import time
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from frida_painter.easel.dialogue import Answer, EnterAddress, GuideMove, JogMove
from frida_painter.easel.kinds import INBOX, LIVE
from frida_painter.errors import ConfigError, Interrupted, StorageError
from frida_painter.system import storage
from frida_painter.system.event_log import FEED, EventLog, LogReader
from frida_painter_together.commands import PageCommand

FOLLOWED = "followed"
"""File that the page's process renews every few seconds while a page follows the work in its folder."""
LEAD_GOOD_FOR = 10.0
"""Seconds within which a message must be heard."""
_MAX_READ = 2**21  # bytes at a time; the longest message is a stroke of a person, with 0.5 MB
_KEPT = ".asked.json"  # hidden: it may name programs of this machine, which are nobody's who takes the painting away


def make_live_path(folder: Path, kind: str, suffix: str, *, alone: bool = False) -> Path:
    """Returns a file for a picture that pages show; its name is random, because everybody who knows it may see it.

    folder: of the painting or the job.
    alone: True to remove the former pictures of that kind.
    """
    if alone:
        for before in (folder / LIVE).glob(f"{kind}-{24 * '[0-9a-f]'}{suffix}"):
            before.unlink()
    return folder / LIVE / f"{kind}-{secrets.token_hex(12)}{suffix}"


class KeptRequest(BaseModel):
    """Request of a page that is written into a folder, for the process that does it.

    _name: what is asked, in words.
    _key, _file: its name in the file, and that file.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    _name: ClassVar[str]
    _key: ClassVar[str] = "asked"
    _file: ClassVar[str] = _KEPT

    def keep(self, folder: Path) -> None:
        """Writes the request into the folder. Raises StorageError."""
        storage.write_json(folder / self._file, {self._key: self.model_dump(mode="json")})

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Returns the request from the folder. Raises StorageError."""
        record = storage.read_json(folder / cls._file, cls._name)
        try:
            return cls.model_validate(record[cls._key])
        except (KeyError, ValidationError) as cause:
            raise StorageError(f"The request ({cls._name}) is damaged; ask again.") from cause


class MakingOrder(KeptRequest):
    """Request for pictures of words, completed with the maker, which a page knows only by its label.

    maker: as in `--imagine NAME:TEXT`.
    width, height: of the canvas in mm.
    """

    _name = "which pictures are to be made"

    words: str
    maker: str
    label: str
    minutes: float
    seed: int = 0
    width: float = 14 * 25.4
    height: float = 11 * 25.4


# Answers to a question, checked by the page's process and again by the one that asks.

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


# Messages


class Message(BaseModel):
    """Message of a person: a command, or the answer to a question.

    nonce: random text that is used once.
    until: end of its validity, seconds since 1970.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    nonce: str = Field(strict=True, min_length=16, max_length=64)
    until: float = Field(strict=True, allow_inf_nan=False)
    command: PageCommand | None = None
    reply: Reply | None = None

    @model_validator(mode="after")
    def _is_one_thing(self) -> Self:
        if (self.command is None) == (self.reply is None):
            raise ValueError("A message is either a command or an answer.")
        return self


def send(folder: Path, said: PageCommand | Reply) -> None:
    """Writes a command or an answer into the inbox of a folder. Raises StorageError."""
    what = {"reply": said} if isinstance(said, Reply) else {"command": said}
    message = Message.model_validate({"nonce": secrets.token_hex(16), "until": time.time() + LEAD_GOOD_FOR, **what})
    with EventLog(folder / INBOX, FEED) as log:
        log.append(message.model_dump(mode="json", exclude_none=True))


class Inbox:
    """Reads the messages in the inbox of a folder; each valid one once, and a bounded part of the file at a time.

    since: moment from which on they count, seconds since 1970; earlier ones were for another process or question.
    """

    def __init__(self, folder: Path, since: float) -> None:
        self._since = since
        self._reader = LogReader(folder / INBOX, _MAX_READ)
        self._heard: dict[str, float] = {}  # messages that are still good: nonce, end

    def listen(self) -> list[Message]:
        """Returns new messages in order, without invalid, late or earlier ones."""
        found: dict[str, Message] = {}
        for line in self._reader.read():
            with suppress(ValidationError):
                sent, now = Message.model_validate(line), time.time()
                good = max(now, self._since + LEAD_GOOD_FOR) <= sent.until <= now + LEAD_GOOD_FOR
                if good and sent.nonce not in self._heard:
                    found[sent.nonce] = sent
        now = time.time()
        self._heard = {nonce: until for nonce, until in self._heard.items() if until >= now}
        self._heard |= {nonce: sent.until for nonce, sent in found.items()}
        return list(found.values())
