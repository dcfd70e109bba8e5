"""Locks on a studio's folder: held by every studio that is open there, and by the one listener for stops."""

import fcntl
import os
from pathlib import Path


class StudioLock:
    """Shared by all studios that are open in a folder; taken alone by a listener for stops that is about to end."""

    def __init__(self, folder: Path, name: str = ".studio") -> None:
        self._file = os.open(folder / name, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)

    def share(self) -> None:
        """Holds it with others; waits for whoever has it alone."""
        fcntl.flock(self._file, fcntl.LOCK_SH)

    def take_alone(self) -> bool:
        """Whether nobody held it; it is held alone from now on."""
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def fileno(self) -> int:
        """What a child process needs to hold it too."""
        return self._file

    def release(self) -> None:
        """Lets others have it, once a child that holds it has ended, too."""
        os.close(self._file)
