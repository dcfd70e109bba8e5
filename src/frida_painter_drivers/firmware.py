"""The firmware of a machine that follows G-code over an open line: what GRBL and Marlin have in common."""

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import MotionFailed, RobotDisconnected, RobotError
from frida_painter.hardware.deadline import steady
from frida_painter.hardware.gcode import Gcode
from frida_painter.hardware.interlock import Interlock
from frida_painter.hardware.robot import MachineFact
from frida_painter_drivers.serial_line import SerialLine

Box = tuple[NDArray[np.float64], NDArray[np.float64]]
Axes = tuple[float, float, float]
SLICE = 0.05
"""Seconds for which a line is read before something else is looked at."""
JOG_FEED = 600
"""Feed of a jog, mm/min."""
_CATCH_UP_AFTER = 1.0  # seconds for which nobody listened
_FLOOD, _MAX_STRANGE = 5.0, 400  # so many seconds may bring at most so many strange lines


class AnyFirmware(ABC):
    """Base of the firmwares: their zero, and what they say while nobody listens. Lengths in mm of the work coordinates.

    homing: True if the machine may drive to its limit switches on connection
    alive: time (s, steady) when the machine last showed that it moves or waits

    Its methods raise MotionFailed, RobotDisconnected and RobotStopped.
    """

    untold = "since its last start nobody has told it where it stands"
    """Reason for a zero that is lost without a reset."""

    def __init__(self, line: SerialLine, interlock: Interlock, language: Gcode, *, homing: bool) -> None:
        self.line, self._interlock, self._language, self._homing_wanted = line, interlock, language, homing
        self._was_reset = self._zero_known = self._homes = self.locked = False  # locked: until it homes
        self._axes = 3
        self._heard_at = time.monotonic()
        self.alive = steady()
        self._listens = True  # False while it reads what came when nobody listened
        self._strangers, self._strangers_since = 0, time.monotonic()

    @abstractmethod
    def send(self, line: str, label: str, waypoint: int | None, quiet: float = 0.0) -> None:
        """Sends a line and returns when it is acknowledged; waits as long as the machine shows that it lives.

        quiet: seconds for which it may say nothing while it obeys the line
        """

    @property
    @abstractmethod
    def homing_seconds(self) -> float:
        """Longest duration of homing, seconds."""

    @property
    @abstractmethod
    def stop_bytes(self) -> bytes:
        """Bytes that stop the machine, also while it homes."""

    @abstractmethod
    def position(self) -> NDArray[np.float64]:
        """Returns the machine's position [3]."""

    @abstractmethod
    def _hear(self, seconds: float = SLICE) -> str | None:
        """Returns the next line that means something; None if none came."""

    @property
    def zero_lost(self) -> str:
        """Reason why the position may be wrong; "" if it survived."""
        if self._zero_known:
            return ""
        if self.locked:
            return "it is in an alarm, as after each start, and only homing ends that"
        return "its board was reset, and counts from 0 wherever it stands" if self._was_reset else self.untold

    def _explain_zero(self) -> Iterator[MachineFact]:
        if not self._zero_known:
            yield MachineFact(f"Its zero is to be found before it paints: {self.zero_lost}.", "warning")

    @staticmethod
    def _explain_speeds(rates: Axes, gains: Axes, rates_from: str, gains_from: str) -> MachineFact:
        """Returns the greatest speeds in mm/s and accelerations in mm/s2, each with the settings that hold them."""
        speeds = ", ".join(f"{axis} {round(rate, 2):g} mm/s" for axis, rate in zip("xyz", rates, strict=True))
        ramps = ", ".join(f"{axis} {gain:g}" for axis, gain in zip("xyz", gains, strict=True))
        return MachineFact(f"It moves at most: {speeds}{rates_from}, and accelerates by {ramps} mm/s2{gains_from}.")

    def lift(self, label: str) -> None:
        """Lifts a brush that no axis lifts all the way."""
        x, y, _ = (self.position() / 1000).tolist()
        for line in self._language.lift_fully((x, y)):
            self.send(line, label, None)

    def _words(self, tip: NDArray[np.float64]) -> str:
        """Returns a position as words, without the height if a servo has it."""
        x, y, z = (f"{value:.3f}" for value in tip)
        return f"X{x} Y{y}" + ("" if self._language.servo is not None or self._axes < 3 else f" Z{z}")

    def require_unlocked(self, label: str) -> None:
        """Raises RobotError, before anything is sent, if the machine does nothing but home."""
        if self.locked:
            said = f"{self._interlock.name} is locked by an alarm, in which it only homes"
            raise RobotError(f"{label}: {said}. Let it home, or release it with its own controls, then connect anew.")

    def _drive_home(self, line: str, seconds: float) -> None:
        """Drives to the limit switches by a line; a machine that is given up is stopped. seconds: it may take"""
        self._homes = True
        try:
            self.send(line, "homing", None, quiet=seconds)
        except RobotDisconnected:
            with suppress(RobotError):
                self.line.write(self.stop_bytes)
            raise
        finally:
            self._homes = False

    def _catch_up(self, label: str) -> None:
        """Reads what the machine said while nobody listened. Raises MotionFailed if it was reset meanwhile."""
        if time.monotonic() < self._heard_at + _CATCH_UP_AFTER:
            return
        until, reset = time.monotonic() + _FLOOD, self._was_reset
        self._listens = False
        while time.monotonic() < until and (
            self._hear(0.02) is not None or (self.line.holds_part and self._hear(10 * SLICE) is not None)
        ):
            pass
        self._listens = True
        self.line.drop_part()  # else the next line would be taken for its end
        if self._was_reset and not reset:
            raise self._report_reset(label, None)

    def _count_stranger(self, answer: str) -> None:
        """Counts a line that the firmware does not know. Raises RobotDisconnected at a flood of them."""
        if time.monotonic() > self._strangers_since + _FLOOD:
            self._strangers, self._strangers_since = 0, time.monotonic()
        self._strangers += 1
        if self._strangers > _MAX_STRANGE:
            raise RobotDisconnected(
                f"{self._interlock.name} floods the line with what is not of its firmware ({answer[:40]!r}); look at "
                "the baud rate, and whether this is the machine."
            )

    def _failed(self, label: str, waypoint: int | None, verb: str, more: str, code: str) -> MotionFailed:
        """Returns the error of a machine that VERB at a waypoint; MORE says what, and what to do."""
        where = "" if waypoint is None else f" at waypoint {waypoint}"
        return self._interlock.failure(MotionFailed, label, f"{verb}{where}{more}", code, waypoint)

    def _report_reset(self, label: str, waypoint: int | None) -> MotionFailed:
        more = "; it has forgotten where it is. Look at it, home it, then connect anew."
        return self._failed(label, waypoint, "was reset", more, "reset")
