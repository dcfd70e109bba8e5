"""The firmware family of GRBL 1.1: GRBL, its clones, grblHAL and FluidNC over an open line.

Protocol: github.com/gnea/grbl, doc/markdown ("Interface", "Settings", "Laser mode", "Jogging"): acknowledged lines,
real-time bytes, reports.
"""

import re
import time
import zlib
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.deadline import steady
from frida_painter.hardware.gcode import Gcode
from frida_painter.hardware.interlock import PATIENCE, Interlock
from frida_painter.hardware.robot import MachineFact
from frida_painter.hardware.timing import AxisTiming
from frida_painter_drivers.firmware import JOG_FEED, SLICE, AnyFirmware, Box
from frida_painter_drivers.serial_line import SerialLine

_HOLD, _RESET, _STATUS = b"!", b"\x18", b"?"
_GREETING = 7.0  # seconds until a board has started: a bootloader takes two, a processor with wireless up to five
_ASK_AFTER = 0.5
_MAX_REPORTS = 40  # At least one report in thirty contains the offset of the work coordinates.
_SETTLING = 0.6  # seconds for late answers to another program
_MILLIMETRES_PER_INCH = 25.4
_SEARCH, _LOCATE = 1.5, 10.0  # homing goes at most this times its travel fast, and this times its pull-off slowly
_OF_GRBL = ("[", "$", "error:", "ALARM:", ">")
_DWELL = 0.05  # seconds: GRBL and grblHAL wait for multiples of it (DWELL_TIME_STEP), and FluidNC for milliseconds
_SETTING = 0.02  # seconds: two acknowledged lines
_PAUSES = 10.0  # seconds that homing waits for its switches, speeds up and slows down
_BETWEEN = 0.01  # seconds between two motions, besides the dwell: questions for state and position
_COARSE = 0.3  # mm of a step of the height that a person is told of
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
    "Door": "stands, because its safety door is open",
    "Door:0": "stands, because its safety door was opened; the door is closed again",
    "Sleep": "is asleep",
    "Check": "only checks what it is sent, and does not move",
}
_MOVING = ("Run", "Jog", "Home", "Hold:1", "Door:2", "Door:3")  # it still moves, or brakes
_ERRORS = {
    "8": "it was not idle",
    "9": "it is locked by an alarm",
    "11": "the line was too long for it",
    "15": "beyond its travel",
    "20": "an unknown command",
    "22": "no feed",
}
_FAULTS = (  # beginning of a line, what the machine did, meanings of codes, and what a person does
    ("error:", "refused a line", _ERRORS, ", then connect anew."),
    ("ALARM:", "stopped", _ALARMS, " and clear the alarm with its own controls; this program never does."),
)


@dataclass(frozen=True)
class _Report:
    state: str
    numbers: dict[str, NDArray[np.float64]]
    pins: str = ""

    @property
    def held(self) -> bool:
        """True if a person holds the machine by its feed hold."""
        return self.state.startswith("Hold")


@dataclass
class _Told:
    """Facts that the controller told at connection.

    settings: by number, as text; empty if it did not list them
    version: lines of $I
    modes: words of $G
    offsets: lines of $#
    """

    settings: dict[str, str] = field(default_factory=dict)
    version: list[str] = field(default_factory=list)
    modes: list[str] = field(default_factory=list)
    offsets: list[str] = field(default_factory=list)

    def number(self, name: str) -> float | None:
        """Returns a setting as a number; None if it is not known."""
        try:
            return float(self.settings[name].split(" ")[0])
        except (KeyError, ValueError):
            return None

    def about(self, name: str) -> str:
        """Returns what the line [NAME:...] of $I says; "" without such a line."""
        return next((line[len(name) + 2 :].rstrip("]") for line in self.version if line.startswith(f"[{name}:")), "")

    def bit(self, name: str, bit: int) -> bool:
        """Returns a bit of a setting; False if it is not known."""
        return bool(int(self.number(name) or 0) >> bit & 1)

    def numbers(self, first: int) -> tuple[float, float, float] | None:
        """Returns three settings of the axes; None if one is not known or not above 0.

        A machine of two axes has a servo, whose timing is its own; its third setting is like the second.
        """
        found = [self.number(str(first + axis)) for axis in range(3)]
        found[2] = found[1] if found[2] is None else found[2]
        x, y, z = (value if value is not None and value > 0 else np.nan for value in found)
        return (x, y, z) if np.isfinite((x, y, z)).all() else None


