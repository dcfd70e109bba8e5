"""Locks on open files: the wait for one is bounded.

A process that can open a file, even only to read it, can lock it for ever. So lock files are made for their owner
alone, and each wait ends. A lock belongs to the open file, which a child process inherits; a lock on a path
(filelock.FileLock) belongs to one process.
"""

import errno
import getpass
import os
import socket
import threading
import time
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from frida_painter.errors import StorageError
from frida_painter.system.operating_system import IS_WINDOWS, NOT_LINKS, open_file, user

if TYPE_CHECKING:
    import subprocess

if IS_WINDOWS:
    msvcrt: Any = import_module("msvcrt")
else:
    import fcntl

_BETWEEN_TRIES = 0.02  # seconds
_HELD = (errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES)  # some network drives say the last one


def open_lock(path: Path) -> int:
    """Opens a lock file, which nobody but its owner can open; makes it if it is missing. Raises OSError."""
    descriptor = open_file(path, os.O_RDWR | os.O_CREAT | NOT_LINKS, 0o600)
    if not IS_WINDOWS and os.fstat(descriptor).st_uid == user():
        os.fchmod(descriptor, 0o600)  # an earlier version let others open it
    return descriptor


def take(descriptor: int, seconds: float = 0.0, *, shared: bool = False) -> bool:
    """Takes the lock of an open file; returns False if another process held it all the time.

    seconds: of the wait
    shared: True if others may hold it as well
    Raises StorageError if the file system has no locks, as some network drives.
    """
    patience = time.monotonic() + seconds
    while True:
        try:
            _lock(descriptor, shared=shared)
        except OSError as error:
            if error.errno not in _HELD:
                raise StorageError(
                    f"Its drive has no locks ({error.strerror}), and two programs that write there would spoil a "
                    "painting; choose a folder on a disk of this machine, or copy this one there."
                ) from error
            if time.monotonic() >= patience:
                return False
            time.sleep(_BETWEEN_TRIES)
        else:
            return True


def is_held(path: Path) -> bool:
    """Returns True if a process holds the lock of this file; it takes the lock from nobody. Raises OSError."""
    try:
        file = open_file(path, os.O_RDONLY)
    except FileNotFoundError:
        return False
    try:
        return not take(file, shared=True)  # shared: two processes that look do not see one another
    except StorageError:  # nobody can hold one there
        return False
    finally:
        os.close(file)


def who() -> str:
    """Returns the name of the person and of the machine, as in "ada@studio"."""
    try:
        name = getpass.getuser()
    except (OSError, KeyError):
        name = str(user())
    return f"{name}@{socket.gethostname()}"


def release(descriptor: int) -> None:
    """Releases the lock of an open file, also for children that inherited it. Raises OSError."""
    if IS_WINDOWS:
        os.lseek(descriptor, _BEHIND, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_UNLCK, _SHARES)
    else:
        fcntl.flock(descriptor, fcntl.LOCK_UN)


@dataclass(frozen=True)
class Held:
    """Lock of an open file that a new process inherits (python_process.start)."""

    file: int

    def fileno(self) -> int:
        """Returns the descriptor."""
        return self.file

    def hand(self, process: "subprocess.Popen[bytes]") -> None:
        """Leaves the lock to a process that has inherited it; on Windows this one holds it until that one ends."""
        if IS_WINDOWS:
            file = os.dup(self.file)
            threading.Thread(target=_close_after, args=(file, process), daemon=True).start()


def _close_after(file: int, process: "subprocess.Popen[bytes]") -> None:
    process.wait()
    os.close(file)


# Windows locks bytes, for one process, and nobody else can read them: those behind the longest file are taken.
_BEHIND, _SHARES = 2**31 - 2**10, 64


def _lock(descriptor: int, *, shared: bool) -> None:
    """Takes the lock of an open file without a wait. Raises OSError with an errno of `_HELD` if another has it."""
    if not IS_WINDOWS:
        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        return
    for place in range(_SHARES if shared else 1):  # whoever shares it has one byte, otherwise all
        os.lseek(descriptor, _BEHIND + place, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1 if shared else _SHARES)
        except OSError as error:
            if error.errno not in _HELD or place == _SHARES - 1 or not shared:
                raise
        else:
            return
