"""Work that people at a page of the studio follow and stop: a painting that they lead, a plan, a calibration.

The studio has a folder for each: the work is stopped by a file in it, or by the line to the studio's listener, and
tells there what no journal tells: its waits before the first stroke, and the error that ended it.
"""

import contextlib
import secrets
import socket
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from frida_painter import registry
from frida_painter.easel.kinds import JOURNAL, STOP_FILE
from frida_painter.errors import ConfigError, FridaError, Interrupted, PaintingPaused, RobotStopped, StorageError
from frida_painter.session.events import Advanced, Event, ResultFound, Stopped, record
from frida_painter.system import locks, storage
from frida_painter.system.event_log import FEED, EventLog

FEED_FILE = "feed.jsonl"
"""Name of the file of these events, one per line, in the studio's folder of the work."""
STOP, HEARD, WORK = b"!", b"+", "work"
"""Stop, the answer to it, and the first word of a process at work, followed by a name, the work and a line's end."""
LINE = ".stop"
"""Name of the file in the studio's folder with port and secret of the listener's line, for its owner alone."""
HERE = "127.0.0.1"
_LONGEST = 100  # bytes
_GREETING = 3.0  # seconds
_BETWEEN_CALLS = 0.5  # seconds
_BETWEEN_GLANCES = 0.02
_BETWEEN_STEPS = 0.25  # seconds between two reports of progress, as fine as a person can see


class StopPressed(Exception):
    """Signal that a person has pressed stop; the work reports it and ends."""


def find_listener(folder: Path) -> tuple[int, str]:
    """Returns port and secret of the listener for the studio in `folder`. Raises OSError if there is none."""
    try:
        port, secret = storage.read_bytes(folder / LINE, "the line to the listener", _LONGEST).decode().split()
        return int(port), secret
    except (StorageError, ValueError) as error:
        raise ConnectionRefusedError(f"nobody listens for stops in {folder}") from error


def call(folder: Path) -> socket.socket:
    """Returns a connection to the listener. Raises OSError if there is none."""
    port, secret = find_listener(folder)
    line = socket.create_connection((HERE, port), _GREETING)
    try:
        line.sendall(f"{secret}\n".encode())
        if line.recv(1) != HEARD:
            raise ConnectionRefusedError("another program has the listener's port")
        line.settimeout(None)
    except OSError:
        line.close()
        raise
    return line


class StopWatch:
    """Watches for a stop, by line and by file, in its own threads.

    file: file that stops the work when it exists.
    studio: folder of the listener's line.
    job: its name.
    """

    def __init__(self, file: Path, studio: Path, job: str = "") -> None:
        self.asked = False
        self._file, self._studio, self._job = file, studio, job
        self._turn = threading.Lock()
        self._reactions: list[Callable[[], None]] = []
        threading.Thread(target=self._watch_file, daemon=True, name="stop file").start()
        threading.Thread(target=self._watch_line, daemon=True, name="stop line").start()

    def heed(self) -> None:
        """Raises StopPressed if stop was pressed."""
        if self.asked:
            raise StopPressed

    def then(self, reaction: Callable[[], None]) -> None:
        """Adds a reaction to a stop.

        It runs at once when stop is pressed, in a watching thread. If stop was pressed before, it runs now.
        """
        with self._turn:
            self._reactions.append(reaction)
            asked = self.asked
        if asked:
            reaction()

    def _hear(self) -> None:
        with self._turn:
            first, self.asked = not self.asked, True
            reactions = list(self._reactions)
        if first:
            for reaction in reactions:
                reaction()

    def _watch_file(self) -> None:
        while not storage.exists(self._file):  # False too if the look failed: the next one may succeed
            time.sleep(_BETWEEN_GLANCES)
        self._hear()

    def _watch_line(self) -> None:
        while True:
            with contextlib.suppress(OSError), call(self._studio) as line:
                line.sendall(f"{WORK} {self._file.parent.name} {self._job}\n".encode())
                while line.recv(1) == STOP:
                    self._hear()
                    line.sendall(HEARD)
            time.sleep(_BETWEEN_CALLS)  # the listener is gone; the studio starts another one


@dataclass
class Feed:
    """Writes events for the page. If the disk is full, events are left out; the journal handles that fault."""

    folder: Path
    _log: EventLog = field(init=False)
    _told: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        self._log = EventLog(self.folder / FEED_FILE, FEED)

    def tell(self, event: Event) -> None:
        """Writes an event."""
        with contextlib.suppress(StorageError):
            self._log.append(record(event))

    def say(self, sentence: str) -> None:
        """Writes progress in words."""
        self.tell(Advanced(sentence))

    def step(self, share: float, left: float, picture: str = "") -> None:
        """Writes the progress of planning, at most every 0.25 s.

        share: in [0, 1].
        left: remaining seconds.
        picture: file of a new picture of the plan so far, "" if there is none.
        """
        now = time.monotonic()
        if now - self._told >= _BETWEEN_STEPS or share >= 1 or picture:
            self._told = now
            self.tell(Advanced("", round(share, 4), round(left, 1), picture or None))

    def close(self) -> None:
        """Closes the feed."""
        self._log.close()


@contextmanager
def telling_end(feed: Feed, stop: StopWatch, *, paints: bool = False) -> Iterator[None]:
    """Tells the page by which stop or error the work of the block ends; errors pass through, but for a pressed stop.

    paints: True for a painting. If another process has taken it up, it has not ended, and this one was only refused.
    """
    try:
        yield
    except StopPressed:
        feed.tell(Stopped())
    except FridaError as trouble:
        asked = stop.asked and isinstance(trouble, RobotStopped | PaintingPaused | Interrupted)
        said = "" if asked else str(trouble).replace(str(feed.folder), "its folder")
        taken = paints and any(locks.is_held(place / JOURNAL) for place in (feed.folder, feed.folder / "painting"))
        feed.tell(ResultFound("refused", said) if taken else Stopped(said))
        raise
    except Exception as failure:
        mark = secrets.token_hex(4)
        print(mark, traceback.format_exc(), file=sys.stderr)
        told = f"Something went wrong that should not have; its number in the log is {mark}."
        feed.tell(Stopped(str(registry.blame(failure) or told)))
        raise
    finally:
        feed.close()


@dataclass(frozen=True)
class PageLead:
    """Lead of a painting by the people at a page.

    began: start of the work, seconds since 1970.
    """

    feed: Feed
    stop: StopWatch
    began: float

    @classmethod
    @contextmanager
    def open(cls, entry: Path, job: str) -> Iterator[Self]:
        """Yields the lead in the studio's folder of a painting; the page hears how the block ends, as in `telling_end`.

        job: "paint" or "resume".
        Raises ConfigError if there is no such folder.
        """
        if not entry.is_dir():
            raise ConfigError(
                f"--page was given {storage.abridge(entry)}, and there is no such folder; give the studio's folder of "
                "this painting, or leave --page out."
            )
        feed, stop = Feed(entry), StopWatch(entry / STOP_FILE, entry.parent, job)
        with telling_end(feed, stop, paints=True):
            yield cls(feed, stop, time.time())
