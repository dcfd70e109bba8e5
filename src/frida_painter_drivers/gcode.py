"""The robot kinds `gcode` and `marlin`: machines with GRBL or Marlin that follow G-code over a serial line.

Each line is sent when the machine has acknowledged the one before. The machine itself plans a few millimetres
ahead. This program keeps no queue, so nothing can move the machine after an error. The differences between
firmwares are in grbl.py and marlin.py.
"""

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import FridaError, MotionFailed, RobotError
from frida_painter.hardware.gcode import Gcode, Servo, read_own
from frida_painter.hardware.kinds import (
    MachineName,
    Needed,
    RobotKind,
    at_port,
    millimetres_per_second,
    require_home,
    yes_or_no,
)
from frida_painter.hardware.robot import MachineFact, MotionReport, Point, Sense, StopLine, Waypoints, Workspace, Zero
from frida_painter.hardware.timing import AxisTiming, TravelLimits
from frida_painter_drivers.driver import Driver
from frida_painter_drivers.grbl import Grbl
from frida_painter_drivers.marlin import Marlin
from frida_painter_drivers.serial_line import SerialLine

Firmware = Grbl | Marlin


class GcodeRobot(Driver):
    """Robot that follows G-code. Implements ZeroedRobot, LimitedRobot, LineStoppedRobot and PausableRobot as well.

    port: of the serial line
    gcode: dialect of the machine
    baud: bits per second
    homing: True if `find_zero` may drive to the limit switches; GRBL with switches needs that after each start
    lowest: robot z of the lowest point of the workspace, metres; None if unknown
    """

    def __init__(
        self,
        port: str,
        resting: Point,
        gcode: Gcode,
        baud: int = 115_200,
        homing: bool = False,
        lowest: float | None = None,
    ) -> None:
        super().__init__(f"the {gcode.flavour} machine on {port}", resting, gcode.approach)
        self.gcode, self.homing = gcode, homing
        self._port, self.baud, self._lowest = port, baud, lowest
        self._firmware: Firmware | None = None
        self._tip: NDArray[np.float64] | None = None
        self._begun = False

    def _open(self, *, examines: bool) -> None:
        """Opens the line, waits for the machine, reads its settings and sets millimetres; moves nothing.

        Raises RobotError if the machine is in an alarm, or if its settings make painting impossible.
        """
        line = SerialLine.open(self._port, self.baud)
        kind = Grbl if self.gcode.flavour == "grbl" else Marlin
        self._firmware, self._begun = kind(line, self._interlock, self.gcode, homing=self.homing), False
        self._firmware.greet(release=not examines)
        if examines:
            return
        if refused := [fact.text for fact in self._facts() if fact.weight == "refusal"]:
            raise RobotError(f"{self._interlock.name} cannot paint like this. {' '.join(refused)}")
        self._firmware.prepare()

    def zero(self) -> Zero:
        """Returns what the machine knows of its zero."""
        firmware = self._ready("zero")
        homes = self.homing and firmware.can_home
        return Zero(firmware.zero_lost, homes, firmware.homing_seconds, firmware.locked)

    def find_zero(self) -> None:
        """Drives to the limit switches. Raises MotionFailed, RobotDisconnected or RobotStopped."""
        firmware = self._ready("homing")
        with self._moving():
            firmware.home()

    def jog(self, step: NDArray[np.float64]) -> None:
        """Moves the tip by `step` [3] metres; a servo moves by its own lines, as does a brush by a person's own.

        Their height is unknown after a connection: a stop or a reset may have dropped the brush. It is lifted first.

        Raises WorkspaceViolation, before anything moves, if a servo does not reach that height.
        Raises MotionFailed, RobotDisconnected or RobotStopped.
        """
        language, firmware = self.gcode, self._ready("jog")
        firmware.require_unlocked("jog")
        if language.servo is not None and step[2]:
            language.servo.require(self._height() + float(step[2]))
        with self._moving():
            if language.tells_height:
                if np.any(step):
                    firmware.jog(1000 * step, "jog")
                return
            if self._tip is None:
                firmware.lift("jog")
            height = self._height()
            if np.any(step[:2]):
                firmware.jog(1000 * np.array([step[0], step[1], 0.0]), "jog")
            if step[2]:
                height += float(step[2])
                x, y, _ = (firmware.position() / 1000).tolist()
                for line in language.rise(height, (x, y)):
                    firmware.send(line, "jog", None)
            self._tip = np.array([0.0, 0.0, height])

    def set_zero(self, tip: NDArray[np.float64]) -> None:
        """Declares that the tip stands at `tip` [3] (m). Raises MotionFailed, RobotDisconnected or RobotStopped."""
        firmware = self._ready("set zero")
        firmware.require_unlocked("set zero")
        with self._moving():
            firmware.set_zero(1000 * tip)

    def timing(self) -> AxisTiming | None:
        """Returns the limits of the axes; None if the machine did not tell them, or is not connected."""
        return None if self._firmware is None else self._firmware.timing()

    def alive_at(self) -> float:
        """Returns the time (s, steady) when the machine last showed that it moves or waits."""
        firmware = self._firmware
        return -np.inf if firmware is None else firmware.alive

    def wants_pause(self) -> bool:
        """Returns True, once, if the board's pause button was pressed. Raises RobotError."""
        firmware = self._ready("pause button")
        with self._interlock.blocking():
            return firmware.wants_pause()

    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres. With a servo, its height is that of the last waypoint."""
        firmware = self._ready("pose")
        with self._interlock.blocking():
            return self._place(firmware)

    def _require_way(self, waypoints: Waypoints) -> None:
        """Raises MotionFailed, before anything is sent, if it is no path or leaves the machine's own limits."""
        self._ready(waypoints.label)
        super()._require_way(waypoints)
        limits = self.travel_limits()
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

    def _go(self, waypoints: Waypoints) -> NDArray[np.float64]:
        """Sends the lines of the path, and waits until the machine stands. A person's own first lines come before."""
        label, firmware = waypoints.label, self._ready(waypoints.label)
        if not self._begun:
            self._send_own(firmware, "start", label)
            firmware.settle(label)
            self._begun = True
        x, y, z = self._place(firmware).tolist()
        known = self.gcode.tells_height or self._tip is not None
        for index, line in list(self.gcode.lines(waypoints, (x, y, z) if known else None)):
            firmware.send(line, label, index)
        firmware.settle(label)
        self._tip = waypoints.position[-1]
        return self._place(firmware)

    def stop(self) -> None:
        """Holds the machine by a command that overtakes all queued lines."""
        self._interlock.stop()
        firmware = self._firmware
        if firmware is not None:
            firmware.line.write(firmware.stop_bytes)

    def stop_line(self) -> StopLine | None:
        """Returns the line over which another process can hold the machine. Implements LineStoppedRobot."""
        firmware = self._firmware
        return None if firmware is None else firmware.line.stop_line(firmware.stop_bytes)

    def close(self) -> None:
        """Closes the line, after a person's own last lines. A stopped machine forgets its remaining motions."""
        firmware = self._firmware
        if self._begun and firmware is not None:
            with contextlib.suppress(FridaError):  # the painting is over; nothing moves after a stop or a fault
                self._interlock.require_ready("end")
                self._send_own(firmware, "end", "end")
        self._firmware = None
        self._interlock.mark_disconnected()
        if firmware is not None:
            if self._interlock.stopped:
                with contextlib.suppress(RobotError):
                    firmware.forget()
            firmware.line.close()

    def _send_own(self, firmware: Firmware, event: str, label: str) -> None:
        own = self.gcode.own
        for line in () if own is None else own.at(event):
            firmware.send(line, label, None)

    def _ready(self, label: str) -> Firmware:
        self._interlock.require_ready(label)
        if self._firmware is None:
            raise self._failure(RobotError, label, "is not connected; call connect() first.")
        return self._firmware

    def _halt(self) -> None:
        """Holds the machine after a fault and clears its motions. A lost line is ignored."""
        firmware = self._firmware
        if firmware is not None:
            with contextlib.suppress(RobotError):
                firmware.line.write(firmware.stop_bytes)
                firmware.forget()

    def _place(self, firmware: Firmware) -> NDArray[np.float64]:
        metres = firmware.position() / 1000
        if not self.gcode.tells_height:
            metres[2] = self._height()
        return metres

    def travel_limits(self) -> TravelLimits | None:
        """Returns the limits within which the machine keeps its tip; None if it has none, or is not connected."""
        firmware = self._firmware
        box = None if firmware is None else firmware.box()
        if firmware is None or box is None:
            return None
        lower, upper = (corner / 1000 for corner in box)
        if not self.gcode.tells_height:
            lower[2], upper[2] = -np.inf, np.inf
        (x, y, z), (right, far, top) = lower.tolist(), upper.tolist()
        return TravelLimits((x, y, z), (right, far, top), zero_known=not firmware.zero_lost)

    def _facts(self) -> Iterator[MachineFact]:
        assert self._firmware is not None
        yield from self._firmware.facts()
        limits, place = self.travel_limits(), self._lowest
        if limits is not None and place is not None and place < limits.lower[2] - 1e-5:
            yield MachineFact(
                f"It never goes below z = {1000 * limits.lower[2]:g} mm, and the workspace reaches down to "
                f"{1000 * place:g} mm. Strokes that press deeper are refused; change the machine's limits if yours do.",
                "warning",
            )

    def _height(self) -> float:
        """Returns the height in metres of a brush whose height the machine does not tell."""
        servo = self.gcode.servo
        top = self.resting[2] if servo is None else servo.high[0]
        return top if self._tip is None else float(self._tip[2])


