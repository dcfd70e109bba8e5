"""Serial line of text lines: writes are complete, reads have a deadline, and opening it does not restart the board."""

import contextlib
import re
import time
from pathlib import Path
from typing import Any, Self

from frida_painter import registry
from frida_painter.errors import RobotDisconnected, RobotError
from frida_painter.hardware.kinds import find_port, remember_port
from frida_painter.hardware.robot import StopLine

_LONGEST = 512
_SLICE = 0.02
_WRITING = 1.0


class SerialLine:
    """Open serial port. Any thread may call `write`; one thread may call `read`."""

    def __init__(self, port: Any, name: str) -> None:
        self.name = name
        self._port = port
        self._rest = b""

    @classmethod
    def open(cls, name: str, baud: int) -> Self:
        """Opens port `name` ("/dev/ttyUSB0", "COM3", "socket://10.0.0.7:23") at `baud` bits per second.

        Many boards restart when their line is opened, because the system raises DTR then. From now on DTR stays
        raised after the line is closed, so that the board does not restart at the next opening.

        Raises RobotError if pyserial is not installed.
        Raises RobotDisconnected, which lists the existing ports, if this one cannot be opened.
        """
        with registry.importing("plotter", "A serial line", RobotError):
            import serial
        device = find_port(name)
        _require_no_modem(device)
        opening = serial.serial_for_url if "://" in device else serial.Serial
        try:
            port = opening(device, baud, timeout=_SLICE, write_timeout=_WRITING, exclusive=True)
        except (OSError, ValueError) as cause:  # SerialException is an OSError
            raise RobotDisconnected(
                f"The serial port {name!r} cannot be opened ({_reason(cause)}). {_advise(name, cause)}{_ports()}"
            ) from cause
        _keep_dtr(port)
        remember_port(name, device)
        return cls(port, device)

    def write(self, content: bytes) -> None:
        """Sends `content` at once. Raises RobotDisconnected if the line is lost."""
        try:
            self._port.write(content)
        except (OSError, TypeError) as cause:  # pyserial raises TypeError if the port is closed during a write
            raise self._gone(cause) from cause

    def read(self, seconds: float) -> str | None:
        """Returns the next line without its end; None if no complete line came within about `seconds`.

        Raises RobotDisconnected if the line is lost or sends more than 512 bytes without an end of line.
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

    @property
    def holds_part(self) -> bool:
        """True if the beginning of a line came and not yet its end."""
        return bool(self._rest)

    def drop_part(self) -> None:
        """Forgets the beginning of a line whose end was lost as the system's buffer was full; whole lines stay."""
        self._rest = self._rest[: self._rest.rfind(b"\n") + 1]

    def stop_line(self, content: bytes) -> StopLine | None:
        """Returns the open port with the bytes that stop its machine; None once it is closed."""
        try:
            return StopLine(self._port.fileno(), content)
        except (OSError, TypeError, AttributeError):  # closed, also in this moment
            return None

    def close(self) -> None:
        """Closes the port; a second call does nothing."""
        with contextlib.suppress(OSError, AttributeError):  # the lock would last as long as a second descriptor
            self._port.exclusive = False
        self._port.close()

    def _gone(self, cause: Exception) -> RobotDisconnected:
        return RobotDisconnected(f"The serial line {self.name} is gone ({_reason(cause)}); look at its cable.")


def _keep_dtr(port: Any) -> None:
    """Keeps DTR raised when the port is closed. Does nothing if the system has no such setting."""
    try:
        import termios
    except ImportError:  # Windows keeps DTR as the driver of the adapter wants it
        return
    with contextlib.suppress(OSError, AttributeError, ValueError, termios.error):
        modes = termios.tcgetattr(port.fileno())
        modes[2] &= ~termios.HUPCL
        termios.tcsetattr(port.fileno(), termios.TCSANOW, modes)


def _reason(cause: Exception) -> str:
    text = " ".join((getattr(cause, "strerror", None) or str(cause)).split())
    if "Inappropriate ioctl" in text:
        return "it is no serial port"
    return text.rpartition("] ")[2] or type(cause).__name__


def _advise(name: str, cause: Exception) -> str:
    """Returns a sentence with the usual remedy for a port that cannot be opened; "" if there is none."""
    path = Path(name)
    if getattr(cause, "errno", None) == 13 or "ermission" in str(cause):
        return f"Your user may not use it: run `sudo usermod -aG {_group(path)} $USER`, log out and in, and try again. "
    if not path.exists() and _is_taken_by_brltty():
        return (
            "The program brltty takes CH340 adapters for Braille displays: remove it (`sudo apt remove brltty`), then "
            "plug the machine in again. "
        )
    return ""


def _group(path: Path) -> str:
    """Returns the group that may use a port, such as dialout."""
    try:
        import grp

        name = grp.getgrgid(path.stat().st_gid).gr_name
    except (ImportError, OSError, KeyError):
        return "dialout"
    return "dialout" if name == "root" else name


def _is_taken_by_brltty() -> bool:
    """Returns True if brltty's rules for USB are installed, and a program has taken a USB device from the system."""
    rules, taken = Path("/usr/lib/udev/rules.d"), Path("/sys/bus/usb/drivers/usbfs")
    return any(rules.glob("*brltty*")) and any(taken.glob("*:*"))


def _require_no_modem(device: str) -> None:
    """Raises RobotError if a port says of itself that it is a modem, which would dial what it is told."""
    from serial.tools.list_ports import comports

    path = str(Path(device).resolve())
    for port in comports():
        about = " ".join(filter(None, (port.description, port.manufacturer, port.product)))
        if str(Path(port.device).resolve()) == path and re.search(r"\b(modem|gsm|lte|wwan)\b", about, re.IGNORECASE):
            raise RobotError(
                f"The port {device} is a modem ({about[:60]}) and no machine; give its own port. {_ports()}"
            )


def _ports() -> str:
    from serial.tools.list_ports import comports

    known = [f"{port.device} ({port.description})" for port in comports()]
    if not known:
        return "This computer has no serial ports; plug the machine in, and look at its cable."
    return f"There are: {', '.join(sorted(known))}."
