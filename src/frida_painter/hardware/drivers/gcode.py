"""The robot kinds `gcode` and `marlin`: machines with GRBL or Marlin that follow G-code over a serial line.

Each line is sent when the machine has acknowledged the one before. The machine itself plans a few millimetres
ahead. This program keeps no queue, so nothing can move the machine after an error.
"""

import re
import time
from dataclasses import dataclass, field
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import FridaError, MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.drivers.interlock import PATIENCE, Interlock, motion_timeout
from frida_painter.hardware.gcode import PREAMBLE, Gcode, Servo
from frida_painter.hardware.kinds import MachineName, Needed, RobotKind, at_port, require_home, yes_or_no
from frida_painter.hardware.robot import MotionReport, Point, Waypoints, Workspace

# Serial line of text lines: writes are complete, reads have a deadline.

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
        """Opens port `name` ("/dev/ttyUSB0", "COM3") at `baud` bits per second.

        Raises RobotError if pyserial is not installed.
        Raises RobotDisconnected, which lists the existing ports, if this one cannot be opened.
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

    def close(self) -> None:
        """Closes the port; a second call does nothing."""
        self._port.close()

    def _gone(self, cause: Exception) -> RobotDisconnected:
        return RobotDisconnected(f"The serial line {self.name} is gone ({_reason(cause)}); look at its cable.")


def _reason(cause: Exception) -> str:
    text = " ".join((getattr(cause, "strerror", None) or str(cause)).split())
    if "Inappropriate ioctl" in text:
        return "it is no serial port"
    return text.rpartition("] ")[2] or type(cause).__name__


def _ports() -> str:
    """Returns a sentence on the ports of this computer."""
    from serial.tools.list_ports import comports

    known = [f"{port.device} ({port.description})" for port in comports()]
    if not known:
        return "This computer has no serial ports; plug the machine in, and look at its cable."
    return f"There are: {', '.join(sorted(known))}."


# The line protocol of Marlin (marlinfw.org, "Host interface"): numbered lines with checksums, resent on request.

_MARLIN_SLICE = 0.05
_MAX_RESENDS = 3
_PLACE = re.compile(r"X:\s*(-?[\d.]+)\s+Y:\s*(-?[\d.]+)\s+Z:\s*(-?[\d.]+)")


class Marlin:
    """Firmware Marlin over an open line. Implements drivers.gcode.Firmware."""

    def __init__(self, line: SerialLine, interlock: Interlock) -> None:
        self._line, self._interlock = line, interlock
        self._number = 0
        self._said = ""

    def greet(self, homing: bool) -> None:
        """Asks until the machine answers, because many machines restart first; then numbers lines from 0."""
        until = time.monotonic() + PATIENCE
        answer: str | None = None
        while answer != "ok":
            if time.monotonic() > until:
                raise RobotDisconnected(
                    f"{self._interlock.name} did not answer in {PATIENCE:.0f} s; is this Marlin, and at this baud rate?"
                )
            self._line.write(b"\nM110 N0\n")
            heard = time.monotonic() + 1
            while answer != "ok" and time.monotonic() < heard:
                answer = self._line.read(_MARLIN_SLICE)
        while (
            self._line.read(4 * _MARLIN_SLICE) is not None
        ):  # the machine's greeting, and answers to repeated questions
            pass
        self._number = 0
        if homing:
            self.send("G28", "homing", None, time.monotonic() + 90)

    def send(self, line: str, label: str, waypoint: int | None, until: float) -> None:
        """Sends a numbered line, at most three times if it arrives damaged."""
        self._number += 1
        for _ in range(_MAX_RESENDS):
            self._line.write(_number_line(self._number, line))
            if self._await_ok(line, label, waypoint, until):
                return
        raise RobotDisconnected(
            f"{label}: {self._interlock.name} got {line!r} damaged {_MAX_RESENDS} times; look at the cable."
        )

    def settle(self, label: str, until: float) -> None:
        """Returns when M400 is acknowledged: everything before it is done."""
        self.send("M400", label, None, until)

    def position(self) -> NDArray[np.float64]:
        """Returns the machine's own position [3], mm (M114)."""
        self._said = ""
        self.send("M114", "pose", None, time.monotonic() + PATIENCE)
        found = _PLACE.search(self._said)
        try:
            if found is not None:
                return np.array([float(number) for number in found.groups()])
        except ValueError:
            pass
        raise RobotDisconnected(
            f"{self._interlock.name} said {self._said[:80]!r} when asked for its place; look at its line."
        )

    def hold(self) -> None:
        """Sends a quick stop (M410) on a new line, after any partial command; the machine obeys it on arrival."""
        self._line.write(b"\nM410\n")

    def forget(self) -> None:
        """Does nothing: the quick stop has emptied the machine's queue."""

    def _await_ok(self, line: str, label: str, waypoint: int | None, until: float) -> bool:
        """Returns True if the line was acknowledged, False if it must be sent again. Raises the errors reported."""
        again = False
        while time.monotonic() <= until:
            answer = self._line.read(_MARLIN_SLICE)
            if self._interlock.stopped:
                raise RobotStopped(
                    f"{label}: {self._interlock.name} was stopped; look at it before it is connected anew."
                )
            if answer is None or not answer:
                continue
            if answer.startswith("ok"):
                return not again
            if answer.startswith("Resend:"):
                wanted = answer.removeprefix("Resend:").strip()
                if wanted != str(self._number):
                    raise RobotDisconnected(
                        f"{label}: {self._interlock.name} wants line {wanted[:20]} and not {self._number}; lines were "
                        "lost. Look at the cable."
                    )
                again = True
            elif answer == "start" or (answer.startswith(("Error:", "!!")) and not _is_about_a_line(answer)):
                raise self._report_failure(answer, label, waypoint)
            elif _PLACE.search(answer):
                self._said = answer
        raise RobotDisconnected(
            f"{label}: {self._interlock.name} did not acknowledge {line!r} in time; a line was lost, or this is no "
            "Marlin. Look at the cable and the baud rate."
        )

    def _report_failure(self, answer: str, label: str, waypoint: int | None) -> RobotError:
        where = "" if waypoint is None else f" at waypoint {waypoint}"
        if answer == "start":
            return MotionFailed(
                f"{label}: {self._interlock.name} was reset{where}; it has forgotten where it is. Look at it, home it, "
                "then connect anew.",
                "reset",
                waypoint,
            )
        told = answer.removeprefix("Error:")[:80]
        return MotionFailed(
            f"{label}: {self._interlock.name} failed{where}: {told!r}. Look at it, then connect anew.", told, waypoint
        )