class GrblRobot(GcodeRobot):
    """Machine of the GRBL family with a probe's contact at the brush. Implements TouchProbe as well."""

    def feels(self) -> Sense:
        """Returns that a contact is closed by the touch."""
        return "contact"

    def touch(self, lowest: float, speed: float) -> MotionReport:
        """Moves straight down until the contact closes (G38.3); `reached` is there, or at `lowest` without contact.

        Raises MotionFailed before anything moves if the way leaves the machine's own limits.
        Raises MotionFailed, RobotDisconnected or RobotStopped, also if the brush is not on the axis Z.
        """
        started = time.monotonic()
        self._require_way(Waypoints("touch", np.array([[*self.pose()[:2], lowest]]), speed))
        own, firmware = self.gcode.own, self._ready("touch")
        if not self._begun and own is not None and own.start:
            raise MotionFailed("touch: the lines for the start were not sent yet, and they may move the brush; move it "
                               "above the place first. It did not move.")  # fmt: skip
        assert isinstance(firmware, Grbl)
        with self._moving():
            height = firmware.probe(1000 * lowest, 60_000 * speed, "touch")
            found = self._place(firmware)
        found[2] = lowest if height is None else height / 1000
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
    baud, homing = name.choose("baud", int, 115_200), name.choose("homing", yes_or_no, False)
    kind = GrblRobot if language.flavour == "grbl" and language.tells_height else GcodeRobot
    return kind(name.where, require_home(name, workspace), language, baud, homing, workspace.lower[2])


_NEEDED = Needed(module="serial", extra="plotter")
_OPTIONS = "[,baud=N][,homing=yes][,servo=Z/{}/Z/{}][,lower=MM/S][,lift=MM/S][,sinks=yes][,own=FILE]"
GRBL, MARLIN = (
    RobotKind(
        kind, f"{kind}:PORT{_OPTIONS.format(unit, unit)}", title, _open, _NEEDED, lambda name: at_port(name.where)
    )
    for kind, title, unit in (("gcode", "GRBL 1.1, grblHAL, FluidNC", "S"), ("marlin", "Marlin", "DEGREES"))
)
