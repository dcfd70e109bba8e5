"""The firmware Marlin over an open line.

Protocol: marlinfw.org ("Host interface", and the pages of M110, M114, M115, M211, M410, M503): numbered lines with
checksums, resent on request.
"""

import re
import time
from collections import deque
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import MotionFailed, RobotDisconnected
from frida_painter.hardware.deadline import steady
from frida_painter.hardware.gcode import Gcode
from frida_painter.hardware.interlock import PATIENCE, Interlock
from frida_painter.hardware.robot import MachineFact
from frida_painter.hardware.timing import AxisTiming
from frida_painter_drivers.firmware import JOG_FEED, SLICE, AnyFirmware, Axes, Box
from frida_painter_drivers.serial_line import SerialLine

_GREETING = 8.0  # seconds until a board has started
_MAX_RESENDS = 3
_BUSY = 2.0  # seconds between two "busy" of a machine that works
_SILENT = 60.0  # seconds of the longest single motion of a machine that does not tell that it is busy
_HOMING_SPEED, _SEARCH = (50.0, 50.0, 4.0), 1.5  # mm/s of x, y, z (HOMING_FEEDRATE_MM_M), over 1.5 times the travel
_SETTLING = 1.5  # seconds
_BETWEEN = 0.02  # seconds between two motions
_SETTING = 0.33  # seconds: M280 returns after SERVO_DELAY, 0.3 s if its builder did not change it, and three lines
_CLEAR = 5.0  # mm by which the brush is lifted before homing, wherever it stands
_FOUND = 86.4
"""E position that stands for a zero that was found: a restart sets it to 0, and nothing here extrudes.

A build without extruders has no E. There it is the acceleration of retracting (M204 R), which a restart sets to another
value; nothing else uses it.
"""
_PLACE = re.compile(r"X:\s*(-?[\d.]+)\s+Y:\s*(-?[\d.]+)\s+Z:\s*(-?[\d.]+)(?:\s+E:\s*(-?[\d.]+))?")


