"""A serial line that speaks in lines of text: written whole, read with a deadline."""

import time
from typing import Any, Self

from frida_painter.errors import RobotDisconnected, RobotError

_LONGEST = 512
_SLICE = 0.02
_WRITING = 1.0


class SerialLine:
    """One open port; `write` may be called from any thread, `read` from one."""

    def __init__(self, port: Any, name: str) -> None:
        self.name = name
        self._port = port
        self._rest = b""

    @classmethod
    def open(cls, name: str, baud: int) -> Self:
        """Opens port `name` ("/dev/ttyUSB0", "COM3") at `baud` bits per second.

        Raises RobotError where pyserial is not installed, RobotDisconnected, which lists the ports
        that there are, where this one cannot be opened.
        """
        try:
            import serial
        except ImportError as missing:
            raise RobotError(
                "Serial lines need the package pyserial; install it with: pip install 'frida-painter[plotter]'"
            ) from missing
        try:
            port = serial.Serial(name, baud, timeout=_SLICE, write_timeout=_WRITING, exclusive=True)
        except (OSError, ValueError) as cause:  # SerialException is an OSError
            raise RobotDisconnected(
                f"The serial port {name!r} cannot be opened ({_reason(cause)}). {_ports()}"
            ) from cause
        return cls(port, name)

    def write(self, content: bytes) -> None:
        """Sends `content` at once. Raises RobotDisconnected where the line is gone."""
        try:
            self._port.write(content)
        except (OSError, TypeError) as cause:  # pyserial's port turns to None under whoever writes while it is closed
            raise self._gone(cause) from cause

    def read(self, seconds: float) -> str | None:
        """The next line without its end, or None where none was complete within about `seconds`.

        Raises RobotDisconnected where the line is gone or speaks without ever ending a line.
        """
        until = time.monotonic() + seconds
        while b"\n" not in self._rest:
            try:
                self._rest += self._port.read(max(1, self._port.in_waiting))
            except (OSError, TypeError) as cause:
                raise self._gone(cause) from cause
            if len(self._rest) > _LONGEST and b"\n" not in self._rest:
                raise RobotDisconnected(
                    f"What comes through {self.name} are not lines of text; give the baud rate of this machine."
                )
            if b"\n" not in self._rest and time.monotonic() >= until:
                return None
        line, self._rest = self._rest.split(b"\n", 1)
        return line.strip().decode("ascii", "replace")

    def close(self) -> None:
        """Lets go of the port; twice is once."""
        self._port.close()

    def _gone(self, cause: Exception) -> RobotDisconnected:
        return RobotDisconnected(f"The serial line {self.name} is gone ({_reason(cause)}); look at its cable.")


def _reason(cause: Exception) -> str:
    text = " ".join((getattr(cause, "strerror", None) or str(cause)).split())
    if "Inappropriate ioctl" in text:
        return "it is no serial port"
    return text.rpartition("] ")[2] or type(cause).__name__


def _ports() -> str:
    """A sentence on the ports that this machine has."""
    from serial.tools.list_ports import comports

    known = [f"{port.device} ({port.description})" for port in comports()]
    if not known:
        return "This computer has no serial ports; plug the machine in, and look at its cable."
    return f"There are: {', '.join(sorted(known))}."
