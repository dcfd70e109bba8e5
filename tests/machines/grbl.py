"""Simulated controllers of the GRBL family: GRBL 1.1, clones of it, grblHAL and FluidNC.

Written from the documents of gnea/grbl (doc/markdown: interface, commands, settings, laser_mode, jogging; config.h
and defaults.h for the numbers), the wiki of grblHAL and of FluidNC, and transcripts in issues of UGS. What a sentence
of them says is in the comment beside it.
"""

import math
import re
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from machines.motion_queue import MotionQueue
from machines.simulated_time import Cable

DEFAULTS = {
    "0": 10, "1": 25, "2": 0, "3": 0, "4": 0, "5": 0, "6": 0, "10": 1, "11": 0.010, "12": 0.002, "13": 0,
    "20": 0, "21": 0, "22": 0, "23": 0, "24": 25.0, "25": 500.0, "26": 250, "27": 1.0, "30": 1000, "31": 0, "32": 0,
    "100": 250.0, "101": 250.0, "102": 250.0, "110": 500.0, "111": 500.0, "112": 500.0,
    "120": 10.0, "121": 10.0, "122": 10.0, "130": 200.0, "131": 200.0, "132": 200.0,
}  # fmt: skip
"""Settings of DEFAULTS_GENERIC."""
QUICK = {
    "1": 255, "110": 8000.0, "111": 8000.0, "112": 3000.0, "120": 500.0, "121": 500.0, "122": 200.0,
    "130": 500.0, "131": 500.0, "132": 100.0,
}  # fmt: skip
"""Settings of a plotter that somebody has set up."""

_BOOT = 1.6  # seconds until an Arduino's bootloader hands over to GRBL
_LINE = 80  # bytes of a line that GRBL 1.1 keeps (LINE_BUFFER_SIZE)
_INCH = 25.4
_M_CODES = ("M0", "M2", "M3", "M4", "M5", "M7", "M8", "M9", "M30")


@dataclass
class Kind:
    """What differs between the members of the family."""

    banner: str = "Grbl 1.1h ['$' for help]"
    version: tuple[str, ...] = ("[VER:1.1h.20190825:]", "[OPT:V,15,128]")
    boot: tuple[str, ...] = ()
    buffer: int = 128
    blocks: int = 15
    line: int = _LINE
    resets_when_opened: bool = True
    ok_after_report: bool = False
    chatter: tuple[str, ...] = ()  # lines of its own, now and then
    tells_homed: bool = False
    dwell_step: float = 0.05  # nuts_bolts.c: it waits for multiples of DWELL_TIME_STEP
    mute_after_limit: bool = True  # protocol.c: after a critical alarm it hears nothing but a reset
    hides: tuple[str, ...] = ()  # settings that it does not list
    axes: int = 3
    tool: str = (
        "line"  # kept to the next "line" (gcode.c), until a "reset" (FluidNC), or only "changed" by M6 (grblHAL)
    )
    old: bool = False  # GRBL 0.9: report.c of v0.9j, <Idle,MPos:...,WPos:...>
    slow: float = 0.0  # seconds between the halves of the list of settings: a slow or busy line
    at_zero: bool = False  # HOMING_FORCE_SET_ORIGIN (limits.c, system.c); always in FluidNC (Limit.cpp)
    places: tuple[float, ...] = (0.0, 0.0, 0.0)  # FluidNC: mpos_mm of its axes


