"""The line protocol of Marlin (marlinfw.org, "Host interface"): numbered lines with checksums, resent on request."""

import re
import time

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.drivers.interlock import PATIENCE, Interlock
from frida_painter.hardware.drivers.serial_line import SerialLine

_SLICE = 0.05
_MOST_RESENDS = 3
_PLACE = re.compile(r"X:\s*(-?[\d.]+)\s+Y:\s*(-?[\d.]+)\s+Z:\s*(-?[\d.]+)")


class Marlin:
    """Implements drivers.gcode.Firmware over an open line."""

    def __init__(self, line: SerialLine, interlock: Interlock) -> None:
        self._line, self._interlock = line, interlock
        self._number = 0
        self._said = ""

    def greet(self, homing: bool) -> None:
        """Asks until the machine answers, which many do only when they have started; then counts lines from 0."""
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
                answer = self._line.read(_SLICE)
        while (
            self._line.read(4 * _SLICE) is not None
        ):  # what it tells about itself, and answers to what was asked twice
            pass
        self._number = 0
        if homing:
            self.send("G28", "homing", None, time.monotonic() + 90)

    def send(self, line: str, label: str, waypoint: int | None, until: float) -> None:
        """Sends a line under the next number; sends it again where it arrived damaged, three times at most."""
        self._number += 1
        for _ in range(_MOST_RESENDS):
            self._line.write(_numbered(self._number, line))
            if self._acknowledged(line, label, waypoint, until):
                return
        raise RobotDisconnected(
            f"{label}: {self._interlock.name} got {line!r} damaged {_MOST_RESENDS} times; look at the cable."
        )

    def settle(self, label: str, until: float) -> None:
        """M400 is acknowledged when everything before it is done."""
        self.send("M400", label, None, until)

    def position(self) -> NDArray[np.float64]:
        """Where the machine counts itself to be [3], mm (M114)."""
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
        """Quick stop (M410), heeded as it arrives; on a line of its own, whatever was being written."""
        self._line.write(b"\nM410\n")

    def forget(self) -> None:
        """A quick stop has emptied the machine's queue already."""

    def _acknowledged(self, line: str, label: str, waypoint: int | None, until: float) -> bool:
        """Whether the line was acknowledged; False where it is wanted again. What is no good news is raised."""
        again = False
        while time.monotonic() <= until:
            answer = self._line.read(_SLICE)
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
                raise self._failed(answer, label, waypoint)
            elif _PLACE.search(answer):
                self._said = answer
        raise RobotDisconnected(
            f"{label}: {self._interlock.name} did not acknowledge {line!r} in time; a line was lost, or this is no "
            "Marlin. Look at the cable and the baud rate."
        )

    def _failed(self, answer: str, label: str, waypoint: int | None) -> RobotError:
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
    """An error that Marlin follows with a request to send a line again."""
    return "checksum" in answer.lower() or "Line Number" in answer


def _numbered(number: int, line: str) -> bytes:
    """The line as Marlin checks it: its number before it, and the exclusive or of all bytes behind it."""
    content = f"N{number} {line}".encode("ascii")
    checksum = 0
    for byte in content:
        checksum ^= byte
    return content + f"*{checksum}\n".encode("ascii")
