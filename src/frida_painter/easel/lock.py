"""Locks of machines: one robot, one process. The system releases a lock when its process ends for any reason."""

import contextlib
import hashlib
import os
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path

from filelock import FileLock, Timeout

from frida_painter import storage
from frida_painter.errors import RobotBusy


class RobotLock:
    """Lock on a robot, held by this process until `release`.

    Raises RobotBusy, with the id of the process that holds it, or StorageError if the file cannot be created.
    The file remains, with the id of the last process that held the lock. The lock of a dead process is free.
    """

    def __init__(self, path: Path, robot: str) -> None:
        # Only a lock of the system will do: a marker file would outlive a process that dies.
        self._lock = FileLock(
            path, mode=0o644, fallback_to_soft=False, preserve_lock_file=True, thread_local=False, on_acquired=_sign
        )
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._lock.acquire(blocking=False)
        except Timeout as error:
            holder = _process(path)
            whose = f"process {holder}" if holder else "another process"
            raise RobotBusy(
                f"{robot} is in use by {whose}; wait until that painting is done, or stop it first.", holder
            ) from error
        except OSError as error:
            raise storage.cannot_write(path, error) from error

    def release(self) -> None:
        """Releases the lock."""
        self._lock.release()


def _sign(file: int) -> None:
    with contextlib.suppress(OSError):  # the lock holds without the process id, too
        os.ftruncate(file, 0)
        os.pwrite(file, str(os.getpid()).encode(), 0)


def _process(path: Path) -> int | None:
    """Returns the process id in a lock file; None if there is none (yet)."""
    try:
        with path.open("rb") as file:
            text = file.read(20)
    except OSError:
        return None
    return int(text) if text.isdigit() else None


def hold_machines(stack: ExitStack, state: Path, identities: Iterable[str]) -> None:
    """Locks the machine of these identities until the end of `stack`. Raises RobotBusy and StorageError.

    state: folder of latches and locks
    """
    for identity in sorted(identities):
        path = state / "locks" / f"{hashlib.sha256(identity.encode()).hexdigest()[:16]}.lock"
        stack.callback(RobotLock(path, identity).release)
