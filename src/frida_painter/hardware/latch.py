"""The latch: a stopped robot stays stopped, also after a restart, until a person re-arms it.

A simulated robot hurts nobody. It stands still until its process ends, and its stop is not stored (Unlatched).
"""

import re
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from frida_painter import storage
from frida_painter.errors import StorageError

HOW_TO_ARM = "look at it, free what has to be freed, then re-arm it: frida-painter arm"
_FORMAT = "frida-painter stop"
_VERSION = 1


@dataclass(frozen=True)
class StopRecord:
    """Record of a stop of a robot, with its reason.

    at: seconds since 1970
    machines: identities of the robot (hardware/kinds.py), if known
    damaged: True if the record cannot be read; it may then concern any robot
    """

    easel: str
    reason: str
    at: float
    machines: frozenset[str] = frozenset()
    damaged: bool = False

    def __str__(self) -> str:
        when = f"{datetime.fromtimestamp(self.at):%Y-%m-%d at %H:%M:%S}"
        return f"{self.easel} was stopped on {when}: {self.reason.rstrip('.')}"


class Latch:
    """Latch of one easel, kept in a file that only `release` deletes.

    machines: identities of the robot; a stop holds it under every name of easel and robot

    An unreadable file counts as a stop of any robot: a person has to look at the cause.
    """

    remedy = HOW_TO_ARM
    """Task for a person before the robot moves again."""

    def __init__(self, path: Path, easel: str, machines: Iterable[str] = ()) -> None:
        self.path, self.easel, self.machines = path, easel, frozenset(machines)

    def read(self) -> StopRecord | None:
        """Returns the stop that holds; None if the robot may move."""
        own = _read(self.path, self.easel)
        if own is not None or not self.machines:
            return own
        others = [_read(path, path.stem) for path in storage.list_files(self.path.parent, "*.json")]
        return next((stop for stop in others if stop and (stop.damaged or stop.machines & self.machines)), None)

    def engage(self, reason: str) -> StopRecord:
        """Stores a stop, flushed to the disk; an earlier reason stays. Raises StorageError."""
        stopped, before = StopRecord(self.easel, reason, time.time(), self.machines), _read(self.path, self.easel)
        if before is None:
            self._write(stopped)
        elif not before.damaged and not self.machines <= before.machines:  # another robot at an easel of the same name
            self._write(replace(before, machines=before.machines | self.machines))
        return stopped

    def release(self) -> None:
        """Re-arms the robot. Only a person who has looked at it may cause this call. Raises StorageError."""
        try:
            self.path.unlink(missing_ok=True)
        except OSError as error:
            raise storage.cannot_write(self.path, error) from error

    def _write(self, stop: StopRecord) -> None:
        known = {"easel": stop.easel, "reason": stop.reason, "at": stop.at, "machines": sorted(stop.machines)}
        storage.write_json(self.path, {"format": _FORMAT, "version": _VERSION, **known})


class Unlatched:
    """Stand-in for the latch of a simulated easel: a stop lasts as long as the easel's process."""

    remedy = "it is simulated and needs no re-arming; resume the painting"

    def __init__(self, easel: str) -> None:
        self.easel = easel

    def read(self) -> None:
        """Returns None: no earlier stop holds."""

    def engage(self, reason: str) -> StopRecord:
        """Returns a stop without storing it."""
        return StopRecord(self.easel, reason, time.time())


def _read(path: Path, easel: str) -> StopRecord | None:
    """Reads the stop in a file, None if there is no file; `easel` is the name to use if the record is damaged.

    A file that changes while it is read, because a stop is stored or released in that moment, is read again.
    """
    while (seen := _state_of(path)) is not None:
        try:
            record = storage.read_json(path, "the record of a stop")
            machines = frozenset(map(str, record.get("machines", ())))
            return StopRecord(str(record["easel"]), str(record["reason"]), float(record["at"]), machines)
        except (StorageError, KeyError, TypeError, ValueError) as damage:
            if seen == _state_of(path):
                why = f"the record of the stop is damaged ({damage})"
                return StopRecord(easel, why, seen[0] / 1e9, damaged=True)
    return None


def _state_of(path: Path) -> tuple[int, int, int] | None:
    """Returns what differs when a file is written anew, its time in nanoseconds first; None without a file."""
    try:
        state = path.stat()
        return state.st_mtime_ns, state.st_ino, state.st_size
    except (FileNotFoundError, NotADirectoryError):
        return None


def latch_path(state: Path, easel: str) -> Path:
    """Returns the path of the latch of an easel, below the folder `state`."""
    return state / "stopped" / f"{re.sub(r'[^A-Za-z0-9._]+', '-', easel)}.json"


def latches(state: Path) -> list[Latch]:
    """Returns all latches below `state` that hold a robot, the earliest stop first."""
    found = [Latch(path, path.stem) for path in storage.list_files(state / "stopped", "*.json")]
    held = [(stop.at, latch) for latch in found if (stop := latch.read()) is not None]
    return [latch for _, latch in sorted(held, key=lambda entry: entry[0])]
