"""The start of an easel's process, before anything heavy is loaded here: both processes load at the same time."""

import socket
import subprocess
import sys
import tempfile
from types import TracebackType
from typing import Self


class EaselLaunch:
    """An easel's process that was started and waits for its order; `EaselProcess` takes it over.

    Used in a `with` block, which ends the process where nothing took it over. wire, line: this end of the two sockets
    that easel_host.py explains; complaints: what the process says when it dies, never on the painter's terminal.
    robot: the easel that will be ordered, which is loaded before; nothing is where it is not known yet.
    """

    def __init__(self, robot: str = "") -> None:
        self.wire, its_wire = socket.socketpair()
        self.line, its_line = socket.socketpair()
        self.complaints = tempfile.TemporaryFile()  # noqa: SIM115 (closed with the process)
        sockets = its_wire.fileno(), its_line.fileno()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "frida_painter.easel.host", *map(str, sockets), robot],
            pass_fds=sockets,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self.complaints,
            start_new_session=True,  # Ctrl-C at the terminal is for the painting process alone
        )
        its_wire.close()
        its_line.close()
        self._taken_over = False

    def take_over(self) -> Self:
        """Leaves the end of the process to the caller."""
        self._taken_over = True
        return self

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._taken_over:
            self.process.kill()  # it has nothing yet
            self.process.wait()
            self.wire.close()
            self.line.close()
            self.complaints.close()
