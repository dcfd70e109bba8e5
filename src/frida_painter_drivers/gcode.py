"""The robot kinds `gcode` and `marlin`: machines with GRBL or Marlin that follow G-code over a serial line.

Each line is sent when the machine has acknowledged the one before. The machine itself plans a few millimetres
ahead. This program keeps no queue, so nothing can move the machine after an error. The differences between
firmwares are in drivers/grbl.py and drivers/marlin.py.
"""

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import FridaError, MotionFailed, RobotError
from frida_painter.hardware.gcode import Gcode, Servo
from frida_painter.hardware.interlock import Interlock
from frida_painter.hardware.kinds import (
    MachineName,
    Needed,
    RobotKind,
    at_port,
    millimetres_per_second,
    require_home,
    yes_or_no,
)
from frida_painter.hardware.own_gcode import read_own
from frida_painter.hardware.robot import (
    Examination,
    MachineFact,
    MotionReport,
    Point,
    Sense,
    StopLine,
    Waypoints,
    Workspace,
    Zero,
)
from frida_painter.hardware.timing import AxisTiming, TravelLimits
from frida_painter_drivers.driver import Driver
from frida_painter_drivers.grbl import Grbl
from frida_painter_drivers.marlin import Marlin
from frida_painter_drivers.serial_line import SerialLine


@dataclass(frozen=True)
class GcodeSettings:
    """Settings of a G-code machine.

    port: of the serial line
    home: home position of the tip, metres
    baud: bits per second
    gcode: dialect of the machine
    homing: True if the machine may drive to its limit switches on connection; GRBL with such switches needs it
        after each start
    lowest: robot z of the lowest point of the workspace, metres; None if unknown
    """

    port: str
    home: Point
    baud: int = 115_200
    gcode: Gcode = field(default_factory=Gcode)
    homing: bool = False
    lowest: float | None = None

    @property
    def approach(self) -> float:
        """Speed to the first waypoint of a motion, m/s."""
        return self.gcode.approach


Firmware = Grbl | Marlin


