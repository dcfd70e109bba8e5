"""The latch: a robot that was stopped stays stopped, also after a restart, until a person re-arms it.

A simulated robot hurts nobody: it stands still until its process ends, and nothing is kept of that (Unlatched).
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
    """Why and when a robot was stopped; at: seconds since 1970; machines: what it is (machine_identity.py), if known.

    damaged: whether the record of it cannot be read, so that it may be of any robot.
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
    """The latch of one easel, kept in a file that only `release` takes away.

    machines: what the robot is, whatever it is called: a stop holds it under every name of easel and robot. A file
    that cannot be read counts as a stop of any robot: whatever damaged it, a person has to look.
    """

    remedy = HOW_TO_ARM
    """What a person has to do before it moves again."""

    def __init__(self, path: Path, easel: str, machines: Iterable[str] = ()) -> None:
        self.path, self.easel, self.machines = path, easel, frozenset(machines)

    def read(self) -> StopRecord | None:
        """The stop that holds, None where the robot may move."""
        own = _read(self.path, self.easel)
        if own is not None or not self.machines:
            return own
        others = [_read(path, path.stem) for path in sorted(self.path.parent.glob("*.json"))]
        return next((stop for stop in others if stop and (stop.damaged or stop.machines & self.machines)), None)

    def engage(self, reason: str) -> StopRecord:
        """Puts a stop down, flushed to the disk; the first reason stays. Raises StorageError."""
        stopped, before = StopRecord(self.easel, reason, time.time(), self.machines), _read(self.path, self.easel)
        if before is None:
            self._write(stopped)
        elif not before.damaged and not self.machines <= before.machines:  # another robot at an easel of that name
            self._write(replace(before, machines=before.machines | self.machines))
        return stopped

    def release(self) -> None:
        """Re-arms: for the person who has looked at the robot, and for nobody else. Raises StorageError."""
        try:
            self.path.unlink(missing_ok=True)
        except OSError as error:
            raise storage.cannot_write(self.path, error) from error

    def _write(self, stop: StopRecord) -> None:
        known = {"easel": stop.easel, "reason": stop.reason, "at": stop.at, "machines": sorted(stop.machines)}
        storage.write_json(self.path, {"format": _FORMAT, "version": _VERSION, **known})


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


def _read(path: Path, easel: str) -> StopRecord | None:
    """The stop in a file, of an easel of that name where the file does not say; None where there is none."""
    if not path.exists():
        return None
    try:
        record = storage.read_json(path, "the record of a stop")
        machines = frozenset(map(str, record.get("machines", ())))
        return StopRecord(str(record["easel"]), str(record["reason"]), float(record["at"]), machines)
    except (StorageError, KeyError, TypeError, ValueError) as damage:
        why = f"the record of the stop is damaged ({damage})"
        return StopRecord(easel, why, path.stat().st_mtime, damaged=True)


def latch_path(state: Path, easel: str) -> Path:
    """Where the latch of an easel of that name is kept, below the folder `state`."""
    return state / "stopped" / f"{re.sub(r'[^A-Za-z0-9._]+', '-', easel)}.json"


def latches(state: Path) -> list[Latch]:
    """All latches below `state` that hold a robot, the first that was stopped first."""
    found = [Latch(path, path.stem) for path in (state / "stopped").glob("*.json")]
    held = [(stop.at, latch) for latch in found if (stop := latch.read()) is not None]
    return [latch for _, latch in sorted(held, key=lambda entry: entry[0])]
