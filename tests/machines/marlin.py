"""Simulated controllers with Marlin 2, in several builds.

Written from marlinfw.org (the pages of each code, "Host interface", "EMERGENCY_PARSER", "ADVANCED_OK",
"HOST_KEEPALIVE_FEATURE"), Configuration_adv.h, and issues 2890, 6288, 19221 and 19774 of Marlin.
"""

import re
from collections import deque
from dataclasses import dataclass

import numpy as np

from machines.motion_queue import MotionQueue
from machines.simulated_time import Cable

_BOOT = 1.5
_LINE = 96  # MAX_CMD_SIZE
_BUSY = 2.0  # DEFAULT_KEEPALIVE_INTERVAL
_INACTIVE = 120.0  # DEFAULT_STEPPER_DEACTIVE_TIME
_STEPS = np.array([80.0, 80.0, 400.0])


@dataclass
class Build:
    """A build of the firmware: which options are compiled in.

    lowest, highest: the software endstops, mm
    """

    name: str = "Marlin 2.1.2.1 (Nov 1 2023 12:00:00)"
    advanced_ok: bool = False
    emergency_parser: bool = True
    keepalive: bool = True
    endstops: bool = True
    servos: int = 0
    extruders: int = 1
    lowest: tuple[float, float, float] = (-200.0, -200.0, -60.0)
    highest: tuple[float, float, float] = (300.0, 300.0, 200.0)
    rates: tuple[float, float, float] = (200.0, 200.0, 20.0)
    gains: tuple[float, float, float] = (800.0, 800.0, 100.0)
    travel: float = 600.0
    jerk: tuple[float, float, float] | None = None
    deviation: float = 0.08
    chatter: tuple[str, ...] = ()


PLAIN = Build()
ADVANCED = Build(name="Marlin bugfix-2.1.x (Dec 2 2023 10:00:00)", advanced_ok=True, chatter=(" T:21.3 /0.0 B:20.9",))
OLD = Build(name="Marlin 1.1.9 (Github)", emergency_parser=False, keepalive=False, jerk=(8.0, 8.0, 0.4))
SERVO = Build(servos=1)
BARE = Build(extruders=0)  # HAS_EXTRUDERS: motion.cpp reports no E


