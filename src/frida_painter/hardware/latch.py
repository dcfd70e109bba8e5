"""The latch: a stopped robot stays stopped, also after a restart, until a person re-arms it.

Stops are stored in a folder that all users of the computer share, if it can be written; otherwise in the user's own.
Both are read: a stop counts whoever stored it.

A simulated robot hurts nobody. It stands still until its process ends, and its stop is not stored (Unlatched).
"""

import contextlib
import os
import re
import stat
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from platformdirs import site_data_path

from frida_painter.errors import StorageError
from frida_painter.system import storage
from frida_painter.system.operating_system import user

HOW_TO_ARM = "look at it, free what has to be freed, then re-arm it: frida-painter arm"
SHARED = "FRIDA_PAINTER_STOPS"
"""Environment variable with another folder in place of the computer's own; empty for none."""
_FORMAT = "frida-painter stop"
_VERSION = 1
_LONGEST = 500


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

    path: of the file in the user's own folder, or of a stop that was found
    machines: identities of the robot; a stop holds it under every name of easel and robot
    shared: folder in which a stop is stored if it can be written; None for `path` alone

    An unreadable file counts as a stop of any robot: a person has to look at the cause.
    """

    remedy = HOW_TO_ARM
    """Task for a person before the robot moves again."""

    def __init__(self, path: Path, easel: str, machines: Iterable[str] = (), shared: Path | None = None) -> None:
        self.path, self.easel, self.machines, self._shared = path, easel, frozenset(machines), shared

    def read(self) -> StopRecord | None:
        """Returns the stop that holds; None if the robot may move."""
        own = _read(self.path, self.easel)
        if own is not None or not self.machines:
            return own
        others = filter(None, (_read(path, path.stem) for path in _list(self.path.parent, self._shared)))
        held = (one for one in others if one.damaged or one.easel == self.easel or one.machines & self.machines)
        return next(held, None)

    def engage(self, reason: str) -> StopRecord:
        """Stores a stop, flushed to the disk; an earlier reason stays. Raises StorageError."""
        stopped = StopRecord(self.easel, reason, time.time(), self.machines)
        if self._shared is not None and why_private(self._shared) is None:
            path = self._shared / f"{self.path.stem}.{user()}.json"
            with contextlib.suppress(StorageError, OSError):
                _make_shared(self._shared)
                if not os.path.lexists(path) or path.lstat().st_uid == user():  # else its owner could delete it
                    self._store(path, stopped)
                    return stopped
        self._store(self.path, stopped)
        return stopped

    def release(self) -> None:
        """Re-arms the robot. Only a person who has looked at it may cause this call. Raises StorageError.

        A folder of that name is not deleted but renamed.
        """
        try:
            if self.path.is_dir() and not self.path.is_symlink():
                self.path.rename(self.path.with_name(f"{self.path.name}.armed-{time.time_ns()}"))
            else:
                self.path.unlink(missing_ok=True)
        except OSError as error:
            raise StorageError(
                f"The stop in {storage.abridge(self.path)} cannot be cleared ({error.strerror}); let the user arm it "
                "who stopped the robot, or an administrator: sudo frida-painter arm"
            ) from error

    def _store(self, path: Path, stop: StopRecord) -> None:
        before = _read(path, self.easel)
        if before is not None:
            if before.damaged or self.machines <= before.machines:
                return
            stop = replace(before, machines=before.machines | self.machines)  # another robot at an easel of this name
        known = {"easel": stop.easel, "reason": stop.reason, "at": stop.at, "machines": sorted(stop.machines)}
        storage.write_json(path, {"format": _FORMAT, "version": _VERSION, **known})


class Unlatched:
    """Stand-in for the latch of a simulated easel: a stop lasts as long as the easel's process."""

    remedy = "it is simulated and needs no re-arming; resume the painting"

    def __init__(self, easel: str) -> None:
        self.easel, self.machines = easel, frozenset[str]()

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
            if not stat.S_ISREG(seen[1]):
                raise StorageError("it is no plain file, or may not be looked at")
            record = storage.read_json(path, "the record of a stop")
            at, machines = float(record["at"]), record.get("machines", [])
            datetime.fromtimestamp(at)
            if not isinstance(machines, list):
                raise TypeError("its machines are no list")
            told = StopRecord(
                _printable(record["easel"]), _printable(record["reason"]), at, frozenset(map(str, machines))
            )
        except Exception as damage:  # however it is damaged, it holds
            if seen == _state_of(path):
                return StopRecord(
                    easel, _printable(f"the record of the stop is damaged ({damage})"), seen[0] / 1e9, damaged=True
                )
        else:
            return told
    return None


def _printable(text: object) -> str:
    """Returns a text of a file that another user may have written, without what a terminal obeys."""
    return "".join(letter if letter.isprintable() else " " for letter in str(text)[:_LONGEST])


def _state_of(path: Path) -> tuple[int, int, int, int] | None:
    """Returns what differs when a file is written anew, its time in nanoseconds and its kind first; None without it."""
    try:
        state = path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError:
        return 0, 0, 0, 0
    return state.st_mtime_ns, state.st_mode, state.st_ino, state.st_size


# Folders of stops.


def shared_folder() -> Path | None:
    """Returns the folder of this computer for the stops of all its users; it need not exist, nor be writable.

    It survives a restart. The environment variable `SHARED` names another one, or none.
    """
    told = os.environ.get(SHARED)
    if told is not None:
        return Path(told).absolute() if told else None
    of_all = site_data_path("frida-painter", appauthor=False)
    return (of_all if sys.platform in ("win32", "darwin") else Path("/var/lib/frida-painter")) / "stopped"


def why_private(shared: Path) -> str | None:
    """Returns why stops cannot be stored in a shared folder, as part of a sentence; None if they can be."""
    try:
        storage.require_place(shared, folder=True)
        mode = shared.stat().st_mode if shared.exists() else 0
    except (StorageError, OSError):
        return f"{shared} cannot be written"
    if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:  # anybody could put something else in place of our files
        return f"anybody may delete in {shared} what others wrote"
    return None


def _make_shared(folder: Path, mode: int = 0o1777) -> None:
    """Makes a missing folder in which every user can store stops, and only they and root can delete them."""
    if not folder.exists():
        _make_shared(folder.parent, 0o755)
        folder.mkdir(exist_ok=True)
        folder.chmod(mode)


def _list(*folders: Path | None) -> list[Path]:
    """Returns the files of stops in folders; in place of a folder that may not be listed, the folder itself."""
    found: list[Path] = []
    for folder in filter(None, folders):
        try:
            any(folder.iterdir())
        except (FileNotFoundError, NotADirectoryError):
            continue
        except OSError:
            found.append(folder)
        else:
            found += storage.list_files(folder, "*.json")
    return found


def latch_path(state: Path, easel: str) -> Path:
    """Returns the path of the latch of an easel in the user's own folder, below the folder `state`."""
    return state / "stopped" / storage.file_name(f"{re.sub(r'[^A-Za-z0-9._]+', '-', easel)}.json")


def latch_of(state: Path, easel: str, machines: Iterable[str]) -> Latch:
    """Returns the latch of an easel, in the computer's folder or else below `state`."""
    return Latch(latch_path(state, easel), easel, machines, shared_folder())


def latches(state: Path) -> list[Latch]:
    """Returns all latches that hold a robot, of this computer and below `state`, the earliest stop first."""
    found = [Latch(path, path.stem) for path in _list(state / "stopped", shared_folder())]
    held = [(stop.at, latch) for latch in found if (stop := latch.read()) is not None]
    return [latch for _, latch in sorted(held, key=lambda entry: entry[0])]
