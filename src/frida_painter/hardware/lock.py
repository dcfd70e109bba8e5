"""One robot, one process: a lock that the system lets go of when its process ends, however it ends."""

import contextlib
import os
from pathlib import Path

from filelock import FileLock, Timeout

from frida_painter import storage
from frida_painter.errors import RobotBusy


class RobotLock:
    """Holds a robot for this process until `release`. Raises RobotBusy, with the other's process id, where it is held.

    The file stays behind, with the number of the process that held it last; a lock of a process that
    died is free. Raises StorageError where there can be no such file.
    """

    def __init__(self, path: Path, robot: str) -> None:
        # Only a lock of the system's own will do: a mere marker file would outlive a process that dies.
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
        """Lets others have the robot."""
        self._lock.release()


def _sign(file: int) -> None:
    with contextlib.suppress(OSError):  # the lock holds without the number, too
        os.ftruncate(file, 0)
        os.pwrite(file, str(os.getpid()).encode(), 0)


def _process(path: Path) -> int | None:
    """The process id in a lock's file, None where there is none (yet)."""
    try:
        with path.open("rb") as file:
            text = file.read(20)
    except OSError:
        return None
    return int(text) if text.isdigit() else None