class MarlinController:
    """Controller with Marlin. `build`: its options.

    tip: where the brush really is, mm in the frame of a person who measures
    angle: of servo 0 in degrees, None before it was told one
    motors_on: False after they were switched off: the brush may sink
    """

    resets_when_opened = True

    def __init__(self, build: Build = PLAIN) -> None:
        self.build = build
        self.cable: Cable
        self.queue = MotionQueue(
            np.array(build.rates),
            np.array(build.gains),
            along=build.travel,
            deviation=build.deviation,
            jerk=None if build.jerk is None else np.array(build.jerk),
        )
        self.slip = np.zeros(3)
        self._past: list[np.ndarray] = []
        self.switches = np.zeros(3)  # where the tip stands after homing
        self.received: list[str] = []
        self.angle: float | None = None
        self.dead = self.killed = False
        self.damage_lines = self.lose_lines = 0
        self.starts = 0
        self.button = False
        self._booting = 0.0
        self._since_chatter = 0.0
        self.often = False
        self._rx = b""
        self._waiting: deque[str] = deque()
        self._boot_values()

    def _boot_values(self) -> None:
        self.shift = np.zeros(3)  # of G92
        self.extruder, self.retracting = 0.0, 1000.0
        self.absolute, self.feed = True, 1500.0
        self.motors_on = True
        self._idle_for, self._timeout = 0.0, _INACTIVE
        self._last = 0
        self._busy_with = ""
        self._left = 0.0
        self._since_busy = 0.0
        self.killed = False

    @property
    def tip(self) -> np.ndarray:
        return self.queue.place + self.slip

    @property
    def moved(self) -> list[np.ndarray]:
        return self._past + self.queue.moved_at(self.slip)

    def forget_way(self) -> None:
        """Forgets the places until now."""
        self.queue.moved.clear()

    def chat_often(self) -> None:
        """Says lines of its own all the time, as clones and printers do."""
        self.often = True

    def power_cut(self) -> None:
        """Takes the power away and gives it back."""
        self.restart()

    def restart(self) -> None:
        self._past += self.queue.moved_at(self.slip)
        self.queue.moved = []
        self.slip = self.tip.copy()
        self.queue.drop()
        self.queue.place = np.zeros(3)
        self.starts += 1
        self._booting = _BOOT
        self._rx = b""
        self._waiting.clear()
        self._boot_values()

    def release(self) -> None:
        """A person presses "resume" at the display."""
        self.button = False
        self.queue.go_on()

    def hear(self, content: bytes) -> None:
        if self._booting > 0 or self.dead or self.killed:
            return
        if self.build.emergency_parser:  # it looks at every byte as it comes
            text = (self._rx + content).decode("ascii", "replace")
            for code in ("M112", "M410"):
                if re.search(rf"(^|\n){code}\b", text[max(0, len(self._rx) - 5) :]):
                    self._emergency(code)
        self._rx += content
        *lines, self._rx = self._rx.split(b"\n")
        for line in lines:
            text = line.decode("ascii", "replace").split(";")[0].strip()[: _LINE - 1]
            if text:
                self._arrive(text)

    def _emergency(self, code: str) -> None:
        self.received.append(code)
        if code == "M112":
            self.queue.drop()
            self._answer("Error:Printer halted. kill() called!")
            self.killed = True
        elif self._busy_with != "G28":  # 19774: homing goes on
            self.queue.drop()
            self._waiting.clear()

    def _arrive(self, text: str) -> None:
        """A whole line came: its number and checksum are looked at before it waits for its turn."""
        if text in ("M410", "M112"):
            if not self.build.emergency_parser:
                self._emergency(text)
            if text == "M410":
                self._waiting.append(text)
            return
        match = re.fullmatch(r"N(-?\d+)\s*(.*?)\s*\*(\d+)", text)
        if text.startswith("N") or match:
            if match is None:
                self._refuse("No Checksum with line number")
                return
            wanted = 0
            for byte in text.rpartition("*")[0].encode():
                wanted ^= byte
            number, line = int(match[1]), match[2]
            moves = line.startswith(("G0", "G1"))
            if moves and self.lose_lines:
                self.lose_lines -= 1
                return
            damaged = moves and self.damage_lines > 0
            self.damage_lines -= damaged
            if int(match[3]) != wanted or damaged:
                self._refuse("checksum mismatch")
                return
            if not line.startswith("M110") and number != self._last + 1:
                self._refuse("Line Number is not Last Line Number+1")
                return
            self._last = number
            self._waiting.append(line)
        else:
            if line_number := re.fullmatch(r"M110 N(-?\d+)", text):
                self._last = int(line_number[1])
            self._waiting.append(text)

    def _refuse(self, why: str) -> None:
        self._answer(f"Error:{why}, Last Line: {self._last}")
        self._answer(f"Resend: {self._last + 1}")
        self._answer("ok")

    def pass_time(self, seconds: float) -> None:
        if self._booting > 0:
            self._booting -= seconds
            if self._booting <= 0:
                for line in ("start", f"echo:{self.build.name}", "echo: Last Updated: 2023-11-01 | Author: (none)",
                             "echo:Hardcoded Default Settings Loaded"):  # fmt: skip
                    self._answer(line)
            return
        if self.dead or self.killed:
            return
        self._chat(seconds)
        self.queue.holding = self.button
        self.queue.advance(seconds)
        if self.queue.moves:
            self._idle_for = 0.0
        else:
            self._idle_for += seconds
            if self._timeout and self._idle_for > self._timeout:
                self.motors_on = False
        self._keep_alive(seconds)
        self._left -= seconds
        for _ in range(64):
            if self._busy_with and not self._finish():
                return
            if not self._waiting or (self.queue.full and self._waiting[0].startswith(("G0", "G1"))):
                return
            self._begin(self._waiting.popleft())

    def _keep_alive(self, seconds: float) -> None:
        blocked = bool(self._busy_with) or (bool(self._waiting) and self.queue.full)
        self._since_busy = self._since_busy + seconds if blocked else 0.0
        if self.build.keepalive and self._since_busy > _BUSY:
            self._since_busy = 0.0
            self._answer("echo:busy: paused for user" if self.button else "echo:busy: processing")

    def _finish(self) -> bool:
        """Returns True if what it is busy with is done."""
        name = self._busy_with
        if self.queue.moves and name in ("M400", "G4", "G28", "M280"):
            return False
        if name in ("G4", "G28", "M280") and self._left > 0:
            return False
        if name == "G28":
            self._past += self.queue.moved_at(self.slip)
            self.queue.moved = []
            self.queue.place, self.slip = np.zeros(3), self.switches.copy()
            self.shift = np.zeros(3)
        self._busy_with = ""
        self._ok()
        return True

    def _begin(self, line: str) -> None:
        if line != "M410":
            self.received.append(line)
        code, *rest = line.split()
        words = {word[0]: word[1:] for word in rest}
        match code:
            case "G0" | "G1":
                self._move({key: float(value) for key, value in words.items()})
            case "G4":
                milliseconds = float(words.get("P", 0)) + 1000 * float(words.get("S", 0))
                self._busy_with, self._left = "G4", milliseconds / 1000
                return
            case "G28":
                self._busy_with, self._left = "G28", 25.0
                return
            case "M400":
                self._busy_with = "M400"
                return
            case "M280" if self.build.servos:
                if "S" in words:
                    self.angle = float(words["S"])
                    self._busy_with, self._left = "M280", 0.3  # SERVO_DELAY of Configuration.h
                    return
                self._answer(f"echo: Servo 0: {self.angle or 0:.0f}")
            case "G90" | "G91":
                self.absolute = code == "G90"
            case "G92":
                for axis, letter in enumerate("XYZ"):
                    if letter in words:
                        self.shift[axis] = float(words[letter]) - self.queue.target[axis]
                if "E" in words and self.build.extruders:
                    self.extruder = float(words["E"])
            case "M114":
                x, y, z = self.queue.target + self.shift
                count = np.round(self.queue.place * _STEPS).astype(int)
                extruder = f" E:{self.extruder:.2f}" if self.build.extruders else ""
                self._answer(f"X:{x:.2f} Y:{y:.2f} Z:{z:.2f}{extruder} Count X:{count[0]} Y:{count[1]} Z:{count[2]}")
            case "M115":
                self._tell_capabilities()
            case "M204":  # M200-M205.cpp: "Retract only (no X, Y, Z) moves"
                self.retracting = float(words.get("R", self.retracting))
            case "M503":
                self._tell_settings()
            case "M211":
                self._tell_endstops()
            case "M84" | "M18":
                if "S" in words:
                    self._timeout = float(words["S"])
                else:
                    self.motors_on = False
            case "G21" | "M110" | "M410" | "M105" | "M220" | "M75":
                pass
            case _:
                self._answer(f'echo:Unknown command: "{line}"')  # 2890: and then ok, all the same
        self._ok()

    def _move(self, words: dict[str, float]) -> None:
        target = self.queue.target.copy()
        for axis, letter in enumerate("XYZ"):
            if letter in words:
                target[axis] = words[letter] - self.shift[axis] if self.absolute else target[axis] + words[letter]
        if self.build.endstops:  # 6288: cut off without a word
            target = np.clip(target, self.build.lowest, self.build.highest)
        self.feed = words.get("F", self.feed)
        self.motors_on = True
        self.queue.add(target, self.feed / 60)

    def _tell_capabilities(self) -> None:
        self._answer(
            f"FIRMWARE_NAME:{self.build.name} SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin PROTOCOL_VERSION:1.0 "
            f"MACHINE_TYPE:Ender-3 EXTRUDER_COUNT:{self.build.extruders} UUID:cede2a2f-41a2-4748-9b12-c55c62f367ff"
        )
        self._answer("Cap:SERIAL_XON_XOFF:0")
        self._answer("Cap:EEPROM:1")
        self._answer(f"Cap:EMERGENCY_PARSER:{int(self.build.emergency_parser)}")

    def _tell_settings(self) -> None:
        build = self.build
        rates, gains = (" ".join(f"{axis}{value:.2f}" for axis, value in zip("XYZ", each, strict=True))
                        for each in (build.rates, build.gains))  # fmt: skip
        lines = ["G21    ; Units in mm (mm)", "", "; Steps per unit:", " M92 X80.00 Y80.00 Z400.00 E93.00",
                 "; Max feedrates (units/s):", f" M203 {rates} E25.00",
                 "; Max Acceleration (units/s2):",
                 f" M201 {gains} E5000.00",
                 "; Acceleration (units/s2) (P<print-accel> R<retract-accel> T<travel-accel>):",
                 f" M204 P500.00 R{self.retracting:.2f} T{build.travel:.2f}"]  # fmt: skip
        if build.jerk is None:
            lines.append(f" M205 B20000.00 S0.00 T0.00 J{build.deviation:.2f}")
        else:
            lines.append(
                f" M205 B20000.00 S0.00 T0.00 X{build.jerk[0]:.2f} Y{build.jerk[1]:.2f} Z{build.jerk[2]:.2f} E5.00"
            )
        for line in lines:
            self._answer(f"echo:{line}")

    def _ok(self) -> None:
        free = self.queue.room - len(self.queue.moves)
        self._answer(f"ok N{self._last} P{free} B3" if self.build.advanced_ok else "ok")

    def _answer(self, line: str) -> None:
        if not self.dead:
            self.cable.say(line.encode() + b"\n")

    def _tell_endstops(self) -> None:
        """In work coordinates, also after G92 (asLogical in M211.cpp); from 2.1 on in two lines."""
        low, high = np.array(self.build.lowest) + self.shift, np.array(self.build.highest) + self.shift
        box = f"  Min:  X{low[0]:.2f} Y{low[1]:.2f} Z{low[2]:.2f}   Max:  X{high[0]:.2f} Y{high[1]:.2f} Z{high[2]:.2f}"
        if "2.1" in self.build.name:
            self._answer(f"  M211 S{int(self.build.endstops)} ; {'ON' if self.build.endstops else 'OFF'}")
            self._answer(box)
        else:
            self._answer(f"echo:Soft endstops: {'On' if self.build.endstops else 'Off'}{box}")

    def _chat(self, seconds: float) -> None:
        self._since_chatter += seconds
        chatter = self.build.chatter or (("echo:SD init fail", " T:20.1 /0.0") if self.often else ())
        if chatter and self._since_chatter > (0.05 if self.often else 0.7):
            self._since_chatter = 0.0
            self._answer(chatter[0])
