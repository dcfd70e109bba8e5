"""`gcode`: a machine that follows G-code over a serial line, with GRBL or Marlin inside.

Lines are sent one at a time, each when the one before was acknowledged: the machine plans a few
millimetres ahead on its own, and nothing that waits in a queue of ours can move it after an error.
"""

import time
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import FridaError, RobotError
from frida_painter.hardware.drivers.grbl import Grbl
from frida_painter.hardware.drivers.interlock import Interlock, time_allowed
from frida_painter.hardware.drivers.marlin import Marlin
from frida_painter.hardware.drivers.serial_line import SerialLine
from frida_painter.hardware.gcode import PREAMBLE, Gcode, Servo
from frida_painter.hardware.kinds import Needed, RobotKind, require_home
from frida_painter.hardware.machine_identity import at_port
from frida_painter.hardware.machine_name import MachineName, yes_or_no
from frida_painter.hardware.robot import MotionReport, Waypoints
from frida_painter.hardware.workspace import Point, Workspace


@dataclass(frozen=True)
class GcodeSettings:
    """port: of the serial line; home: where the tip is aside (m); baud: bits per second; gcode: how it is spoken.

    homing: whether the machine may drive to its limit switches when it is connected, which GRBL with
    such switches wants after each start.
    """

    port: str
    home: Point
    baud: int = 115_200
    gcode: Gcode = field(default_factory=Gcode)
    homing: bool = False


class Firmware(Protocol):
    """What GRBL and Marlin do differently."""

    def greet(self, homing: bool) -> None:
        """Waits until the machine is ready to move. Raises RobotDisconnected, RobotError."""

    def send(self, line: str, label: str, waypoint: int | None, until: float) -> None:
        """Sends a line and returns when it was acknowledged, at the latest at `until` (s, monotonic).

        Raises MotionFailed, RobotDisconnected, RobotStopped.
        """

    def settle(self, label: str, until: float) -> None:
        """Returns when the machine stands still after all that was sent. Raises as `send` does."""

    def position(self) -> NDArray[np.float64]:
        """Where the machine says that it is, [3] mm of its work coordinates. Raises RobotError."""

    def hold(self) -> None:
        """Stops the machine as it is, at once and without waiting for anything; from any thread."""

    def forget(self) -> None:
        """Once the machine stands, makes it forget what it still had to do."""


class GcodeRobot:
    """Implements hardware.robot.Robot. After a stop or a fault it moves only when connected anew."""

    def __init__(self, settings: GcodeSettings) -> None:
        self.settings = settings
        self._interlock = Interlock(f"the {settings.gcode.flavour} machine on {settings.port}")
        self._line: SerialLine | None = None
        self._firmware: Firmware | None = None
        self._tip: NDArray[np.float64] | None = None

    def connect(self) -> None:
        """Opens the line, waits for the machine's greeting and sets millimetres. Moves only where homing is allowed.

        Raises RobotDisconnected where nobody answers, and RobotError where the machine is in an alarm,
        which only a person clears.
        """
        self.close()
        line = SerialLine.open(self.settings.port, self.settings.baud)
        kind = Grbl if self.settings.gcode.flavour == "grbl" else Marlin
        firmware: Firmware = kind(line, self._interlock)
        self._interlock.opened()
        try:
            firmware.greet(self.settings.homing)
            for command in PREAMBLE[: 3 if kind is Grbl else 2]:  # Marlin's feeds are always per minute.
                firmware.send(command, "connect", None, time.monotonic() + 5)
            firmware.position()
        except FridaError:
            self._interlock.closed()
            line.close()
            raise
        self._line, self._firmware = line, firmware

    def home(self) -> MotionReport:
        """Goes aside, by way of the height of its place there."""
        here = self.pose()
        aside = np.array(self.settings.home)
        above = np.array([here[0], here[1], max(here[2], aside[2])])
        return self.follow(Waypoints("home", np.stack((above, aside)), self.settings.gcode.approach))

    def pose(self) -> NDArray[np.float64]:
        """Where the tip is, [3] metres; the height of a brush on a servo is what it was told last."""
        firmware = self._ready("pose")
        try:
            return self._metres(firmware.position())
        except FridaError as error:
            raise self._interlock.fault(error) from None

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Moves along the waypoints; returns when the machine stands still and says where.

        Raises MotionFailed, naming the waypoint, RobotDisconnected and RobotStopped; the machine is
        held then.
        """
        firmware = self._ready(waypoints.label)
        self._interlock.require_path(waypoints)
        lines = list(self.settings.gcode.lines(waypoints))
        started = time.monotonic()
        try:
            here = self._metres(firmware.position())
            way = float(np.linalg.norm(waypoints.position[0] - here))
            until = started + time_allowed(waypoints.length, waypoints.speed)
            until += time_allowed(way, self.settings.gcode.approach) + self._servo_time(waypoints)
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
        """Holds the machine by its own command for that, which overtakes everything that waits."""
        self._interlock.stop()
        firmware = self._firmware
        if firmware is not None:
            firmware.hold()

    def close(self) -> None:
        """Lets go of the line; a machine that was stopped forgets what it still had to do."""
        line, firmware = self._line, self._firmware
        self._line = self._firmware = None
        self._interlock.closed()
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
        """After a fault: the machine stands, and forgets the rest. A line that is gone cannot be told."""
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
        """Seconds that a servo takes to rise and sink besides; none where there is no servo."""
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