GRBL = Kind()
CLONE = Kind(
    banner="Grbl 1.1f ['$' for help]",
    version=("[VER:1.1f.20170801:]", "[OPT:V,15,128]"),
    boot=("VIGO engraver v2.3", ""),
    ok_after_report=True,  # UGS 2295: "ok" after every status report
    chatter=("[VIGO:temp 31]", "key idle"),
)
GRBLHAL = Kind(
    banner="GrblHAL 1.1f ['$' or '$HELP' for help]",
    version=(
        "[VER:1.1f.20240812:]", "[OPT:VNMSL,35,1024,3,0]", "[AXS:3:XYZ]", "[NEWOPT:ENUMS,RT+,HOME,ES,SED]",
        "[FIRMWARE:grblHAL]", "[DRIVER:iMXRT1062]", "[BOARD:T41U5XBB]",
    ),
    buffer=1024,
    blocks=35,
    line=257,
    mute_after_limit=False,
    resets_when_opened=False,  # USB CDC of the processor itself
    tells_homed=True,
    tool="changed",
)  # fmt: skip
FLUIDNC = Kind(
    banner="Grbl 3.7 [FluidNC v3.7.16 (wifi) '$' for help]",
    version=("[VER:3.7 FluidNC v3.7.16:]", "[OPT:MPHSW]", "[MSG: Machine: plotter]"),
    boot=("[MSG:INFO: FluidNC v3.7.16 https://github.com/bdring/FluidNC]", "[MSG:INFO: Machine plotter]"),
    buffer=256,
    blocks=16,
    line=255,
    mute_after_limit=False,
    dwell_step=0.001,
    hides=("0", "1", "2", "3", "4", "5", "6", "24", "25", "26", "27"),  # its configuration file says these
    at_zero=True,
    tool="reset",
)
FLUIDNC_FLAT = replace(FLUIDNC, axes=2, hides=(*FLUIDNC.hides, "112", "122", "132"))  # Axes::_numberAxis is 2
ORIGIN = Kind(version=("[VER:1.1h.20190825:]", "[OPT:VZ,15,128]"), at_zero=True)  # report.c: the letter Z
GRBL_0_9 = Kind(banner="Grbl 0.9j ['$' for help]", version=("[0.9j.20160317:]",), old=True)
SLOW = Kind(slow=2.2)


@dataclass
class Line:
    """A line that waits to be obeyed."""

    text: str
    overlong: bool


