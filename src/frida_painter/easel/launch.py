"""The start of an easel's process, before the heavy imports here: both processes then load at the same time."""

import socket
import subprocess
import tempfile
from types import TracebackType
from typing import Self

from frida_painter import python_process


class EaselLaunch:
    """Started easel process that waits for its order; `EaselProcess` takes it over.

    robot: name of the easel that will be ordered, to be loaded early; "" if it is not known yet
    wire, line: this end of the two sockets (see easel/host.py)
    complaints: error output of the process, never shown on the painter's terminal

    Used in a `with` block, which ends the process if nothing took it over.
    """

    def __init__(self, robot: str = "") -> None:
        self.wire, its_wire = socket.socketpair()
        self.line, its_line = socket.socketpair()
        self.complaints = tempfile.TemporaryFile()  # noqa: SIM115 (closed with the process)
        sockets = its_wire.fileno(), its_line.fileno()
        self.process = python_process.start(
            "-m", "frida_painter.easel.host", *sockets, robot,
            pass_fds=sockets, stdout=subprocess.DEVNULL, stderr=self.complaints,
            start_new_session=True,  # Ctrl-C at the terminal is for the painting process only
        )  # fmt: skip
        its_wire.close()
        its_line.close()
        self._taken_over = False

    def take_over(self) -> Self:
        """Hands the process over to the caller, which must end it."""
        self._taken_over = True
        return self

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._taken_over:
            self.process.kill()  # it holds nothing yet
            self.process.wait()
            self.wire.close()
            self.line.close()
            self.complaints.close()
