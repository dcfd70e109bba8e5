"""One robot, one process: a lock that the system lets go of when its process ends, however it ends."""

import contextlib
import fcntl
import os
from pathlib import Path

from frida_painter import storage
from frida_painter.errors import RobotBusy


class RobotLock:
    """Holds a robot for this process until `release`. Raises RobotBusy, with the other's process id, where it is held.

    The file stays behind; a lock of a process that died is free.
    """

    def __init__(self, path: Path, robot: str) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise storage.cannot_write(path, error) from error
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            holder = _process(self._file)
            os.close(self._file)
            whose = f"process {holder}" if holder else "another process"
            raise RobotBusy(
                f"{robot} is in use by {whose}; wait until that painting is done, or stop it first.", holder
            ) from error
        with contextlib.suppress(OSError):  # the lock holds without the number, too
            os.ftruncate(self._file, 0)
            os.pwrite(self._file, str(os.getpid()).encode(), 0)

    def release(self) -> None:
        """Lets others have the robot."""
        os.close(self._file)


def _process(file: int) -> int | None:
    """The process id in a lock's file, None where there is none (yet)."""
    text = os.pread(file, 20, 0)
    return int(text) if text.isdigit() else None
