"""Locks on open files: the wait for one is bounded.

A process that can open a file, even only to read it, can lock it for ever. So lock files are made for their owner
alone, and each wait ends. A lock belongs to the open file, which a child process inherits; a lock on a path
(filelock.FileLock) belongs to one process.
"""

import errno
import fcntl
import getpass
import os
import socket
import time
from pathlib import Path

from frida_painter.errors import StorageError

_BETWEEN_TRIES = 0.02  # seconds
_HELD = (errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES)  # some network drives say the last one


def open_lock(path: Path) -> int:
    """Opens a lock file, which nobody but its owner can open; makes it if it is missing. Raises OSError."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK, 0o600)
    if os.fstat(descriptor).st_uid == os.geteuid():
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
            fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
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
        file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
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
        name = str(os.getuid())
    return f"{name}@{socket.gethostname()}"


def release(descriptor: int) -> None:
    """Releases the lock of an open file, also for children that inherited it. Raises OSError."""
    fcntl.flock(descriptor, fcntl.LOCK_UN)