class GcodeRobot(Driver):
    """Robot that follows G-code. A stop or fault blocks it until `connect`.

    Implements hardware.robot.Robot, ZeroedRobot, TimedRobot, LimitedRobot, ExaminedRobot and PausableRobot.
    """

    def __init__(self, settings: GcodeSettings) -> None:
        self.settings = settings
        self._interlock = Interlock(f"the {settings.gcode.flavour} machine on {settings.port}")
        self._line: SerialLine | None = None
        self._firmware: Firmware | None = None
        self._tip: NDArray[np.float64] | None = None
        self._begun = False

    def connect(self) -> None:
        """Opens the line, waits for the machine, reads its settings and sets millimetres. Moves only to home it.

        Raises RobotDisconnected if there is no answer, RobotError if the machine is in an alarm, which only a
        person clears, or if its settings make painting impossible.
        """
        self.close()
        line = SerialLine.open(self.settings.port, self.settings.baud)
        firmware = self._make_firmware(line)
        self._interlock.mark_connected()
        try:
            firmware.greet(release=True)
            refused = [fact.text for fact in self._facts(firmware) if fact.weight == "refusal"]
            if refused:
                raise RobotError(f"{self._interlock.name} cannot paint like this. {' '.join(refused)}")
            self._line, self._firmware, self._begun = line, firmware, False  # from now on it can be stopped
            firmware.prepare()
        except FridaError:
            self._line = self._firmware = None
            self._interlock.mark_disconnected()
            line.close()
            raise

    def examine(self) -> Examination:
        """Connects, reads everything that the machine tells, and disconnects; moves nothing.

        Raises RobotDisconnected if there is no answer.
        """
        line = SerialLine.open(self.settings.port, self.settings.baud)
        try:
            firmware = self._make_firmware(line)
            firmware.greet(release=False)
            return Examination(tuple(self._facts(firmware)), firmware.timing(), self._limits(firmware))
        finally:
            line.close()

    def zero(self) -> Zero:
        """Returns what the machine knows of its zero."""
        firmware = self._ready("zero")
        return Zero(firmware.zero_lost, homes=self.settings.homing and firmware.can_home)

    def find_zero(self) -> None:
        """Drives to the limit switches. Raises MotionFailed, RobotDisconnected or RobotStopped."""
        self._attempt("homing", lambda firmware: firmware.home())

    def jog(self, step: NDArray[np.float64]) -> None:
        """Moves the tip by `step` [3] metres.

        Raises WorkspaceViolation, before anything moves, if a servo does not reach that height.
        Raises MotionFailed, RobotDisconnected or RobotStopped.
        """
        servo = self.settings.gcode.servo
        if servo is not None and step[2]:
            servo.require(self._height() + float(step[2]))
        self._attempt("jog", lambda firmware: self._jog(firmware, step))

    def set_zero(self, tip: NDArray[np.float64]) -> None:
        """Declares that the tip stands at `tip` [3] (m). Raises MotionFailed, RobotDisconnected or RobotStopped."""
        self._attempt("set zero", lambda firmware: firmware.set_zero(1000 * tip))

    def timing(self) -> AxisTiming | None:
        """Returns the limits of the axes; None if the machine did not tell them, or is not connected."""
        return None if self._firmware is None else self._firmware.timing()

    def travel_limits(self) -> TravelLimits | None:
        """Returns the limits within which the machine keeps its tip; None if it has none, or is not connected."""
        return None if self._firmware is None else self._limits(self._firmware)

    def alive_at(self) -> float:
        """Returns the time (s, steady) when the machine last showed that it moves or waits."""
        firmware = self._firmware
        return -np.inf if firmware is None else firmware.alive_at()

    def wants_pause(self) -> bool:
        """Returns True, once, if the board's pause button was pressed. Raises RobotError."""
        firmware = self._ready("pause button")
        with self._interlock.blocking():
            return firmware.wants_pause()

    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres. With a servo, its height is that of the last waypoint."""
        firmware = self._ready("pose")
        with self._interlock.blocking():
            return self._metres(firmware.position())

    def _require_way(self, waypoints: Waypoints) -> None:
        """Raises MotionFailed, before anything is sent, if it is no path or leaves the machine's own limits."""
        firmware = self._ready(waypoints.label)
        super()._require_way(waypoints)
        self._require_within(firmware, waypoints)

    def _go(self, waypoints: Waypoints) -> NDArray[np.float64]:
        """Sends the lines of the path, and waits until the machine stands."""
        firmware = self._ready(waypoints.label)
        self._begin(firmware, waypoints.label)
        x, y, z = self._metres(firmware.position()).tolist()
        known = self.settings.gcode.tells_height or self._tip is not None
        lines = list(self.settings.gcode.lines(waypoints, (x, y, z) if known else None))
        for index, line in lines:
            firmware.send(line, waypoints.label, index)
        firmware.settle(waypoints.label)
        self._tip = waypoints.position[-1]
        return self._metres(firmware.position())

    def stop(self) -> None:
        """Holds the machine by a command that overtakes all queued lines."""
        self._interlock.stop()
        line, firmware = self._line, self._firmware
        if line is not None and firmware is not None:
            line.write(firmware.stop_bytes)

    def stop_line(self) -> StopLine | None:
        """Returns the line over which another process can hold the machine. Implements LineStoppedRobot."""
        line, firmware = self._line, self._firmware
        return None if line is None or firmware is None else line.stop_line(firmware.stop_bytes)

    def close(self) -> None:
        """Closes the line, after a person's own last lines. A stopped machine forgets its remaining motions."""
        line, firmware = self._line, self._firmware
        if self._begun and firmware is not None:
            with contextlib.suppress(FridaError):  # the painting is over; nothing moves after a stop or a fault
                self._interlock.require_ready("end")
                self._send_own(firmware, "end", "end")
        self._line = self._firmware = None
        self._interlock.mark_disconnected()
        if line is not None and firmware is not None:
            if self._interlock.stopped:
                with contextlib.suppress(RobotError):
                    firmware.forget()
            line.close()

    def _begin(self, firmware: Firmware, label: str) -> None:
        """Sends a person's own first lines before the first motion, when the zero is known."""
        if not self._begun:
            self._send_own(firmware, "start", label)
            firmware.settle(label)
            self._begun = True

    def _send_own(self, firmware: Firmware, event: str, label: str) -> None:
        own = self.settings.gcode.own
        for line in () if own is None else own.at(event):
            firmware.send(line, label, None)

    def _ready(self, label: str) -> Firmware:
        self._interlock.require_ready(label)
        if self._firmware is None:
            raise RobotError(f"{label}: {self._interlock.name} is not connected; call connect() first.")
        return self._firmware

    def _halt(self) -> None:
        """Holds the machine after a fault and clears its motions. A lost line is ignored."""
        line, firmware = self._line, self._firmware
        if line is not None and firmware is not None:
            with contextlib.suppress(RobotError):
                line.write(firmware.stop_bytes)
                firmware.forget()

    def _metres(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        metres = position / 1000
        if not self.settings.gcode.tells_height:
            metres[2] = self._height()
        return metres

    def _attempt(self, label: str, act: Callable[[Firmware], None]) -> None:
        """Does what may move the machine; after a fault it is held and blocked."""
        firmware = self._ready(label)
        with self._moving():
            act(firmware)

    def _jog(self, firmware: Firmware, step: NDArray[np.float64]) -> None:
        """Moves by `step` metres; a servo moves by its own, as do a person's own lines.

        Their height is unknown after a connection: a stop or a reset may have dropped the brush. It is lifted first.
        """
        language = self.settings.gcode
        if not language.tells_height and self._tip is None:
            x, y, _ = self._metres(firmware.position()).tolist()
            for line in language.lift_fully((x, y)):
                firmware.send(line, "jog", None)
            self._tip = np.array([0.0, 0.0, self._height()])
        level = step.copy() if language.tells_height else np.array([step[0], step[1], 0.0])
        if np.any(level):
            firmware.jog(1000 * level, "jog")
        if language.tells_height or not step[2]:
            return
        height = self._height() + float(step[2])
        x, y, _ = self._metres(firmware.position()).tolist()
        for line in language.rise(height, (x, y)):
            firmware.send(line, "jog", None)
        self._tip = np.array([0.0, 0.0, height])

    def _require_within(self, firmware: Firmware, waypoints: Waypoints) -> None:
        """Raises MotionFailed, before anything is sent, if the path leaves the machine's own limits."""
        limits = self._limits(firmware)
        if limits is None:
            return
        beyond = limits.beyond(waypoints.position)
        if beyond.any():
            point, axis = np.argwhere(beyond)[0]
            where = f"{'xyz'[axis]} = {1000 * waypoints.position[point, axis]:.1f} mm at waypoint {point}"
            raise MotionFailed(
                f"{waypoints.label}: {where} is beyond the limits of {self._interlock.name} itself, "
                f"{limits.describe(int(axis))}, where it would stop. It did not move; make the workspace true, or its "
                "limits.",
                waypoint=int(point),
            )

    def _limits(self, firmware: Firmware) -> TravelLimits | None:
        box = firmware.box()
        if box is None:
            return None
        lower, upper = (corner / 1000 for corner in box)
        if not self.settings.gcode.tells_height:
            lower[2], upper[2] = -np.inf, np.inf
        (x, y, z), (right, far, top) = lower.tolist(), upper.tolist()
        return TravelLimits((x, y, z), (right, far, top), zero_known=not firmware.zero_lost)

    def _facts(self, firmware: Firmware) -> Iterator[MachineFact]:
        yield from firmware.facts()
        limits, place = self._limits(firmware), self.settings.lowest
        if limits is None or place is None:
            return
        if place < limits.lower[2] - 1e-5:
            yield MachineFact(
                f"It never goes below z = {1000 * limits.lower[2]:g} mm, and the workspace reaches down to "
                f"{1000 * place:g} mm. Strokes that press deeper are refused; change the machine's limits if yours do.",
                "warning",
            )

    def _make_firmware(self, line: SerialLine) -> Firmware:
        kind = Grbl if self.settings.gcode.flavour == "grbl" else Marlin
        return kind(line, self._interlock, self.settings.gcode, homing=self.settings.homing)

    def _height(self) -> float:
        """Returns the height in metres of a brush whose height the machine does not tell."""
        servo = self.settings.gcode.servo
        top = self.settings.home[2] if servo is None else servo.high[0]
        return top if self._tip is None else float(self._tip[2])


class GrblRobot(GcodeRobot):
    """Machine of the GRBL family with a probe's contact at the brush. Implements TouchProbe as well."""

    sense: Sense = "contact"

    def touch(self, lowest: float, speed: float) -> MotionReport:
        """Moves straight down until the contact closes (G38.3); `reached` is there, or at `lowest` without contact.

        Raises MotionFailed before anything moves if the way leaves the machine's own limits.
        Raises MotionFailed, RobotDisconnected or RobotStopped, also if the brush is not on the axis Z.
        """
        started, found = time.monotonic(), np.zeros(3)
        down = Waypoints("touch", np.array([[*self.pose()[:2], lowest]]), speed)
        self._interlock.require_path(down)
        self._require_within(self._ready("touch"), down)
        own = self.settings.gcode.own
        if not self._begun and own is not None and own.lines_at.get("start"):
            raise MotionFailed("touch: the lines for the start were not sent yet, and they may move the brush; move it "
                               "above the place first. It did not move.")  # fmt: skip

        def go_down(firmware: Firmware) -> None:
            assert isinstance(firmware, Grbl)
            height = firmware.probe(1000 * lowest, 60_000 * speed, "touch")
            found[:] = self._metres(firmware.position())
            found[2] = lowest if height is None else height / 1000

        self._attempt("touch", go_down)
        self._tip = found
        return MotionReport("touch", started, time.monotonic(), found)


def _open(name: MachineName, workspace: Workspace) -> GcodeRobot:
    name.require("baud", "homing", "servo", "lower", "lift", "sinks", "own")
    own = read_own(name.choose("own", Path, None), workspace)
    language = Gcode(
        "marlin" if name.kind == MARLIN.name else "grbl",
        workspace.travel_speed,
        name.choose("servo", Servo.of, None),
        name.choose("lower", millimetres_per_second, None),
        name.choose("lift", millimetres_per_second, None),
        name.choose("sinks", yes_or_no, False),
        own,
    )
    feels = language.flavour == "grbl" and language.tells_height
    return (GrblRobot if feels else GcodeRobot)(
        GcodeSettings(
            name.where,
            require_home(name, workspace),
            name.choose("baud", int, 115_200),
            language,
            name.choose("homing", yes_or_no, False),
            workspace.lower[2],
        )
    )


def _identify(name: MachineName) -> frozenset[str]:
    return at_port(name.where)


_NEEDED = Needed(module="serial", extra="plotter")
_OPTIONS = "[,baud=N][,homing=yes][,servo=Z/{}/Z/{}][,lower=MM/S][,lift=MM/S][,sinks=yes][,own=FILE]"
GRBL = RobotKind(
    "gcode", f"gcode:PORT{_OPTIONS.format('S', 'S')}", "GRBL 1.1, grblHAL, FluidNC", _open, _NEEDED, _identify
)
MARLIN = RobotKind("marlin", f"marlin:PORT{_OPTIONS.format('DEGREES', 'DEGREES')}", "Marlin", _open, _NEEDED, _identify)