_PROBED = re.compile(r"\[PRB:-?[\d.]+,-?[\d.]+,(-?[\d.]+)[^:]*:([01])\]")


class Grbl(AnyFirmware):
    """Firmware of the GRBL family over an open line."""

    def __init__(self, line: SerialLine, interlock: Interlock, language: Gcode, *, homing: bool) -> None:
        super().__init__(line, interlock, language, homing=homing)
        self._told = _Told()
        self._offset: NDArray[np.float64] | None = None
        self._inches = False
        self._state = ""
        self._ok_follows_report = self._skips_ok = self._button = False
        self._axes = 3
        self._moved_at = time.monotonic()
        self._place: NDArray[np.float64] | None = None
        self._probes: deque[tuple[float, bool]] = deque(maxlen=9)  # machine height in mm, and if the contact closed

    # Connection: what the controller tells, and that it is ready.

    def greet(self, *, release: bool) -> None:
        """Asks until the machine answers, because many boards restart when their line is opened, then reads it out.

        release: True to make a machine that a stop has held forget its motions
        """
        until = time.monotonic() + _GREETING
        while (report := self._report_within(5 * SLICE)) is None:
            if time.monotonic() > until:
                raise RobotDisconnected(
                    f"{self._interlock.name} gave no report of its state in {_GREETING:.0f} s; is this GRBL, and at "
                    "this baud rate? After a limit switch was hit it is silent until it is reset with its own controls."
                )
        self.line.write(b"\n")  # ends a line that another program left half
        quiet = time.monotonic() + _SETTLING
        while time.monotonic() < quiet and self._hear(4 * SLICE) is not None:
            pass
        self._ok_follows_report = self._tells_ok_after_report() and self._tells_ok_after_report()
        if release and report.held and self._stands():  # it keeps its position
            self._reset()
        told = self._told
        if not self._state.startswith(("Sleep", "Hold", "Door")):  # in these it reads no line
            told.version = self._list("$I")
            told.settings = dict(line[1:].split("=", 1) for line in self._list("$$") if re.match(r"\$\d+=", line))
            told.modes = next((line[4:-1].split() for line in self._list("$G") if line.startswith("[GC:")), [])
            told.offsets = self._list_offsets()
            if self._name == "FluidNC":  # $$ says only a part of its configuration
                for axis in "xyz"[: self._axes]:
                    lines = (line.strip().partition(": ") for line in self._list(f"$/axes/{axis}"))
                    told.settings |= {f"{axis} {name}": value for name, _, value in lines if value}
        self._inches = told.settings.get("13", "0").startswith("1")
        self._offset = None  # it was read before the unit was known
        if told.number("20") == 1:  # its limits are those of the machine's coordinates
            for _ in range(_MAX_REPORTS):
                if self._offset is None:
                    self._ask()
        self._zero_known = not self._was_reset and self._is_marked()

    def prepare(self) -> None:
        """Makes the machine ready to move, and moves nothing. A machine that only homes stays as it is."""
        state = self._ask().state
        self.locked = state.startswith("Alarm") and self._homing_wanted and self.can_home
        if self.locked:  # it takes nothing but $H, and a person is asked first
            self._zero_known = False
            return
        if not state.startswith("Idle"):
            raise RobotError(
                f"{self._interlock.name} is not ready: it says {state!r}. Look at it, home or release it with its own "
                "controls (or allow homing in its settings), then connect anew; this program never clears an alarm."
            )
        self._set_modes()
        self._button = False  # it may have been held by a stop

    def _set_modes(self) -> None:
        # Laser mode puts out nothing in the modal state G0, which holds after a reset: the servo would drop.
        for command in ("G21", "G90", "G94", f"G1 F{60_000 * self._language.approach:.0f}"):
            self.send(command, "connect", None)
        self._offset = None
        self.position()

    def facts(self) -> Iterator[MachineFact]:
        """Yields what the controller told, for a person."""
        told, servo = self._told, self._language.servo
        buffer = [*told.about("OPT").split(","), "", ""][2]
        told_buffer = f", with a buffer of {buffer} bytes" if buffer.isdigit() else ""
        yield MachineFact(
            f"It is {self._name} {self._version.replace('FluidNC ', '')}{told_buffer}."
            if self._version
            else "It is a machine that speaks GRBL 1.1."
        )
        if not told.settings:
            yield MachineFact(
                "It did not list its settings, so times are reckoned for full speed; connect while it is idle.",
                "warning",
            )
        if self._was_reset:
            yield MachineFact("Its board restarts when its line is opened. From now on the line is kept so that it "
                              "does not.")  # fmt: skip
        if told.settings:
            yield from self._explain_zero()
        rates, gains = told.numbers(110), told.numbers(120)
        if rates and gains:
            x, y, z = (rate / 60 for rate in rates)
            yield self._explain_speeds((x, y, z), gains, " ($110 to $112)", "")
            if min(gains) <= 10 or min(rates) <= 500:
                yield MachineFact("These are GRBL's default limits, far below what most machines can do: everything "
                                  "takes long. Raise $110 to $112 and $120 to $122 as your machine allows.",
                                  "warning")  # fmt: skip
        if (release := told.number("1")) not in (None, 255):
            text = f"It releases its motors {release:g} ms after each motion ($1={release:g}): "
            if self._language.sinks:
                yield MachineFact(f"{text}the brush would sink, as its name says (sinks=yes). Set $1=255.", "refusal")
            else:
                yield MachineFact(
                    f"{text}a push moves it, and a brush on an axis that does not lock itself sinks. Set $1=255.",
                    "warning",
                    "Its motors are off between two motions. Does the brush stay at its height then, and does nobody "
                    "push the machine?",
                )
        if self._inches:
            yield MachineFact("It reports inches ($13=1), which are converted.")
        if told.number("20") == 1 and (travel := told.numbers(130)):
            yield MachineFact(f"Its own limits are {travel[0]:g} x {travel[1]:g} x {travel[2]:g} mm ($20=1).")
        if told.settings and not self.can_home:
            yield MachineFact(
                "It has no homing ($22=0): after a power cut a person finds its zero. If it has limit switches, set "
                "$22=1.",
                "warning" if self._homing_wanted else "fact",
                "It does not home ($22=0). Shall the setup go on without limit switches? You then move its tip to its "
                "front left corner, by keys."
                if self._homing_wanted
                else "",
            )
        if self._axes < 3 and self._language.tells_height:
            yield MachineFact("It has no axis Z, so nothing raises the brush: give servo=, or own= with lines that do.",
                              "refusal")  # fmt: skip
        if servo is not None:
            yield from self._explain_servo()
        if self._ok_follows_report:
            yield MachineFact("It is a clone that says ok after each report; these are not counted.")
        state = self._state
        if state.startswith("Alarm"):
            help_it = (
                "you are asked before it homes (homing=yes)." if self._homing_wanted and self.can_home
                else "home it or release it with its own controls, or allow homing in its name (homing=yes)."
            )  # fmt: skip
            yield MachineFact(f"It is in an alarm: {help_it}", "fact" if self._homing_wanted else "warning")
        elif not state.startswith(("Idle", "Hold")):
            yield MachineFact(f"It says {state!r}: it is not ready to move; look at it.", "warning")

    @property
    def _version(self) -> str:
        return self._told.about("VER").rstrip(":")

    @property
    def _name(self) -> str:
        return self._told.about("FIRMWARE") or ("FluidNC" if "FluidNC" in self._version else "GRBL")

    def _explain_servo(self) -> Iterator[MachineFact]:
        servo, told = self._language.servo, self._told
        assert servo is not None
        most, least = told.number("30"), told.number("31") or 0.0
        for value in (servo.low[1], servo.high[1]):
            if most is not None and not least <= value <= most:
                yield MachineFact(
                    f"The servo's value {value:g} is outside of {least:g} to {most:g} ($31, $30), and would be cut off "
                    "silently. Give other values, or set $30.",
                    "refusal",
                )
        height = (servo.high[0] - servo.low[0]) / max(abs(servo.high[1] - servo.low[1]), 1e-9)
        if most is not None and self._name == "GRBL" and (level := 1000 * height * (most - least) / 254) > _COARSE:
            yield MachineFact(f"It puts out 255 levels (an 8-bit timer), so heights come in steps of {level:.2g} mm. "
                              "Set $30 to the servo's greatest value.", "warning")  # fmt: skip
        if told.number("32") == 1:
            yield MachineFact("Laser mode is on ($32=1): heights change while it moves, but a stop cuts the servo's "
                              "signal, and the brush may drop. Set $32=0 if that matters more.", "warning")  # fmt: skip
        elif told.number("32") == 0:
            yield MachineFact("Laser mode is off ($32=0): it stands still at every change of height. Set $32=1 for "
                              "smooth strokes; then a stop cuts the servo's signal.", "warning")  # fmt: skip

    def timing(self) -> AxisTiming | None:
        """Returns the limits of the axes; None if they were not told."""
        rates, gains, deviation = self._told.numbers(110), self._told.numbers(120), self._told.number("11")
        if rates is None or gains is None:
            return None
        speed, gain = [rate / 60_000 for rate in rates], [one / 1000 for one in gains]
        tick = 0.001 if self._name == "FluidNC" else _DWELL
        return AxisTiming(
            (speed[0], speed[1], speed[2]),
            (gain[0], gain[1], gain[2]),
            deviation=max((deviation or 0.0) / 1000, 0.0),
            between=_BETWEEN + tick,
            servo=self._language.servo_timing(tick, _SETTING, stops=self._told.number("32") != 1),
        )

    def box(self) -> Box | None:
        """Returns two corners of the box that limits its motion, mm of its work coordinates; None without limits."""
        told, travel = self._told, self._told.numbers(130)
        if told.number("20") != 1 or travel is None or self._offset is None:
            return None
        # Machine space is below 0 (system.c), unless the switches are its zero: letter Z of $I, always in FluidNC.
        flags, fluid = told.about("OPT").partition(",")[0], self._name == "FluidNC"
        at_zero = fluid or "Z" in flags
        lower, upper = -np.array(travel), np.zeros(3)
        for axis in range(3):
            if at_zero and told.bit("23", axis):  # it homes to its lower end
                lower[axis], upper[axis] = 0.0, travel[axis]
            if fluid:
                shift = float(told.settings.get(f"{'xyz'[axis]} mpos_mm", 0))
                lower[axis], upper[axis] = lower[axis] + shift, upper[axis] + shift
        if told.bit("21", 0) and self.can_home and not fluid:  # at the switches, hard limits raise an alarm
            off = told.number("27") or 0.0
            lower, upper = lower + off * (lower < 0), upper - off * ((upper > 0) | (not at_zero))
        return lower - self._offset, upper - self._offset

    # The zero. GRBL and FluidNC forget their T word at every reset, and it moves nothing; so it tells if the position
    # survived. GRBL forgets it at each line without one, too (gcode.c, [5. Select tool]), so each line has one. grblHAL
    # may keep it over a power cut; its S word tells the same, and is set only while the spindle is off. With a servo on
    # grblHAL, the servo's own value tells it.

    @property
    def _marks_lines(self) -> bool:
        return self._name != "grblHAL"

    @property
    def can_home(self) -> bool:
        """True if it has limit switches."""
        return self._told.bit("22", 0)  # grblHAL's other bits say how it homes

    @property
    def homing_seconds(self) -> float:
        """Longest duration of homing, seconds: every axis alone, over all of its travel."""
        told, seconds = self._told, _PAUSES
        for axis, travel in zip("xyz", told.numbers(130) or (1000.0, 1000.0, 1000.0), strict=True):
            seek, feed = (
                float(told.settings.get(f"{axis} {name}_mm_per_min", 0)) or told.number(number) or usual
                for name, number, usual in (("seek", "25", 200.0), ("feed", "24", 25.0))
            )
            off = float(told.settings.get(f"{axis} pulloff_mm", 0)) or told.number("27") or 1.0
            rounds = told.number("43") or 1.0  # of grblHAL
            seconds += 60 * (_SEARCH * travel / seek + rounds * _LOCATE * off / feed)
        return seconds

    def home(self) -> None:
        """Lifts the brush if that needs no axis, and drives to the limit switches: the axis Z first, as GRBL does.

        GRBL reports nothing meanwhile. In an alarm it takes no other line than this one.
        """
        if self._ask().state.startswith("Idle") and not self._language.tells_height:
            self.lift("homing")
        self._drive_home("$H", self.homing_seconds)
        self.locked = False
        self._set_modes()
        self._mark_zero()

    def set_zero(self, tip: NDArray[np.float64]) -> None:
        """Declares that the tip stands at `tip` [3] mm of the work coordinates."""
        self.send(f"G10 L20 P0 {self._words(tip)}", "set zero", None)
        self._offset = None
        self._mark_zero()

    def _mark_zero(self) -> None:
        self._was_reset, self._zero_known = False, True
        self._told.offsets = self._list_offsets()
        if mark := self._mark_word():
            self.send(mark, "zero", None)

    def _mark_word(self) -> str:
        """Returns the word that notes in the machine that its zero is known; "" if it would move something."""
        if self._marks_lines:
            return f"T{self._mark(254)}"
        return f"S{self._mark(900)}" if any("M5" in line.split() for line in self._list("$G")) else ""

    def _list_offsets(self) -> list[str]:
        return [line for line in self._list("$#") if line.startswith(("[G5", "[G92"))]

    def _mark(self, most: int) -> int:
        """Returns the number, 1 to `most`, that stands for these offsets of the work coordinates."""
        return 1 + zlib.crc32("".join(self._told.offsets).encode()) % most

    def _is_marked(self) -> bool:
        words, servo = {word[0]: word[1:] for word in self._told.modes}, self._language.servo
        if self._marks_lines:
            return words.get("T") == str(self._mark(254))
        try:
            power = float(words.get("S", "0"))
        except ValueError:
            return False
        if servo is None:
            return "M5" in self._told.modes and power == self._mark(900)
        low, high = sorted((servo.low[1], servo.high[1]))
        return "M3" in self._told.modes and low - 1 <= power <= high + 1 and power > 0

    def jog(self, step: NDArray[np.float64], label: str) -> None:
        """Moves by `step` [3] mm, and returns when the machine stands."""
        words = (f" {axis}{value:.3f}" for axis, value in zip("XYZ", step, strict=True) if value)  # it may have no Z
        self.send(f"$J=G91 G21{''.join(words)} F{JOG_FEED}", label, None)
        self._await_idle(label)

    # Motion.

    def probe(self, lowest: float, feed: float, label: str) -> float | None:
        """Moves straight down until the probe's contact closes; returns the work height there, or None without contact.

        lowest: work height in mm at which it ends
        feed: mm/min
        """
        self._probes.clear()
        self.send(f"G38.3 Z{lowest:.3f} F{feed:.0f}", label, None)
        self.settle(label)
        if not self._probes:
            said = "said nothing of a probe ([PRB:...]); this firmware has none. Lower the brush yourself."
            raise self._interlock.failure(MotionFailed, label, said, "probe")
        height, touched = self._probes[-1]
        if not touched:
            return None
        here = self.position()[2]  # also learns the offset of the work coordinates
        return float(here) if self._offset is None else height - float(self._offset[2])

    def send(self, line: str, label: str, waypoint: int | None, quiet: float = 0.0) -> None:
        """Sends a line and waits for its "ok", as long as the machine lives.

        quiet: seconds for which it may say nothing, or report that it is idle, while it obeys the line
        """
        dwell = re.match(r"G4 P([\d.]+)", line)
        quiet += float(dwell[1]) if dwell else 0.0
        self._catch_up(label)
        marks = self._zero_known and self._marks_lines and not re.match(r"\$|.*T\d", line)
        mark = f" {self._mark_word()}" if marks else ""
        self.line.write(f"{line}{mark}\n".encode("ascii"))
        began = self._heard_at = self._moved_at = time.monotonic()
        idle, ask_at = 0, began + _ASK_AFTER
        while True:
            answer = self._read(label, waypoint)
            if answer == "ok":
                return
            now = time.monotonic()
            if answer is not None and answer.startswith("<"):
                self._require_running(label, waypoint)
                waits = now < began + quiet + _ASK_AFTER
                idle = idle + 1 if self._state.startswith("Idle") and not waits else 0
            if idle > 2:
                said = f"is idle and has not acknowledged {line!r}. A line was lost; look at the cable."
                raise self._interlock.failure(RobotDisconnected, label, said)
            self._require_alive(label, quiet)
            if now > ask_at and not self._homes:
                self.line.write(_STATUS)
                ask_at = now + _ASK_AFTER

    def settle(self, label: str) -> None:
        """Returns when the machine has done everything and is idle; some acknowledge the dwell too early."""
        self.send("G4 P0.01", label, None)
        self._await_idle(label)

    def _await_idle(self, label: str) -> None:
        while not (report := self._ask()).state.startswith("Idle"):
            self._require_running(label, None)
            self._require_alive(label, 0.0)
            if self._interlock.stopped:
                raise RobotStopped(
                    f"{label}: {self._interlock.name} acknowledged the end of its motion, and says {report.state!r}; "
                    "it is held. Look at it before it is connected anew."
                )
            time.sleep(SLICE)

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

    def wants_pause(self) -> bool:
        """Returns True, once, if the board's feed hold was pressed."""
        report = self._ask()
        pressed = self._button or report.held or "H" in report.pins
        self._button = False
        return pressed

    @property
    def stop_bytes(self) -> bytes:
        """Feed hold: a byte that GRBL obeys at any place of a line. The machine keeps its position.

        Homing does not heed it; a reset ends that.
        """
        return _RESET if self._homes else _HOLD

    def forget(self) -> None:
        """Resets the machine once it stands; a reset in motion would lose its position. Clears no alarm.

        With a servo it only stays held: a reset would cut the servo's signal, and the brush would drop.
        """
        if self._stands() and self._language.servo is None:
            self._reset()

    def _stands(self) -> bool:
        """Waits while a held machine brakes; returns True if it stands then, without an alarm."""
        rates, gains = self._told.numbers(110), self._told.numbers(120)
        braking = 2.0 if rates is None or gains is None else max(rates) / 60 / min(gains)
        until = time.monotonic() + 2.0 + braking
        while time.monotonic() < until:
            state = self._ask().state
            if state not in _MOVING:
                return not state.startswith("Alarm")
            time.sleep(SLICE)
        return False

    def _reset(self) -> None:
        """Resets a standing machine, which keeps its position, and notes in it that it is still known."""
        known = self._zero_known
        self.line.write(_RESET)
        until = time.monotonic() + 1
        while time.monotonic() < until and not self._was_reset:
            self._hear(SLICE)
        self._was_reset, self._zero_known = False, known
        if known and (mark := self._mark_word()):  # not by `send`, which heeds a stop
            self.line.write(f"{mark}\n".encode("ascii"))
            self._hear(4 * SLICE)

    # Lines that come.

    def _hear(self, seconds: float = SLICE) -> str | None:
        """Returns the next line that means something, without the oks that a clone says after reports."""
        answer = self.line.read(seconds)
        if answer is None:
            return None
        self._heard_at = time.monotonic()
        if answer == "ok":
            if self._skips_ok:  # a clone's own, after a report
                self._skips_ok = False
                return ""
            self.alive = steady()
        elif answer.startswith("<"):
            self._skips_ok = self._ok_follows_report
            self._take(self._parse_report(answer))
        elif answer.lower().startswith("grbl"):
            self._was_reset, self._zero_known = True, False
        elif found := _PROBED.fullmatch(answer):
            self._probes.append((float(found[1]) * (_MILLIMETRES_PER_INCH if self._inches else 1.0), found[2] == "1"))
        elif answer and not answer.startswith(_OF_GRBL) and self._listens:
            self._count_stranger(answer)
        return answer

    def _take(self, report: _Report) -> None:
        """Notes the state and if the machine shows that it lives."""
        self._state = report.state
        here = report.numbers.get("MPos", report.numbers.get("WPos"))
        moved = here is not None and (self._place is None or not np.array_equal(here, self._place))
        self._place = here if here is not None else self._place
        if report.held and not self._interlock.stopped:
            self._button = True
        if moved or report.held or report.state.startswith(("Home", "Idle")):
            self._moved_at = time.monotonic()
        if moved or report.held or report.state.startswith("Home"):
            self.alive = steady()

    def _ask(self) -> _Report:
        """Requests a report and returns it. Raises RobotDisconnected if none comes."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            if (report := self._report_within(10 * SLICE)) is not None:
                return report
        raise RobotDisconnected(
            f"{self._interlock.name} gave no report of its state in {PATIENCE:.0f} s; is this GRBL, and at this baud "
            "rate?"
        )

    def _report_within(self, seconds: float) -> _Report | None:
        self.line.write(_STATUS)
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            answer = self._hear(SLICE)
            if answer is not None and answer.startswith("<"):
                return self._parse_report(answer)
        return None

    def _tells_ok_after_report(self) -> bool:
        """Asks for a report while nothing waits for an ok; returns True if one comes all the same."""
        if self._report_within(10 * SLICE) is None:
            return False
        until = time.monotonic() + 3 * SLICE
        while time.monotonic() < until:
            if self._hear(SLICE) == "ok":
                return True
        return False

    def _list(self, question: str) -> list[str]:
        """Returns the lines that answer a question of GRBL's own, without the ok; [] if it refuses to answer.

        Raises RobotDisconnected if the ok does not come: it would acknowledge another line later.
        """
        self.line.write(question.encode("ascii") + b"\n")
        found: list[str] = []
        began = self._heard_at = time.monotonic()
        while time.monotonic() < min(self._heard_at + PATIENCE, began + 6 * PATIENCE):
            answer = self._hear(SLICE)
            if answer == "ok":
                return found
            if answer is not None and answer.startswith("error:"):
                return []
            if answer:
                found.append(answer)
        raise RobotDisconnected(
            f"{self._interlock.name} did not end its answer to {question!r}; look at its cable, then connect anew."
        )

    def _require_alive(self, label: str, quiet: float) -> None:
        """Raises RobotDisconnected if the machine says nothing, or says that it moves and does not."""
        now = time.monotonic()
        if now > self._heard_at + PATIENCE + quiet:
            raise RobotDisconnected(
                f"{label}: {self._interlock.name} has said nothing for {now - self._heard_at:.0f} s and is given up. "
                "Look at it and at its cable, then connect anew."
            )
        if now > self._moved_at + PATIENCE + quiet:
            raise RobotDisconnected(
                f"{label}: {self._interlock.name} says {self._state!r} and has not moved for "
                f"{now - self._moved_at:.0f} s. Look at it, then connect anew."
            )

    def _require_running(self, label: str, waypoint: int | None) -> None:
        """Raises MotionFailed if the state needs a person, RobotStopped after a stop. A held machine is waited for."""
        self._interlock.heed_stop(label)
        state = self._state
        kind = state.partition(":")[0]
        meaning = _STANDING.get(state) or _STANDING.get(kind)
        if meaning is not None:
            remedy = (
                "clear the alarm with its own controls; this program never does"
                if kind == "Alarm"
                else "see that it can move, reset it with its own controls, then connect anew"
            )
            more = f"; it says {state!r}. Look at it, and {remedy}."
            raise self._failed(label, waypoint, meaning, more, state)

    def _read(self, label: str, waypoint: int | None) -> str | None:
        """Returns one line of the machine, None if none came. Raises the errors that it reports."""
        resets = self._was_reset
        answer = self._hear(SLICE)
        self._interlock.heed_stop(label)
        for start, verb, meanings, remedy in _FAULTS:
            if answer is not None and answer.startswith(start):
                code = answer.removeprefix(start).strip()
                meaning = f" ({meanings[code]})" if code in meanings else ""
                more = f" with {start[:-1].lower()} {code}{meaning}. Look at it{remedy}"
                raise self._failed(label, waypoint, verb, more, code)
        if self._was_reset and not resets:
            raise self._report_reset(label, waypoint)
        return answer

    def _parse_report(self, report: str) -> _Report:
        parts = report.strip("<>").split("|")
        if "," in parts[0]:  # <Idle,MPos:0.000,0.000,0.000,WPos:...>
            raise RobotError(
                f"{self._interlock.name} has GRBL 0.9 or older, which tells too little of itself. Write down its "
                "settings ($$), flash GRBL 1.1 (github.com/gnea/grbl/wiki/Flashing-Grbl-to-an-Arduino), and set them "
                "again."
            )
        numbers: dict[str, NDArray[np.float64]] = {}
        pins = ""
        for part in parts[1:]:
            name, _, values = part.partition(":")
            pins = values if name == "Pn" else pins
            if name not in ("MPos", "WPos", "WCO"):
                continue
            try:
                here = np.array([float(value) for value in values.split(",")[:3]])
            except ValueError:
                here = np.empty(0)
            if here.shape == (2,):  # FluidNC with two axes
                self._axes, here = 2, np.array([*here, 0.0])
            if here.shape != (3,) or not np.isfinite(here).all():
                raise RobotDisconnected(
                    f"{self._interlock.name} reported {report[:80]!r}, which is no place; look at its line."
                )
            numbers[name] = here * _MILLIMETRES_PER_INCH if self._inches else here
        self._offset = numbers.get("WCO", self._offset)
        return _Report(parts[0], numbers, pins)
