"""The line protocol of GRBL 1.1 (github.com/gnea/grbl, "Interface"): acknowledged lines, real-time bytes, reports."""

import re
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.drivers.interlock import PATIENCE, Interlock
from frida_painter.hardware.drivers.serial_line import SerialLine

_HOLD, _RESET, _STATUS = b"!", b"\x18", b"?"
_SLICE = 0.05
_ASK_AFTER = 0.5
_HOMING = 90.0
_MOST_REPORTS = 40  # The offset of the work coordinates comes with one report in thirty at least.
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
    """Implements drivers.gcode.Firmware over an open line."""

    def __init__(self, line: SerialLine, interlock: Interlock) -> None:
        self._line, self._interlock = line, interlock
        self._offset: NDArray[np.float64] | None = None

    def greet(self, homing: bool) -> None:
        """Asks until the machine answers: many boards start anew when their line is opened."""
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
        """Sends a line and waits for its "ok"; a line that got lost is noticed as soon as the machine is idle."""
        self._line.write(line.encode("ascii") + b"\n")
        idle, ask_at = 0, time.monotonic() + _ASK_AFTER
        while True:
            answer = self._read(label, waypoint)
            if answer == "ok":
                return
            if answer is not None and answer.startswith("<"):
                state = self._parsed(answer).state
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
        """A dwell is acknowledged when everything before it is done; a machine that answers too soon is waited for."""
        self.send("G4 P0.01", label, None, until)
        while not (state := self._ask().state).startswith("Idle"):
            self._require_running(state, label, None)
            if self._interlock.stopped or not time.monotonic() <= until:
                raise RobotStopped(
                    f"{label}: {self._interlock.name} acknowledged the end of its motion, and says {state!r}; it is "
                    "held. Look at it before it is connected anew."
                )
            time.sleep(_SLICE)

    def position(self) -> NDArray[np.float64]:
        """Work coordinates [3], mm, of a fresh report."""
        for _ in range(_MOST_REPORTS):
            numbers = self._ask().numbers
            if "WPos" in numbers:
                return numbers["WPos"]
            if "MPos" in numbers and self._offset is not None:
                return numbers["MPos"] - self._offset
        raise RobotError(
            f"{self._interlock.name} does not say where it is in work coordinates; set $10=1 or $10=0 on it."
        )

    def hold(self) -> None:
        """Feed hold: a byte that GRBL heeds wherever it finds it, and that keeps the machine's position."""
        self._line.write(_HOLD)

    def forget(self) -> None:
        """A soft reset, once the machine stands: a reset in motion would lose its position. It clears no alarm."""
        until = time.monotonic() + 2
        while time.monotonic() < until:
            state = self._ask().state
            if state.startswith("Alarm"):
                return
            if state in ("Idle", "Hold", "Hold:0"):
                break
        self._line.write(_RESET)

    def _ask(self) -> _Report:
        """The next report, asked for. Raises RobotDisconnected where none comes."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            self._line.write(_STATUS)
            for _ in range(10):
                answer = self._line.read(_SLICE)
                if answer is not None and answer.startswith("<"):
                    return self._parsed(answer)
        raise RobotDisconnected(
            f"{self._interlock.name} gave no report of its state in {PATIENCE:.0f} s; is this GRBL, and at this baud "
            "rate?"
        )

    def _require_running(self, state: str, label: str, waypoint: int | None) -> None:
        """Raises MotionFailed where a report says that it will not move on by itself, and RobotStopped after a stop."""
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
        """One line of the machine's while a line of ours waits; what is no good news is raised."""
        answer = self._line.read(_SLICE)
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

    def _parsed(self, report: str) -> _Report:
        """A report like <Idle|MPos:1.000,2.000,3.000|FS:0,0|WCO:0.000,0.000,0.000>. Raises RobotDisconnected."""
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