def _is_about_a_line(answer: str) -> bool:
    """Returns True for an error that Marlin follows with a request to resend a line."""
    return "checksum" in answer.lower() or "Line Number" in answer


def _number_line(number: int, line: str) -> bytes:
    """Returns the line in Marlin's format: its number before it, and the exclusive or of all bytes behind it."""
    content = f"N{number} {line}".encode("ascii")
    checksum = 0
    for byte in content:
        checksum ^= byte
    return content + f"*{checksum}\n".encode("ascii")


# The line protocol of GRBL 1.1 (github.com/gnea/grbl, "Interface"): acknowledged lines, real-time bytes, reports.

_HOLD, _RESET, _STATUS = b"!", b"\x18", b"?"
_GRBL_SLICE = 0.05
_ASK_AFTER = 0.5
_HOMING = 90.0
_MAX_REPORTS = 40  # At least one report in thirty contains the offset of the work coordinates.
_ALARMS = {
    "1": "a limit switch was hit",
    "2": "the way leads beyond the machine's own limits",
    "3": "it was reset while it moved",
    "6": "homing was interrupted",
    "8": "homing did not free the limit switch",
    "9": "homing found no limit switch",
}
_STANDING = {
    "Alarm": "is in an alarm",
    "Hold": "is held: its feed hold was pressed, or something else has asked for that",
    "Door": "stands, because its safety door is open",
    "Door:0": "stands, because its safety door was opened; the door is closed again",
    "Sleep": "is asleep",
    "Check": "only checks what it is sent, and does not move",
}
_ERRORS = {
    "8": "it was not idle",
    "9": "it is locked by an alarm",
    "15": "beyond its travel",
    "20": "an unknown command",
    "22": "no feed",
}


@dataclass(frozen=True)
class _Report:
    state: str
    numbers: dict[str, NDArray[np.float64]]


