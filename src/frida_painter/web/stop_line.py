"""The line by which a stop reaches a worker: a local socket in the studio's folder, from process to process.

Nothing is written to a disk, and nobody waits for anything: the listener for stops (stop_listener.py) says one byte to
each worker, which answers with one when it has done what it does. The stop file is the second way, for a worker that
has not called yet, and where there is no listener.
"""

import contextlib
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

STOP, HEARD = b"!", b"+"
WORK, PRESS, END = "work", "press", "end"
"""How a caller begins, followed by a name and a line's end: a worker, a stop, the listener's end."""
_SOCKET = ".stop"
_LONGEST = 100  # bytes; a local socket's address has at most 104 to 108
_BETWEEN_CALLS = 0.5  # seconds
_BETWEEN_GLANCES = 0.02


class StopPressed(Exception):
    """A person has pressed stop; the worker tells so and ends."""


@contextmanager
def address(folder: Path) -> Iterator[str]:
    """Where the listener of the studio in `folder` is called, in so few bytes as a local socket's address may have."""
    whole = str(folder.absolute() / _SOCKET)
    if len(os.fsencode(whole)) <= _LONGEST:
        yield whole
        return
    opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{opened}/{_SOCKET}"
    finally:
        os.close(opened)


def listen_locally(folder: Path) -> socket.socket:
    """A socket that those who may write in the folder can call, in the place of one that is left. Raises OSError."""
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    (folder / _SOCKET).unlink(missing_ok=True)
    with address(folder) as place:
        listening.bind(place)
    (folder / _SOCKET).chmod(0o600)
    listening.listen(64)
    return listening


def call(folder: Path) -> socket.socket:
    """A connection to the listener. Raises OSError where there is none."""
    line = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        with address(folder) as place:
            line.connect(place)
    except OSError:
        line.close()
        raise
    return line


class StopWatch:
    """Learns that a person has pressed stop, by line or by file, on threads of its own.

    file: where it appears, the worker stops; studio: the folder in which the listener is called.
    """

    def __init__(self, file: Path, studio: Path) -> None:
        self.asked = False
        self._file, self._studio = file, studio
        self._turn = threading.Lock()
        self._reactions: list[Callable[[], None]] = []
        threading.Thread(target=self._watch_file, daemon=True, name="stop file").start()
        threading.Thread(target=self._watch_line, daemon=True, name="stop line").start()

    def heed(self) -> None:
        """Ends what is being done where stop was pressed."""
        if self.asked:
            raise StopPressed

    def then(self, reaction: Callable[[], None]) -> None:
        """What else is to be done at once when stop is pressed, on a thread of the watch; now, where it was pressed."""
        with self._turn:
            self._reactions.append(reaction)
            asked = self.asked
        if asked:
            reaction()

    def _hear(self) -> None:
        with self._turn:
            first, self.asked = not self.asked, True
            reactions = list(self._reactions)
        if first:
            for reaction in reactions:
                reaction()

    def _watch_file(self) -> None:
        while not self._file.exists():
            time.sleep(_BETWEEN_GLANCES)
        self._hear()

    def _watch_line(self) -> None:
        while True:
            with contextlib.suppress(OSError), call(self._studio) as line:
                line.sendall(f"{WORK} {self._file.parent.name}\n".encode())
                while line.recv(1) == STOP:
                    self._hear()
                    line.sendall(HEARD)
            time.sleep(_BETWEEN_CALLS)  # the listener is gone; the studio starts another one
