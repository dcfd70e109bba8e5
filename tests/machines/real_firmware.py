"""Real firmware as a simulated controller: a program that was built from the firmware's own sources, in virtual time.

docs/lab/real-firmware.md says how such a program is built. None is part of this project. The program stands still
except while it is told that time passes, so the drivers' simulated time is its time too.
"""

import re
import struct
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from frida_painter.hardware.gcode import Gcode, Servo
from frida_painter_drivers.gcode import GcodeRobot
from machines.bench import SerialBench
from machines.simulated_time import Cable, SimulatedTime

_ASK = struct.Struct("<d3iiBBI")
_TELL = struct.Struct("<3iBBBBIId")
_FAR = 1 << 30
_BOOT = 1.6  # seconds until an Arduino's bootloader hands over


class RealFirmware:
    """Controller that runs a firmware's own program. Implements simulated_time.Controller.

    program: its path; settings: lines that a person types once ("$110=8000")
    steps: per mm of each axis, to know where the tip really is
    keeps_settings: False for a firmware without memory: its builder chose these settings
    urgent: bytes that the firmware picks out of the line as they come
    switches: mm of the tip at which the limit switches close, None without
    contact: mm of the tip's height at which a probe's contact closes, None without
    """

    def __init__(
        self,
        program: str,
        settings: tuple[str, ...] = (),
        *,
        steps: tuple[float, float, float] = (250.0, 250.0, 250.0),
        urgent: bytes = b"?!~\x18",
        keeps_settings: bool = True,
        switches: tuple[float, float, float] | None = None,
        resets_when_opened: bool = True,
    ) -> None:
        self.program, self.steps, self.urgent = program, np.array(steps), urgent
        self.resets_when_opened = resets_when_opened
        self._builder = "" if keeps_settings else "".join(f"{line}\n" for line in settings)
        self.switches, self.contact = switches, None
        self.cable: Cable
        self._folder = tempfile.TemporaryDirectory()
        self._place = np.zeros(3, np.int64)
        self._way: list[np.ndarray] = []
        self._output: list[tuple[float, float]] = []
        self.received: list[str] = []
        self.pressed = self.forced = 0
        self.duty: int | None = None
        self.motors_on = True
        self.now = 0.0
        self._heard = self._line = b""
        self._booting = self._chatters = 0.0
        self.lose_lines = 0
        self._quiet = True
        self._start()
        self.pass_time(6)  # its first start fills its memory
        for line in settings:
            self.type(line)
        self.restart()
        self._booting = 0.0
        self.pass_time(0.2)
        self._quiet = False

    def _start(self) -> None:
        store = str(Path(self._folder.name) / "eeprom")
        self._process = subprocess.Popen(
            [self.program, store, *(str(int(step)) for step in self._place)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )

    @property
    def tip(self) -> np.ndarray:
        """Place of the tip, [3] mm: steps that the motors made, whatever the firmware believes."""
        return self._place / self.steps

    @property
    def moved(self) -> np.ndarray:
        return np.concatenate([np.zeros((0, 3)), *self._way]) / self.steps

    def forget_way(self) -> None:
        self._way.clear()

    @property
    def output(self) -> list[tuple[float, float]]:
        """Every change of the PWM's duty (0 to 255, 0: no pulse), with its second."""
        return self._output

    def restart(self) -> None:
        """Takes the power away and gives it back; the tip stays where it is."""
        self._kill()
        self._heard, self._line = self._builder.encode(), b""
        self._booting = _BOOT
        self._start()

    def power_cut(self, seconds: float = 0.0) -> None:
        self.restart()

    def type(self, line: str, seconds: float = 0.5) -> None:
        """A person types at the machine's own controls."""
        self._heard += line.encode() + b"\n"
        self.pass_time(seconds)

    def end(self) -> None:
        """Ends the program and forgets its settings."""
        self._kill()
        self._folder.cleanup()

    def _kill(self) -> None:
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()

    def hear(self, content: bytes) -> None:
        if self._booting > 0:
            return
        for byte in content:
            char = bytes([byte])
            if char in self.urgent:
                if char != b"?":
                    self.received.append({b"\x18": "reset"}.get(char, char.decode()))
                self._heard += char
            elif char == b"\n":
                text = self._line.decode("ascii", "replace").strip()
                plain = re.sub(r"^N\d+\s*|\*\d+$", "", text)
                self.received.append(plain)
                if self.lose_lines and re.search("[XYZ]", plain) and not plain.startswith(("$", "G10", "G92")):
                    self.lose_lines -= 1
                else:
                    self._heard += self._line + b"\n"
                self._line = b""
            else:
                self._line += char

    def pass_time(self, seconds: float) -> None:
        if self._booting > 0:
            self._booting -= seconds
            return
        heard, self._heard = self._heard, b""
        mm = self.switches
        stops = [_FAR] * 3 if mm is None else np.round(np.array(mm) * self.steps).astype(int)
        contact = -_FAR if self.contact is None else round(self.contact * self.steps[2])
        assert self._process.stdin and self._process.stdout
        self._process.stdin.write(_ASK.pack(seconds, *stops, contact, self.forced, self.pressed, len(heard)) + heard)
        self._process.stdin.flush()
        *place, on, duty, motors_off, _, said, way, now = _TELL.unpack(self._process.stdout.read(_TELL.size))
        words = self._process.stdout.read(said)
        if way:
            self._way.append(np.frombuffer(self._process.stdout.read(4 * way), np.int32).reshape(-1, 3))
        self._place = np.array(place, np.int64)
        self.motors_on, self.now = not motors_off, now
        duty = duty if on else 0
        if duty != self.duty:
            self.duty = duty
            self._output.append((now, duty))
        if not self._quiet:
            self.cable.say(words) if words else None
            if self._chatters:
                self._chatter(seconds)

    def chat_often(self) -> None:
        self._chatters = 0.05

    def _chatter(self, seconds: float) -> None:
        self._chatters -= seconds
        if self._chatters <= 0:
            self._chatters = 0.05
            self.cable.say(b"[MSG:INFO: temperature 31]\r\n" if self.urgent else b" T:20.1 /0.0\n")


class RealBench(SerialBench):
    """Bench of a real firmware of the GRBL family. Implements Bench."""

    controller: RealFirmware

    def height_of_servo(self) -> float:
        servo, duty = self.servo, self.controller.duty or 0
        assert servo is not None
        (low, at_low), (high, at_high) = servo.low, servo.high
        value = 0.0 if duty == 0 else (duty - 1) / 254 * 1000  # spindle_control.c: 255 levels over $31 to $30
        return low + (value - at_low) / (at_high - at_low) * (high - low)

    @property
    def exact_height(self) -> float:
        return self.exact if self.servo is None else 1.01 * self._level

    @property
    def _level(self) -> float:
        assert self.servo is not None
        (low, at_low), (high, at_high) = self.servo.low, self.servo.high
        return abs((high - low) / (at_high - at_low)) * 1000 / 254

    def fault(self, name: str) -> None:
        if name == "alarm":
            self._fault = name
            self.controller.forced = 1
        elif name == "press the button":
            self._fault = name
            self.controller.pressed = 1
        else:
            super().fault(name)

    def mend(self) -> None:
        machine = self.controller
        if self._fault == "alarm":
            machine.forced = 0
            machine.type("\x18", 1.0)
            machine.type("$X")
        elif self._fault == "press the button":
            machine.pressed = 0
            machine.pass_time(0.01)
            machine.pressed = 2
            machine.pass_time(0.01)
            machine.pressed = 0
        else:
            super().mend()
        self._fault = ""


def real_grbl(
    clock: SimulatedTime, program: str, settings: tuple[str, ...] = (), servo: Servo | None = None, **parts: Any
) -> RealBench:
    """Returns the bench of a GRBL that was built from its own sources."""
    controller = RealFirmware(program, settings, **parts)
    cable = clock.attach(controller)
    language = Gcode("grbl", 0.1, servo)
    return RealBench(
        clock, controller, cable, lambda port: GcodeRobot(port, (0.0, 0.0, 0.05), gcode=language), servo=servo
    )


class RealMarlinBench(SerialBench):
    """Bench of a real Marlin. Implements Bench."""

    controller: RealFirmware

    def height_of_servo(self) -> float:
        servo, degrees = self.servo, self.controller.duty
        assert servo is not None
        if not degrees:
            return servo.high[0]
        (low, at_low), (high, at_high) = servo.low, servo.high
        return low + (degrees - at_low) / (at_high - at_low) * (high - low)

    def fault(self, name: str) -> None:
        if name == "alarm":
            self._fault = name
            self.controller.type("M112", 0.01)  # the red button
        else:
            super().fault(name)

    def mend(self) -> None:
        if self._fault == "alarm":
            self._fault = "reset"
        super().mend()


def real_marlin(
    clock: SimulatedTime, program: str, settings: tuple[str, ...] = (), servo: Servo | None = None
) -> RealMarlinBench:
    """Returns the bench of a Marlin that was built from its own sources."""
    controller = RealFirmware(program, settings, steps=(80.0, 80.0, 400.0), urgent=b"", keeps_settings=False)
    cable = clock.attach(controller)
    language = Gcode("marlin", 0.1, servo)
    return RealMarlinBench(
        clock,
        controller,
        cable,
        lambda port: GcodeRobot(port, (0.0, 0.0, 0.05), gcode=language),
        servo=servo,
        exact=1.5e-5,
        lacks={"pause button": "it has none"},
    )