class Grbl:
    """Firmware GRBL over an open line. Implements drivers.gcode.Firmware."""

    def __init__(self, line: SerialLine, interlock: Interlock) -> None:
        self._line, self._interlock = line, interlock
        self._offset: NDArray[np.float64] | None = None

    def greet(self, homing: bool) -> None:
        """Asks until the machine answers, because many boards restart when their line is opened."""
        state = self._ask().state
        if state.startswith("Alarm") and homing:
            self.send("$H", "homing", None, time.monotonic() + _HOMING)
            state = self._ask().state
        if not state.startswith("Idle"):
            raise RobotError(
                f"{self._interlock.name} is not ready: it says {state!r}. Look at it, home or release it with its own "
                "controls (or allow homing in its settings), then connect anew; this program never clears an alarm."
            )

    def send(self, line: str, label: str, waypoint: int | None, until: float) -> None:
        """Sends a line and waits for its "ok". A machine that is idle without an "ok" has lost the line."""
        self._line.write(line.encode("ascii") + b"\n")
        idle, ask_at = 0, time.monotonic() + _ASK_AFTER
        while True:
            answer = self._read(label, waypoint)
            if answer == "ok":
                return
            if answer is not None and answer.startswith("<"):
                state = self._parse_report(answer).state
                self._require_running(state, label, waypoint)
                idle = idle + 1 if state.startswith("Idle") else 0
            now = time.monotonic()
            if idle > 2 or now > until:
                how = "it is idle and has not acknowledged" if idle > 2 else "it did not acknowledge in time"
                raise RobotDisconnected(
                    f"{label}: {self._interlock.name}: {how} {line!r}. A line was lost; look at the cable."
                )
            if now > ask_at:
                self._line.write(_STATUS)
                ask_at = now + _ASK_AFTER

    def settle(self, label: str, until: float) -> None:
        """Returns when a dwell is acknowledged and the machine is idle; some acknowledge the dwell too early."""
        self.send("G4 P0.01", label, None, until)
        while not (state := self._ask().state).startswith("Idle"):
            self._require_running(state, label, None)
            if self._interlock.stopped or not time.monotonic() <= until:
                raise RobotStopped(
                    f"{label}: {self._interlock.name} acknowledged the end of its motion, and says {state!r}; it is "
                    "held. Look at it before it is connected anew."
                )
            time.sleep(_GRBL_SLICE)

    def position(self) -> NDArray[np.float64]:
        """Returns the work coordinates [3] of a fresh report, mm."""
        for _ in range(_MAX_REPORTS):
            numbers = self._ask().numbers
            if "WPos" in numbers:
                return numbers["WPos"]
            if "MPos" in numbers and self._offset is not None:
                return numbers["MPos"] - self._offset
        raise RobotError(
            f"{self._interlock.name} does not say where it is in work coordinates; set $10=1 or $10=0 on it."
        )

    def hold(self) -> None:
        """Sends a feed hold: a byte that GRBL obeys at any place of a line. The machine keeps its position."""
        self._line.write(_HOLD)

    def forget(self) -> None:
        """Resets the machine once it stands; a reset in motion would lose its position. Clears no alarm."""
        until = time.monotonic() + 2
        while time.monotonic() < until:
            state = self._ask().state
            if state.startswith("Alarm"):
                return
            if state in ("Idle", "Hold", "Hold:0"):
                break
        self._line.write(_RESET)

    def _ask(self) -> _Report:
        """Requests a report and returns it. Raises RobotDisconnected if none comes."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            self._line.write(_STATUS)
            for _ in range(10):
                answer = self._line.read(_GRBL_SLICE)
                if answer is not None and answer.startswith("<"):
                    return self._parse_report(answer)
        raise RobotDisconnected(
            f"{self._interlock.name} gave no report of its state in {PATIENCE:.0f} s; is this GRBL, and at this baud "
            "rate?"
        )

    def _require_running(self, state: str, label: str, waypoint: int | None) -> None:
        """Raises MotionFailed if the state needs a person, and RobotStopped after a stop."""
        if self._interlock.stopped:
            raise RobotStopped(f"{label}: {self._interlock.name} was stopped; look at it before it is connected anew.")
        kind = state.partition(":")[0]
        meaning = _STANDING.get(state) or _STANDING.get(kind)
        if meaning is None:
            return
        where = "" if waypoint is None else f" at waypoint {waypoint}"
        remedy = (
            "clear the alarm with its own controls; this program never does"
            if kind == "Alarm"
            else "see that it can move, reset it with its own controls, then connect anew"
        )
        raise MotionFailed(
            f"{label}: {self._interlock.name} {meaning}{where}; it says {state!r}. Look at it, and {remedy}.",
            state,
            waypoint,
        )

    def _read(self, label: str, waypoint: int | None) -> str | None:
        """Returns one line of the machine, None if none came. Raises the errors that it reports."""
        answer = self._line.read(_GRBL_SLICE)
        if self._interlock.stopped:
            raise RobotStopped(f"{label}: {self._interlock.name} was stopped; look at it before it is connected anew.")
        if answer is None or answer in ("", "ok") or answer.startswith(("<", "[", "$")):
            return answer
        where = "" if waypoint is None else f" at waypoint {waypoint}"
        if answer.startswith("error:"):
            code = answer.removeprefix("error:").strip()
            meaning = f" ({_ERRORS[code]})" if code in _ERRORS else ""
            raise MotionFailed(
                f"{label}: {self._interlock.name} refused a line{where} with error {code}{meaning}; it is held. "
                "Look at it, then connect anew.",
                code,
                waypoint,
            )
        if answer.startswith("ALARM:"):
            code = answer.removeprefix("ALARM:").strip()
            meaning = f" ({_ALARMS[code]})" if code in _ALARMS else ""
            raise MotionFailed(
                f"{label}: {self._interlock.name} stopped{where} with alarm {code}{meaning}. Look at it and clear the "
                "alarm with its own controls; this program never does.",
                code,
                waypoint,
            )
        if answer.startswith("Grbl "):
            raise MotionFailed(
                f"{label}: {self._interlock.name} was reset{where}; it has forgotten what it had to do, and perhaps "
                "where it is. Look at it, then connect anew.",
                "reset",
                waypoint,
            )
        raise RobotDisconnected(
            f"{label}: {self._interlock.name} said {answer[:60]!r}, which is not GRBL's; look at its line."
        )

    def _parse_report(self, report: str) -> _Report:
        """Parses a report: <Idle|MPos:1.000,2.000,3.000|FS:0,0|WCO:0.000,0.000,0.000>. Raises RobotDisconnected."""
        parts = report.strip("<>").split("|")
        numbers: dict[str, NDArray[np.float64]] = {}
        for name, values in re.findall(r"\b(MPos|WPos|WCO):([^|]*)", report.strip("<>")):
            try:
                place = np.array([float(value) for value in values.split(",")])[:3]
            except ValueError:
                place = np.empty(0)
            if place.shape != (3,) or not np.isfinite(place).all():
                raise RobotDisconnected(
                    f"{self._interlock.name} reported {report[:80]!r}, which is no place; look at its line."
                )
            numbers[name] = place
        self._offset = numbers.get("WCO", self._offset)
        return _Report(parts[0], numbers)


@dataclass(frozen=True)
class GcodeSettings:
    """Settings of a G-code machine.

    port: of the serial line
    home: home position of the tip, metres
    baud: bits per second
    gcode: dialect of the machine
    homing: True if the machine may drive to its limit switches on connection; GRBL with such switches needs it
        after each start
    """

    port: str
    home: Point
    baud: int = 115_200
    gcode: Gcode = field(default_factory=Gcode)
    homing: bool = False


class Firmware(Protocol):
    """Firmware of a machine: the parts that differ between GRBL and Marlin."""

    def greet(self, homing: bool) -> None:
        """Waits until the machine is ready to move. Raises RobotDisconnected, RobotError."""

    def send(self, line: str, label: str, waypoint: int | None, until: float) -> None:
        """Sends a line and returns when it is acknowledged, at the latest at `until` (s, monotonic).

        Raises MotionFailed, RobotDisconnected, RobotStopped.
        """

    def settle(self, label: str, until: float) -> None:
        """Returns when the machine stands still after all lines sent. Raises the errors of `send`."""

    def position(self) -> NDArray[np.float64]:
        """Returns the machine's position in its work coordinates, [3] mm. Raises RobotError."""

    def hold(self) -> None:
        """Stops the machine at once, without waiting; may be called from any thread."""

    def forget(self) -> None:
        """Makes a standing machine forget its remaining motions."""