class Marlin(AnyFirmware):
    """Firmware Marlin over an open line."""

    untold = "since its last start or stop nobody has told it where it stands"

    def __init__(self, line: SerialLine, interlock: Interlock, language: Gcode, *, homing: bool) -> None:
        super().__init__(line, interlock, language, homing=homing)
        self._number = 0
        self._about, self._capabilities = "", dict[str, bool]()
        self._codes: dict[str, dict[str, float]] = {}
        self._box: Box | None = None
        self._has_servo = self._extrudes = True
        self._answer: list[str] = []
        self._strange: deque[str] = deque(maxlen=20)

    # Connection.

    def greet(self, *, release: bool) -> None:
        """Asks until the machine answers, because many machines restart first; then reads what it tells.

        release: without meaning here: a stop has emptied the machine's queue
        """
        until = time.monotonic() + _GREETING
        answer: str | None = None
        while answer is None or not _is_ok(answer):
            if time.monotonic() > until:
                raise RobotDisconnected(
                    f"{self._interlock.name} did not answer in {_GREETING:.0f} s; is this Marlin, and at this baud "
                    "rate?"
                )
            self.line.write(b"\nM110 N0\n")
            heard = time.monotonic() + 1
            while (answer is None or not _is_ok(answer)) and time.monotonic() < heard:
                answer = self._hear()
        quiet = time.monotonic() + _SETTLING  # for the machine's greeting, and answers to repeated questions
        while time.monotonic() < quiet and self._hear(4 * SLICE) is not None:
            pass
        self._number = 0
        self._read_out()

    def _read_out(self) -> None:
        for line in self._ask("M115"):
            if line.startswith("Cap:"):
                name, _, value = line[4:].rpartition(":")
                self._capabilities[name] = value == "1"
            elif "FIRMWARE_NAME:" in line:
                self._about = line.partition("FIRMWARE_NAME:")[2]
        for line in self._ask("M503"):
            found = re.search(r"\b(M\d+)\b((?:\s+[A-Z]-?[\d.]+)+)", line)
            if found is not None:
                words = {word[0]: float(word[1:]) for word in found[2].split()}
                self._codes.setdefault(found[1], {}).update(words)
        if self._language.servo is not None:
            self._has_servo = not any("nknown command" in line for line in self._ask("M280 P0"))
        told, _ = self._ask_place()
        self._box = self._soft_box()
        self._extrudes = told.group(4) is not None
        mark = float(told.group(4)) if self._extrudes else self._codes.get("M204", {}).get("R", 0.0)
        self._zero_known = not self._was_reset and abs(mark - _FOUND) < 0.01

    def prepare(self) -> None:
        """Sets millimetres and absolute coordinates, and keeps the motors on; moves nothing."""
        for command in ("G21", "G90", "M84 S0"):  # a motor that is off loses its position
            self.send(command, "connect", None)
        self.position()
        self._strange.clear()  # a press before the connection meant something else

    def facts(self) -> Iterator[MachineFact]:
        """Yields what the machine told, for a person."""
        about = re.split(r"\s(?:SOURCE_CODE_URL|PROTOCOL_VERSION|MACHINE_TYPE):", self._about)[0]
        machine = re.search(r"MACHINE_TYPE:(.*?)(?:\s[A-Z_]+:|$)", self._about)
        yield MachineFact(f"It is {about or 'a machine that does not tell its firmware'}"
                          f"{f' in {machine[1].strip()!r}' if machine else ''}.")  # fmt: skip
        if about and not about.startswith("Marlin"):
            yield MachineFact("This is not Marlin; nobody has tried it with this program.", "warning")
        if not self._codes:
            yield MachineFact("It does not list its settings (M503); times are reckoned as if it moved at full speed.",
                              "warning")  # fmt: skip
        yield from self._explain_zero()
        rates, gains = self._axes_of("M203"), self._axes_of("M201")
        if rates and gains:
            yield self._explain_speeds(rates, gains, " (M203)", " (M201)")
        if self._box is not None:
            low, high = self._box
            sides = ", ".join(f"{axis} {low[i]:g} to {high[i]:g}" for i, axis in enumerate("xyz"))
            yield MachineFact(f"It keeps itself within {sides} mm (software endstops; M211 S0 switches them off).")
        if self._language.servo is not None and not self._has_servo:
            yield MachineFact("It knows no servo (M280 is an unknown command), so the brush would not be lifted. Build "
                              "Marlin with NUM_SERVOS, or leave servo out.", "refusal")  # fmt: skip
        elif self._language.servo is not None:
            yield MachineFact("Each setting of its servo takes 0.3 s unless its builder changed SERVO_DELAY, and "
                              "it goes down in steps of 1 mm; a shorter delay is better.", "warning")  # fmt: skip
        if not self._capabilities.get("EMERGENCY_PARSER", False):
            yield MachineFact("Its build has no EMERGENCY_PARSER: a stop waits until the machine reads its next line. "
                              "Build Marlin with it if you can.", "warning")  # fmt: skip
        if self._homing_wanted:
            yield MachineFact("While it homes, it hears nothing but the emergency stop (M112), after which it must be "
                              "switched off and on; that is what a stop sends then.", "warning")  # fmt: skip
        yield MachineFact("A stop halts its motors at once, and they may lose steps; its zero is then found again.")

    def _axes_of(self, code: str) -> Axes | None:
        words = self._codes.get(code, {})
        x, y, z = (words.get(axis, 0.0) for axis in "XYZ")
        return (x, y, z) if min(x, y, z) > 0 else None

    def timing(self) -> AxisTiming | None:
        """Returns the limits of the axes; None if they were not told."""
        rates, gains = self._axes_of("M203"), self._axes_of("M201")
        if rates is None or gains is None:
            return None
        speed, gain = [rate / 1000 for rate in rates], [one / 1000 for one in gains]
        along = self._codes.get("M204", {}).get("T", 0.0) / 1000
        corners = self._codes.get("M205", {})
        jerk = self._axes_of("M205")
        return AxisTiming(
            tuple(speed),
            tuple(gain),
            deviation=corners.get("J", 0.0) / 1000,
            jerk=None if jerk is None or "J" in corners else tuple(one / 1000 for one in jerk),
            along=along or np.inf,
            between=_BETWEEN,
            servo=self._language.servo_timing(each=_SETTING),
        )

    def box(self) -> Box | None:
        """Returns the corners of the box of the software endstops, mm of the work coordinates; None if they are off."""
        return self._box

    def _soft_box(self) -> Box | None:
        """Returns the box of the software endstops as M211 tells it: in work coordinates, also after G92."""
        told = " ".join(self._ask("M211"))
        corner = r"\s*X(-?[\d.]+)\s+Y(-?[\d.]+)\s+Z(-?[\d.]+)"  # "Soft endstops: On  Min: ...", or "M211 S1 ; ON"
        found = re.search(rf"\b(on|off)\b\W*(?:echo:)?\s*Min:{corner}\s+Max:{corner}", told, re.IGNORECASE)
        if found is None or found[1].lower() == "off":
            return None
        return np.array(found.groups()[1:4], np.float64), np.array(found.groups()[4:], np.float64)

    # The zero.

    @property
    def can_home(self) -> bool:
        """True: a printer has limit switches."""
        return True

    @property
    def homing_seconds(self) -> float:
        """Longest duration of homing, seconds: every axis alone, over all of its travel."""
        travel = (300.0, 300.0, 400.0) if self._box is None else self._box[1] - self._box[0]
        speed = self._axes_of("M210") or _HOMING_SPEED
        limit = self._axes_of("M203") or speed
        ways = zip(travel, speed, limit, strict=True)
        return 20.0 + sum(_SEARCH * float(way) / min(most, one) for way, one, most in ways)

    def home(self) -> None:
        """Lifts the brush, and drives to the limit switches: Marlin homes x and y first."""
        if self._language.tells_height:
            self.jog(np.array([0.0, 0.0, _CLEAR]), "homing")
        else:
            self.lift("homing")
        self._drive_home("G28", self.homing_seconds)
        self._mark_zero()

    def set_zero(self, tip: NDArray[np.float64]) -> None:
        """Declares that the tip stands at `tip` [3] mm of the work coordinates."""
        self.send(f"G92 {self._words(tip)}", "set zero", None)
        self._mark_zero()

    def _mark_zero(self) -> None:
        self.send(f"G92 E{_FOUND}" if self._extrudes else f"M204 R{_FOUND}", "zero", None)
        self._was_reset, self._zero_known = False, True
        self._box = self._soft_box()

    def jog(self, step: NDArray[np.float64], label: str) -> None:
        """Moves by `step` [3] mm, and returns when the machine stands."""
        x, y, z = (f"{value:.3f}" for value in step)
        self.send("G91", label, None)
        self.send(f"G1 X{x} Y{y} Z{z} F{JOG_FEED}", label, None)
        self.send("G90", label, None)
        self.settle(label)

    # Motion.

    def send(self, line: str, label: str, waypoint: int | None, quiet: float = _SILENT) -> None:
        """Sends a numbered line.

        quiet: seconds for which the machine may say nothing while it obeys the line
        """
        if any("nknown command" in answer for answer in self._exchange(line, label, waypoint, quiet)):
            said = f"does not know {line!r}. Look at it, then connect anew."
            raise self._interlock.failure(MotionFailed, label, said, "unknown command", waypoint)

    def _exchange(self, line: str, label: str, waypoint: int | None, quiet: float) -> list[str]:
        """Sends a numbered line, at most three times if it is damaged; returns the lines that came until its ok."""
        self._catch_up(label)
        self._number += 1
        for _ in range(_MAX_RESENDS):
            self.line.write(_number_line(self._number, line))
            if self._await_ok(line, label, waypoint, quiet):
                return list(self._answer)
        said = f"got {line!r} damaged {_MAX_RESENDS} times; look at the cable."
        raise self._interlock.failure(RobotDisconnected, label, said)

    def settle(self, label: str) -> None:
        """Returns when M400 is acknowledged: everything before it is done."""
        self.send("M400", label, None)

    def position(self) -> NDArray[np.float64]:
        """Returns the machine's own position [3], mm (M114)."""
        return self._ask_place()[1]

    def _ask_place(self) -> tuple[re.Match[str], NDArray[np.float64]]:
        """Returns the report of the position, and the position [3] in it, mm."""
        told = self._ask("M114")
        for line in told:
            found = _PLACE.search(line)
            try:
                if found is not None:
                    return found, np.array([float(number) for number in found.groups()[:3]])
            except ValueError:
                break
        raise RobotDisconnected(
            f"{self._interlock.name} said {' '.join(told)[:80]!r} when asked for its place; look at its line."
        )

    def _ask(self, question: str) -> list[str]:
        return self._exchange(question, question, None, PATIENCE)

    def wants_pause(self) -> bool:
        """Returns True, once, if the machine said that it was paused at its display (//action:pause)."""
        paused = any(line.startswith(("//action:pause", "// action:pause")) for line in self._strange)
        self._strange.clear()
        return paused

    @property
    def stop_bytes(self) -> bytes:
        """Quick stop (M410) on a new line, after any partial command; the machine obeys it on arrival.

        Homing goes on after a quick stop (Marlin 19774); then it is the emergency stop (M112). A note in the machine
        follows: its position is not known, because a quick stop may lose steps.
        """
        return b"\nM112\n" if self._homes else b"\nM410\nG92 E0\n" if self._extrudes else b"\nM410\nM204 R1000\n"

    def forget(self) -> None:
        """Notes that the position is not known, as the machine does. Its queue is empty."""
        self._zero_known = False

    # Lines that come.

    def _hear(self, seconds: float = SLICE) -> str | None:
        answer = self.line.read(seconds)
        if answer is not None:
            self._heard_at = time.monotonic()
            if answer == "start":
                self._was_reset, self._zero_known = True, False
        return answer

    def _await_ok(self, line: str, label: str, waypoint: int | None, quiet: float) -> bool:
        """Returns True if the line was acknowledged, False if it must be sent again. Raises the errors reported."""
        again, self._answer = False, []
        answered_at = time.monotonic()
        while True:
            answer = self._hear()
            self._interlock.heed_stop(label)
            silent = time.monotonic() - answered_at  # lines that nobody asked for are no sign of work
            if silent > quiet + PATIENCE:
                raise RobotDisconnected(
                    f"{label}: {self._interlock.name} did not acknowledge {line!r} and has said nothing for "
                    f"{silent:.0f} s. A line was lost, or it hangs. Look at it and at the cable."
                )
            if not answer:
                continue
            if _is_ok(answer):
                self.alive = steady()
                self._strangers = 0
                self._answer.append(answer)
                return not again
            if "busy:" in answer:
                self.alive, answered_at = steady(), time.monotonic()
                if "paused for user" in answer:
                    self._strange.append("//action:pause")
            elif answer.startswith("Resend:"):
                wanted = answer.removeprefix("Resend:").strip()
                if wanted != str(self._number):
                    said = f"wants line {wanted[:20]} and not {self._number}; lines were lost. Look at the cable."
                    raise self._interlock.failure(RobotDisconnected, label, said)
                again = True
            elif answer == "start" or (answer.startswith(("Error:", "!!")) and not _is_about_a_line(answer)):
                if answer == "start":
                    raise self._report_reset(label, waypoint)
                told = answer.removeprefix("Error:")[:80]
                more = f": {told!r}. Look at it, then connect anew."
                raise self._failed(label, waypoint, "failed", more, told)
            else:  # it may answer a question
                self._answer.append(answer[:200])
                self._strange.append(answer[:80])
                self._count_stranger(answer)


def _is_ok(answer: str) -> bool:
    """Returns True for an acknowledgement; with ADVANCED_OK it is followed by free places (Marlin 19221)."""
    return answer == "ok" or answer.startswith("ok ")


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