class GrblController:
    """Controller of the family. `kind`: which; `settings`: what differs from the defaults.

    tip: where the brush really is, mm in the frame of a person who measures; machine coordinates may be off from it
    pulse: value at the PWM output (0: no pulse); output: every change of it with the tip's place
    button: True while the feed hold button of the board is pressed; door likewise
    """

    def __init__(self, kind: Kind = GRBL, settings: dict[str, float] | None = None, *, powered: bool = True) -> None:
        self.kind = kind
        self.settings: dict[str, float] = {**DEFAULTS, **(settings or {})}
        self.resets_when_opened = kind.resets_when_opened
        self.cable: Cable
        number = self.settings
        self.queue = MotionQueue(
            np.array([number["110"], number["111"], number["112"]]) / 60,
            np.array([number["120"], number["121"], number["122"]]),
            deviation=number["11"],
            room=kind.blocks,
        )
        self.slip = np.zeros(3)  # tip = machine position + slip
        self._past: list[np.ndarray] = []
        self.switches = np.zeros(3)  # where the tip stands after homing, for a person who measures
        self.surface: float | None = None  # height of the tip at which it closes the contact of a probe
        self._probing: float | None = None  # where the probe's way ends, machine coordinates
        self.wall: float | None = None  # x of the tip at which a limit switch is hit
        self.stored = np.zeros(3)  # G54, in EEPROM
        self.received: list[str] = []
        self.pulse = 0.0
        self.output: list[tuple[float, np.ndarray]] = []
        self.alarms: list[int] = []
        self.state = "Idle"
        self.homed = False
        self.button = self.door = False
        self.dead = self.mute = False
        self.lose_lines = 0
        self.reports = 0
        self.starts = 0
        self._booting = self._lists = 0.0
        self._late: list[str] = []
        self._since_chatter = 0.0
        self.often = False
        self._rx = b""
        self._line = b""
        self._waiting: deque[Line] = deque()
        self._dwell = 0.0
        self._homing = 0.0
        self._syncing: str | None = None
        self._jogging = False
        self._parser()
        if powered:
            self._power_on()

    # The truth, for tests.

    @property
    def tip(self) -> np.ndarray:
        return self.queue.place + self.slip

    @property
    def moved(self) -> list[np.ndarray]:
        return self._past + self.queue.moved_at(self.slip)

    @property
    def work_offset(self) -> np.ndarray:
        return self.stored + self.shift

    def forget_way(self) -> None:
        """Forgets the places until now."""
        self.queue.moved.clear()

    def chat_often(self) -> None:
        """Says lines of its own all the time, as clones and printers do."""
        self.often = True

    def power_cut(self, seconds: float = 0.0) -> None:
        """Takes the power away and gives it back: the tip stays where it is, and the controller forgets."""
        self.restart()

    def fail(self, alarm: int) -> None:
        """Raises an alarm: 1 is a limit switch."""
        self.queue.drop()
        self._set_alarm(alarm)

    # What the cable wants of it.

    def restart(self) -> None:
        """The processor was reset: counters are 0 wherever the machine stands (gnea/grbl 160)."""
        self._past += self.queue.moved_at(self.slip)
        self.slip = self.tip.copy()
        self.queue.drop()
        self.queue.place = np.zeros(3)
        self.queue.moved = []
        self.homed = self.mute = False
        self.starts += 1
        self._booting = _BOOT
        self._rx = self._line = b""
        self._waiting.clear()
        self._set_pulse(0.0)
        self._parser()

    def _power_on(self) -> None:
        self._parser()
        self.state = "Alarm" if int(self.settings["22"]) & 1 else "Idle"  # grblHAL: bit 0 of homing_settings_flags_t

    def _parser(self) -> None:
        """Start of the G-code parser: the same after power-up and after a soft reset (gc_init)."""
        self._probing = None
        self.shift = np.zeros(3)  # G92
        self.motion, self.absolute, self.inches, self.per_minute = "G0", True, False, True
        self.spindle, self.power, self.feed, self.tool = "M5", 0.0, 0.0, 0
        self._dwell = self._homing = 0.0
        self._syncing = None
        self._jogging = False

    def hear(self, content: bytes) -> None:
        if self._booting > 0 or self.dead:
            return  # the bootloader eats them
        for byte in content:
            if self.mute and byte != 0x18:
                continue
            if byte == ord("?"):
                self._report()
            elif byte == ord("!"):
                self.received.append("!")
                self._feed_hold()
            elif byte == ord("~"):
                self.received.append("~")
                self._cycle_start()
            elif byte == 0x18:
                self.received.append("reset")
                self._soft_reset()
            elif byte == 0x85:
                if self._jogging:
                    self.queue.drop()
            elif byte >= 0x80:
                pass
            elif len(self._rx) < self.kind.buffer:
                self._rx += bytes([byte])
        self._read_lines()

    def _read_lines(self) -> None:
        """Takes lines out of the receive buffer; it is read only while no line is being obeyed."""
        while b"\n" in self._rx and not self._waiting:
            line, self._rx = self._rx.split(b"\n", 1)
            text = line.decode("ascii", "replace").strip("\r ")
            plain = re.sub(r"\(.*?\)|;.*|\s", "", text).upper()
            self._waiting.append(Line(plain, len(plain) >= self.kind.line))

    def pass_time(self, seconds: float) -> None:
        if self._booting > 0:
            self._booting -= seconds
            if self._booting <= 0:
                self._greet()
            return
        if self.dead:
            return
        self._chat(seconds)
        self._list_late(seconds)
        if self.button:
            self._feed_hold()
        if self.door and not self.state.startswith(("Door", "Alarm")):
            self.queue.hold()
            self.state = "Door:0"
        if self._homing > 0:
            self._homing -= seconds
            if self._homing <= 0:
                self._end_homing()
            return
        self.queue.advance(seconds)
        self._check_limits()
        if self.state == "Hold:1" and self.queue.speed == 0:
            self.state = "Hold:0"
        if self.state == "Hold:0" and self._laser:
            self._set_pulse(0.0)  # laser_mode.md: a hold switches the laser off
        if self.state in ("Run", "Jog") and not self.queue.moves:
            self.state, self._jogging = "Idle", False
        held = self.state.startswith(("Hold", "Door"))
        if self._probing is not None and not held and not self.queue.moves:
            self._end_probing()
        if self._dwell > 0 and not held and not self.queue.moves:
            self._dwell -= seconds
            if self._dwell <= 0:
                self._answer("ok")
        self._obey_waiting()

    def _list_late(self, seconds: float) -> None:
        self._lists -= seconds
        if self._lists <= 0:
            for line in self._late:
                self._answer(line)
            self._late = []

    def _obey_waiting(self) -> None:
        for _ in range(64):
            if self._late or self._dwell > 0 or self._homing > 0 or self.state.startswith(("Hold", "Door")):
                return
            if self._probing is not None:
                return
            if self._syncing is not None:
                if self.queue.moves:
                    return
                line, self._syncing = self._syncing, None
                self._execute(line)
                continue
            if not self._waiting:
                self._read_lines()
                if not self._waiting:
                    return
            if self.queue.full and self._is_motion(self._waiting[0].text):
                return
            line = self._waiting.popleft()
            self._read_lines()
            if self.lose_lines and self._is_motion(line.text):
                self.lose_lines -= 1
                continue
            if line.overlong:
                self._answer("error:11")  # "Max characters per line exceeded"
            elif not line.text:
                self._answer("ok")
            else:
                self.received.append(re.sub(r"(?<=.)T\d+$", "", line.text))  # without the mark of a known zero
                self._begin(line.text)

    def _is_motion(self, text: str) -> bool:
        return bool(re.search(r"[XYZ]", text)) and not text.startswith(("$", "G10", "G92"))

    # Lines.

    def _begin(self, text: str) -> None:
        if text.startswith("$"):
            self._system(text)
        elif self.state.startswith(("Alarm", "Jog")):
            self._answer("error:9")
        elif self._waits_for_stand(text):
            self._syncing = text
        else:
            self._execute(text)

    def _waits_for_stand(self, text: str) -> bool:
        """Some words make GRBL wait until all motions are done (protocol_buffer_synchronize)."""
        if not self.queue.moves:
            return False
        words = dict(re.findall(r"([A-Z])(-?[\d.]+)", text))
        if re.search(r"G4(?!\d)|G10|G38|M[345](?!\d)", text):
            return text != self.spindle
        spins = self.spindle != "M5" and "S" in words and float(words["S"]) != self.power
        return spins and not (self._laser and self._is_motion(text))

    def _execute(self, text: str) -> None:
        words = re.findall(r"([A-Z])(-?[\d.]+)", text)
        if not words or "".join(a + b for a, b in words) != text:
            self._answer("error:1" if not words else "error:2")
            return
        axes = {"XYZ".index(letter): float(value) for letter, value in words if letter in "XYZ"}
        numbers = {letter: float(value) for letter, value in words if letter in "FSPL"}
        code = ""
        for letter, value in words:
            word = f"{letter}{float(value):g}"
            if letter == "G":
                match word:
                    case "G0" | "G1":
                        self.motion = word
                    case "G4" | "G10" | "G92" | "G92.1" | "G38.3":
                        code = word
                    case "G20" | "G21":
                        self.inches = word == "G20"
                    case "G90" | "G91":
                        self.absolute = word == "G90"
                    case "G93" | "G94":
                        self.per_minute = word == "G94"
                    case "G54" | "G17" | "G40" | "G49" | "G61" | "G80":
                        pass
                    case _:
                        self._answer("error:20")  # "Unsupported or invalid g-code command"
                        return
            elif letter not in "GMXYZFSPLTN" or (letter == "M" and word not in _M_CODES):
                self._answer("error:20")
                return
        if any(axis >= self.kind.axes for axis in axes):
            self._answer("error:20")  # GCode.cpp: a word of an axis that is not there
            return
        tools = [int(float(value)) for letter, value in words if letter == "T"]
        if tools and not 0 <= tools[0] <= 255:  # MAX_TOOL_NUMBER
            self._answer("error:38")
            return
        if self.kind.tool != "changed":
            self.tool = tools[0] if tools else self.tool if self.kind.tool == "reset" else 0
        unit = _INCH if self.inches else 1.0
        if "F" in numbers:
            self.feed = numbers["F"] * unit
        turned = next((f"M{float(value):g}" for letter, value in words if letter == "M"), self.spindle)
        if turned in ("M3", "M4", "M5"):
            self._spin(turned, numbers.get("S", self.power), moving=bool(axes) and not code)
        if code == "G4":
            if "P" not in numbers:
                self._answer("error:28")
                return
            step = self.kind.dwell_step
            self._dwell = max(math.ceil(numbers["P"] / step - 1e-6) * step, 1e-6)
            return
        if code == "G10":
            if numbers.get("L") not in (2.0, 20.0) or numbers.get("P") not in (0.0, 1.0):
                self._answer("error:20")
                return
            for axis, value in axes.items():
                machine = self.queue.target[axis] - self.shift[axis]
                self.stored[axis] = value * unit if numbers["L"] == 2 else machine - value * unit
        elif code == "G92":
            for axis, value in axes.items():
                self.shift[axis] = self.queue.target[axis] - self.stored[axis] - value * unit
        elif code == "G92.1":
            self.shift = np.zeros(3)
        elif code == "G38.3":
            self._probe(axes, unit)
            return
        elif axes and not self._move(axes, unit):
            return
        self._answer("ok")

    def _move(self, axes: dict[int, float], unit: float) -> bool:
        target = self.queue.target.copy()
        for axis, value in axes.items():
            target[axis] = value * unit + (self.work_offset[axis] if self.absolute else target[axis])
        if self.motion == "G1" and self.feed <= 0:
            self._answer("error:22")  # "Feed rate has not yet been set or is undefined"
            return False
        if self.settings["20"] and not self._within_travel(target):
            self.queue.drop()
            self._set_alarm(2)
            return False
        feed = np.inf if self.motion == "G0" else self.feed / 60
        if self._laser and self.spindle != "M5":
            power = self.power if self.motion == "G1" else 0.0  # laser_mode.md: G0 disables the laser
            self.queue.add(target, feed, lambda: self._set_pulse(power))
        else:
            self.queue.add(target, feed)
        if self.state == "Idle" and self.queue.moves:
            self.state = "Run"
        return True

    def _probe(self, axes: dict[int, float], unit: float) -> None:
        """G38.3: towards the workpiece, without an alarm if nothing is touched; answered when the tip stands."""
        lowest = axes[2] * unit + self.work_offset[2]
        height = lowest if self.surface is None else max(lowest, self.surface - self.slip[2])
        self._probing = lowest
        self.queue.add(np.array([*self.queue.target[:2], height]), self.feed / 60)
        if self.queue.moves:
            self.state = "Run"

    def _end_probing(self) -> None:
        lowest, self._probing = self._probing, None
        touched = self.surface is not None and self.tip[2] <= self.surface + 1e-9 and self.queue.place[2] >= lowest
        self._answer(f"[PRB:{self._places(self.queue.place)}:{int(touched)}]")
        self._answer("ok")

    @property
    def _laser(self) -> bool:
        return bool(self.settings["32"])

    def _spin(self, turned: str, power: float, *, moving: bool) -> None:
        changed, self.spindle, self.power = turned != self.spindle, turned, power
        if turned == "M5":
            self._set_pulse(0.0)
        elif self._laser and self.motion == "G0":
            if not moving or changed:
                self._set_pulse(0.0)  # in laser mode a rapid's modal state keeps the output off
        elif not (self._laser and moving and not changed):
            self._set_pulse(power)

    def _set_pulse(self, value: float) -> None:
        if value != self.pulse:
            self.pulse = value
            self.output.append((value, self.tip.copy()))

    # System commands.

    def _system(self, text: str) -> None:
        standing = self.state.split(":")[0] in ("Idle", "Alarm")
        if text == "$$":
            if self.state.startswith(("Run", "Hold")):
                self._answer("error:8")  # "Grbl '$' command cannot be used unless Grbl is IDLE"
                return
            shown = [
                f"${name}={value:.3f}" if isinstance(value, float) else f"${name}={value:d}"
                for name, value in self.settings.items()
                if name not in self.kind.hides
            ]
            half = len(shown) // 2 if self.kind.slow else 0
            for line in shown[:half]:
                self._answer(line)
            self._late, self._lists = [*shown[half:], "ok"], self.kind.slow
            self._list_late(0.0)
        elif found := re.fullmatch(r"\$/axes/([xyz])", text.lower()):
            axis, homing = "xyz".index(found[1]), bool(self.settings["22"])
            if "FluidNC" not in self.kind.banner or axis >= self.kind.axes:
                self._answer("error:3")
                return
            self._answer(f"/axes/{found[1]}:")  # RuntimeSetting.cpp, Generator.h
            for line in (f"  max_travel_mm: {self.settings[str(130 + axis)]:.3f}", "  homing:"):
                self._answer(line)
            if homing:
                positive = "false" if int(self.settings["23"]) >> axis & 1 else "true"
                seek, feed = self.settings["25"], self.settings["24"]
                for line in (f"cycle: {2 if axis < 2 else 1}", f"positive_direction: {positive}",
                             f"mpos_mm: {self.kind.places[axis]:.3f}", f"feed_mm_per_min: {feed:.3f}",
                             f"seek_mm_per_min: {seek:.3f}"):  # fmt: skip
                    self._answer(f"    {line}")
            self._answer("ok")
        elif text == "$G":
            modes = f"{self.motion} G54 G17 G2{0 if self.inches else 1} G9{0 if self.absolute else 1}"
            rate = f"G9{4 if self.per_minute else 3} {self.spindle} M9 T{self.tool}"
            self._answer(f"[GC:{modes} {rate} F{self._unit(self.feed):.0f} S{self.power:.0f}]")
            self._answer("ok")
        elif text == "$I" and standing:
            for line in self.kind.version:
                self._answer(line)
            self._answer("ok")
        elif text == "$#" and standing:
            self._answer(f"[G54:{self._places(self.stored)}]")
            for name in ("G55", "G56", "G57", "G58", "G59", "G28", "G30"):
                self._answer(f"[{name}:{self._places(np.zeros(3))}]")
            self._answer(f"[G92:{self._places(self.shift)}]")
            self._answer("[TLO:0.000]")
            self._answer("[PRB:0.000,0.000,0.000:0]")
            self._answer("ok")
        elif text == "$X":
            if self.state.startswith("Alarm"):
                self.state = "Idle"
                self._answer("[MSG:Caution: Unlocked]")
            self._answer("ok")
        elif text == "$H" and standing:
            if not int(self.settings["22"]) & 1:
                self._answer("error:5")  # "Homing cycle is not enabled via settings"
                return
            self.state = "Home"
            travel = max(self.settings["130"], self.settings["131"]) + self.settings["132"]
            slow = 10 * self.settings["27"] / (self.settings["24"] / 60)  # two cycles, HOMING_AXIS_LOCATE_SCALAR 5
            self._homing = travel / (self.settings["25"] / 60) + slow
        elif text.startswith("$J=") and standing:
            self._jog(text[3:])
        elif match := re.fullmatch(r"\$(\d+)=(-?[\d.]+)", text):
            if not standing:
                self._answer("error:8")
                return
            self.settings[match[1]] = type(self.settings.get(match[1], 0.0))(float(match[2]))
            self._answer("ok")
        else:
            self._answer("error:3" if standing else "error:8")

    def _jog(self, text: str) -> None:
        """jogging.md: units, distance mode, axes and a feed; the parser's own state stays as it is."""
        words = dict(re.findall(r"([XYZF])(-?[\d.]+)", text))
        unit = _INCH if "G20" in text else 1.0
        if "F" not in words or not set(words) & set("XYZ"):
            self._answer("error:22")
            return
        target = self.queue.target.copy()
        for axis, letter in enumerate("XYZ"):
            if letter in words:
                value = float(words[letter]) * unit
                target[axis] = target[axis] + value if "G91" in text else value + self.work_offset[axis]
        if self.settings["20"] and not self._within_travel(target):
            self._answer("error:15")  # "Jog target exceeds machine travel. Jog command has been ignored."
            return
        self.queue.add(target, float(words["F"]) * unit / 60)
        self.state, self._jogging = "Jog", True
        self._answer("ok")

    def _end_homing(self) -> None:
        """The machine stands at its switches now: its counters say where, minus the pull-off."""
        home = np.array([self._home(axis) for axis in range(3)])
        self._past += self.queue.moved_at(self.slip)
        self.queue.moved = []
        self.queue.place = home.copy()
        self.slip = self.switches - home
        self.queue.moved.append(self.queue.place.copy())
        self.state, self.homed = "Idle", True
        self._answer("ok")

    def _within_travel(self, target: np.ndarray) -> bool:
        for axis in range(self.kind.axes):
            travel, place = self.settings[str(130 + axis)], self.kind.places[axis]
            low = place if self.kind.at_zero and int(self.settings["23"]) >> axis & 1 else place - travel
            if not low - 1e-6 <= target[axis] <= low + travel + 1e-6:
                return False
        return True

    def _home(self, axis: int) -> float:
        """Machine position of an axis after homing (limits.c); in FluidNC its mpos_mm."""
        if self.kind.at_zero:
            return self.kind.places[axis]
        low = int(self.settings["23"]) >> axis & 1
        return self.settings["27"] - self.settings[str(130 + axis)] if low else -self.settings["27"]

    def _check_limits(self) -> None:
        if self.wall is not None and self.settings["21"] and self.tip[0] >= self.wall and self.queue.moving:
            self.queue.drop()
            self._set_alarm(1)

    # Real-time commands.

    def _feed_hold(self) -> None:
        if self.state in ("Idle", "Run"):
            self.state = "Hold:1" if self.queue.moving else "Hold:0"
            self.queue.hold()
        elif self.state == "Jog":
            self.queue.drop()
            self.state, self._jogging = "Idle", False

    def _cycle_start(self) -> None:
        if self.state == "Hold:0" or (self.state.startswith("Door") and not self.door):
            self.queue.go_on()
            self.state = "Run" if self.queue.moves else "Idle"
            if self._laser and self.spindle != "M5" and self.motion == "G1":
                self._set_pulse(self.power)

    def release(self) -> None:
        """A person lets go of the hold button and presses the one for cycle start."""
        self.button = False
        self._cycle_start()

    def _soft_reset(self) -> None:
        self.mute = False
        moved = self.queue.drop()
        self._waiting.clear()
        self._rx = self._line = b""
        was = self.state
        self._parser()
        self._set_pulse(0.0)  # motion_control.c: a reset stops spindle and coolant
        self._answer("")
        if moved or was in ("Home",):
            self._set_alarm(3 if moved else 6)  # "Reset while in motion. Grbl cannot guarantee position."
        elif not was.startswith("Alarm"):
            self.state = "Idle"
        self._greet_line()
        if self.state.startswith("Alarm"):
            self._answer("[MSG:'$H'|'$X' to unlock]")

    def _set_alarm(self, number: int) -> None:
        self.alarms.append(number)
        self.state = "Alarm"
        self._syncing, self._dwell = None, 0.0
        self._waiting.clear()
        self._answer(f"ALARM:{number}")
        if number in (1, 2):
            self.mute = self.kind.mute_after_limit
            self._answer("[MSG:Reset to continue]")

    # What it says.

    def _greet(self) -> None:
        for line in self.kind.boot:
            self._answer(line)
        self._power_on()
        self._answer("")
        self._greet_line()
        if self.state == "Alarm":
            self._answer("[MSG:'$H'|'$X' to unlock]")

    def _greet_line(self) -> None:
        self._answer(self.kind.banner)

    def _answer(self, line: str) -> None:
        if not self.dead:
            self.cable.say(line.encode() + b"\r\n")

    def _chat(self, seconds: float) -> None:
        self._since_chatter += seconds
        chatter = self.kind.chatter or (("[MSG:INFO: temperature 31]", "limits ok") if self.often else ())
        if chatter and self._since_chatter > (0.05 if self.often else 0.37):
            self._since_chatter = 0.0
            self._answer(chatter[self.reports % len(chatter)])

    def _report(self) -> None:
        """interface.md: real-time status report. During homing GRBL answers none (limits.c)."""
        if self.state == "Home" and not self.kind.tells_homed:
            return
        self.reports += 1
        state = "Run" if self.state == "Idle" and self.queue.moves else self.state
        fields = [state, f"MPos:{self._places(self.queue.place)}", f"FS:{self.queue.speed * 60:.0f},{self.power:.0f}"]
        if not int(self.settings["10"]) & 1:
            fields[1] = f"WPos:{self._places(self.queue.place - self.work_offset)}"
        if self.button:
            fields.append("Pn:H")
        if self.reports % 10 == 1:
            fields.append(f"WCO:{self._places(self.work_offset)}")
        elif self.reports % 10 == 2:
            fields.append("Ov:100,100,100")
        if self.kind.tells_homed and self.reports % 10 == 3:
            fields.append(f"H:{int(self.homed)}")
        if self.kind.old:
            work = self._places(self.queue.place - self.work_offset)
            fields = [f"{state},MPos:{self._places(self.queue.place)},WPos:{work}"]
        self._answer(f"<{'|'.join(fields)}>")
        if self.kind.ok_after_report:
            self._answer("ok")

    def _unit(self, millimetres: float) -> float:
        return millimetres / _INCH if self.settings["13"] else millimetres

    def _places(self, place: np.ndarray) -> str:
        digits = 4 if self.settings["13"] else 3
        return ",".join(f"{self._unit(float(value)):.{digits}f}" for value in place[: self.kind.axes])


def router(settings: dict[str, float] | None = None) -> GrblController:
    """A small router that homes to the far upper right; its work zero is at the front left corner of the table.

    settings: its rates; `QUICK` unless others are given
    """
    travel = {"22": 1, "25": 6000.0, "130": 300.0, "131": 180.0, "132": 45.0}
    machine = GrblController(GRBL, {**(QUICK if settings is None else settings), **travel})
    machine.switches[:] = 288, 168, 39
    machine.stored[:] = -289, -169, -40
    return machine