class GcodeRobot:
    """Robot that follows G-code. Implements hardware.robot.Robot. A stop or fault blocks it until `connect`."""

    def __init__(self, settings: GcodeSettings) -> None:
        self.settings = settings
        self._interlock = Interlock(f"the {settings.gcode.flavour} machine on {settings.port}")
        self._line: SerialLine | None = None
        self._firmware: Firmware | None = None
        self._tip: NDArray[np.float64] | None = None

    def connect(self) -> None:
        """Opens the line, waits for the machine and sets millimetres. Moves only if homing is allowed.

        Raises RobotDisconnected if there is no answer, RobotError if the machine is in an alarm, which only a
        person clears.
        """
        self.close()
        line = SerialLine.open(self.settings.port, self.settings.baud)
        kind = Grbl if self.settings.gcode.flavour == "grbl" else Marlin
        firmware: Firmware = kind(line, self._interlock)
        self._interlock.mark_connected()
        try:
            firmware.greet(self.settings.homing)
            for command in PREAMBLE[: 3 if kind is Grbl else 2]:  # Marlin's feeds are always per minute.
                firmware.send(command, "connect", None, time.monotonic() + 5)
            firmware.position()
        except FridaError:
            self._interlock.mark_disconnected()
            line.close()
            raise
        self._line, self._firmware = line, firmware

    def home(self) -> MotionReport:
        """Moves to the home position, first vertically."""
        here = self.pose()
        aside = np.array(self.settings.home)
        above = np.array([here[0], here[1], max(here[2], aside[2])])
        return self.follow(Waypoints("home", np.stack((above, aside)), self.settings.gcode.approach))

    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres. With a servo, its height is that of the last waypoint."""
        firmware = self._ready("pose")
        try:
            return self._metres(firmware.position())
        except FridaError as error:
            raise self._interlock.fault(error) from None

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Moves along the waypoints; returns when the machine stands still, with its position.

        Raises MotionFailed, which names the waypoint, RobotDisconnected or RobotStopped; the machine is then held.
        """
        firmware = self._ready(waypoints.label)
        self._interlock.require_path(waypoints)
        lines = list(self.settings.gcode.lines(waypoints))
        started = time.monotonic()
        try:
            here = self._metres(firmware.position())
            way = float(np.linalg.norm(waypoints.position[0] - here))
            until = started + motion_timeout(waypoints.length, waypoints.speed)
            until += motion_timeout(way, self.settings.gcode.approach) + self._servo_time(waypoints)
            for index, line in lines:
                firmware.send(line, waypoints.label, index, until)
            firmware.settle(waypoints.label, until)
            self._tip = waypoints.position[-1]
            reached = self._metres(firmware.position())
        except FridaError as error:
            self._interlock.fault(error)
            self._halt(firmware)
            raise
        return MotionReport(waypoints.label, started, time.monotonic(), reached)

    def stop(self) -> None:
        """Holds the machine by a command that overtakes all queued lines."""
        self._interlock.stop()
        firmware = self._firmware
        if firmware is not None:
            firmware.hold()

    def close(self) -> None:
        """Closes the line. A stopped machine forgets its remaining motions."""
        line, firmware = self._line, self._firmware
        self._line = self._firmware = None
        self._interlock.mark_disconnected()
        if line is not None and firmware is not None:
            if self._interlock.stopped:
                self._forget(firmware)
            line.close()

    def _ready(self, label: str) -> Firmware:
        self._interlock.require_ready(label)
        if self._firmware is None:
            raise RobotError(f"{label}: {self._interlock.name} is not connected; call connect() first.")
        return self._firmware

    def _halt(self, firmware: Firmware) -> None:
        """Holds the machine after a fault and clears its motions. A lost line is ignored."""
        try:
            firmware.hold()
        except RobotError:
            return
        self._forget(firmware)

    def _forget(self, firmware: Firmware) -> None:
        try:
            firmware.forget()
        except RobotError:
            return

    def _metres(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        metres = position / 1000
        if self.settings.gcode.servo is not None:
            metres[2] = self.settings.gcode.servo.high[0] if self._tip is None else self._tip[2]
        return metres

    def _servo_time(self, waypoints: Waypoints) -> float:
        """Returns the seconds that a servo adds to a motion; 0 without a servo."""
        servo = self.settings.gcode.servo
        if servo is None:
            return 0.0
        heights = np.r_[servo.high[0], waypoints.position[:, 2]]
        return 2 * float(np.abs(np.diff(heights)).sum() + servo.high[0] - servo.low[0]) / servo.speed


def _open(name: MachineName, workspace: Workspace) -> GcodeRobot:
    name.require("baud", "homing", "servo")
    language = Gcode(
        "marlin" if name.kind == MARLIN.name else "grbl",
        workspace.travel_speed,
        name.choose("servo", Servo.of, None),
    )
    return GcodeRobot(
        GcodeSettings(
            name.where,
            require_home(name, workspace),
            name.choose("baud", int, 115_200),
            language,
            name.choose("homing", yes_or_no, False),
        )
    )


def _identify(name: MachineName) -> frozenset[str]:
    return at_port(name.where)


_NEEDED = Needed("pip install 'frida-painter[plotter]'", "serial")
GRBL = RobotKind("gcode", "gcode:PORT[,baud=N][,homing=yes][,servo=Z/S/Z/S]", "GRBL 1.1", _open, _NEEDED, _identify)
MARLIN = RobotKind(
    "marlin", "marlin:PORT[,baud=N][,homing=yes][,servo=Z/DEGREES/Z/DEGREES]", "Marlin", _open, _NEEDED, _identify
)
