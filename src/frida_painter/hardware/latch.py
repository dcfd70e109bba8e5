"""The latch: a robot that was stopped stays stopped, also after a restart, until a person re-arms it.

A simulated robot hurts nobody: it stands still until its process ends, and nothing is kept of that (Unlatched).
"""

import re
import time
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from frida_painter import storage
from frida_painter.errors import StorageError

HOW_TO_ARM = "look at it, free what has to be freed, then re-arm it: frida-painter arm"
_FORMAT = "frida-painter stop"
_VERSION = 1


@dataclass(frozen=True)
class StopRecord:
    """Why and when a robot was stopped; at: seconds since 1970."""

    easel: str
    reason: str
    at: float

    def __str__(self) -> str:
        when = f"{datetime.fromtimestamp(self.at):%Y-%m-%d at %H:%M:%S}"
        return f"{self.easel} was stopped on {when}: {self.reason.rstrip('.')}"


class Latch:
    """The latch of one easel, kept in a file that only `release` takes away.

    A file that cannot be read counts as a stop: whatever damaged it, a person has to look.
    """

    remedy = HOW_TO_ARM
    """What a person has to do before it moves again."""

    def __init__(self, path: Path, easel: str) -> None:
        self.path, self.easel = path, easel

    def read(self) -> StopRecord | None:
        """The stop that holds, None where the robot may move."""
        if not self.path.exists():
            return None
        try:
            record = storage.read_json(self.path, "the record of a stop")
            return StopRecord(str(record["easel"]), str(record["reason"]), float(record["at"]))
        except (StorageError, KeyError, TypeError, ValueError) as damage:
            return StopRecord(self.easel, f"the record of the stop is damaged ({damage})", self.path.stat().st_mtime)

    def engage(self, reason: str) -> StopRecord:
        """Puts a stop down, flushed to the disk; the first reason stays. Raises StorageError."""
        stopped = StopRecord(self.easel, reason, time.time())
        if not self.path.exists():
            record = {"format": _FORMAT, "version": _VERSION, "easel": self.easel, "reason": reason, "at": stopped.at}
            storage.write_json(self.path, record)
        return stopped

    def release(self) -> None:
        """Re-arms: for the person who has looked at the robot, and for nobody else. Raises StorageError."""
        try:
            self.path.unlink(missing_ok=True)
        except OSError as error:
            raise storage.cannot_write(self.path, error) from error


class Unlatched:
    """In place of a latch, for a simulated easel: a stop holds for as long as the easel's process lives."""

    remedy = "it is simulated and needs no re-arming; resume the painting"

    def __init__(self, easel: str) -> None:
        self.easel = easel

    def read(self) -> None:
        """No stop holds from before, whatever files say."""

    def engage(self, reason: str) -> StopRecord:
        """The stop, of which nothing is written."""
        return StopRecord(self.easel, reason, time.time())


def latch_path(state: Path, easel: str) -> Path:
    """Where the latch of an easel of that name is kept, below the folder `state`."""
    return state / "stopped" / f"{re.sub(r'[^A-Za-z0-9._]+', '-', easel)}.json"


def latches(state: Path) -> list[Latch]:
    """All latches below `state` that hold a robot, the first that was stopped first."""
    found = [Latch(path, path.stem) for path in (state / "stopped").glob("*.json")]
    held = [(stop.at, latch) for latch in found if (stop := latch.read()) is not None]
    return [latch for _, latch in sorted(held, key=lambda entry: entry[0])]
