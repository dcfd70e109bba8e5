"""A simulated EiBotBoard with its plotter, written from the command reference and the firmware's source.

Sources: evil-mad.github.io/EggBot/ebb.html (firmware 3), ebb2.html (2.x), EBBReleaseNotes.html, and the firmware at
github.com/evil-mad/EggBot (2.5.3, 2.8.1, 3.0.3). Nothing here is taken from our driver.
"""

import math
import threading
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from machines.simulated_time import Cable, SimulatedTime

TICK = 0.024
"""Seconds between two pulses of a servo: 8 channels of 3 ms."""
STANDARD, BRUSHLESS = 4, 5
"""Pins RP4 (header B1, its power is switched) and RP5 (header B2, always powered)."""


@dataclass
class Command:
    """A command of the motion queue. kind: "move", "delay", "servo" or "enable"."""

    kind: str
    seconds: float = 0.0
    steps: tuple[int, int] = (0, 0)
    servo: tuple[int, int, int] = (0, 0, 0)  # pin, pulse, rate
    enable: tuple[int, int] = (0, 0)


@dataclass
class Servo:
    value: int
    target: int
    rate: int


class EbbController:
    """A plotter with an EBB at a cable. Implements simulated_time.Controller.

    version: of the firmware
    future: the board was left in future syntax, as NextDraw's software does; "only" for a board that knows no other
    lift: pin to which the lift's servo is connected
    faults: what it does instead of obeying the n-th XM command (from 0): "error", "garbage", "half", "mute", "lost",
        "unplug", "reset" or "late" (says nothing for `silence` of its seconds, and then goes on)

    carriage: where the two motors really are, in steps; count: what the board believes
    pen: the lift's real pulse; None while its servo has no power, in which case a weighted pen is down
    trace: (seconds, carriage, pen) after each command of the queue and each pulse of a moving servo
    moved: places of the carriage (x, y in mm, y away from you; z 0) since the start
    """

    resets_when_opened = False
    cable: Cable

    def __init__(
        self, version: str = "2.8.1", *, future: bool | str = False, lift: int = STANDARD,
        faults: dict[int, str] | None = None,
    ) -> None:  # fmt: skip
        self.version = tuple(int(part) for part in version.split("."))
        self.written = version
        self.lift, self.faults = lift, faults or {}
        self.voltage, self.silence = 300, 60.0
        self.carriage = [0, 0]
        self.trace: list[tuple[float, tuple[int, int], int | None]] = []
        self.moved: list[tuple[float, float, float]] = []
        self.received: list[str] = []
        self.stops = 0
        self.chatters = False
        self._future_only = future == "only"
        self.made = 0
        self._now = self._t = self._said_at = 0.0
        self.restart()
        self.future = bool(future)

    # What happens to it.

    def power_cut(self) -> None:
        """The board loses its power, which comes through the cable; it drops off the bus and boots."""
        self.cable.unplug()
        self.restart()
        self.cable.plug()

    def cut_motor_power(self, seconds: float = 0.0) -> None:
        """Switches the motors' power supply off; after `seconds` it is back (0: it stays off). The logic has USB."""
        self.voltage, self._dropped = 0, True
        self._power_back = self._t + seconds if seconds else math.inf

    def push(self, first: int, second: int) -> None:
        """Somebody pushes the carriage; motors that are on and powered hold it."""
        if not all(self._on) or self.voltage < 100:
            self.carriage = [self.carriage[0] + first, self.carriage[1] + second]

    def press(self) -> None:
        """Somebody presses the PRG button."""
        self._pressed = True

    @property
    def pen(self) -> int | None:
        servo = self._servos.get(self.lift)
        if servo is None or (self.lift == STANDARD and not self._servo_power):
            return None
        return servo.value

    @property
    def seconds(self) -> float:
        """The board's time."""
        return self._now

    @property
    def tip(self) -> np.ndarray:
        """Where the carriage is, [3] mm: x to the right, y away from you; the height is that of the servo."""
        first, second = self.carriage
        return np.array([(first + second) / 160, (second - first) / 160, 0.0])

    def _place(self) -> tuple[float, float, float]:
        x, y, z = self.tip.tolist()
        return x, y, z

    # The board.

    def restart(self) -> None:
        """The board boots."""
        self.future = self._future_only
        self.count = [0, 0]
        self._on = [False, False]
        self._resolution = 16
        self._variables, self._nodes = [0] * 32, 0
        self._pressed = False
        self._threshold, self._dropped = 0, False
        self._power_back = math.inf
        self._servo_power = self.version < (2, 5, 6)  # switched off at reset since 2.5.6
        self._reload = 60.0 if self.version >= (2, 6, 3) else 900.0
        self._power_off_at = math.inf
        self._servos = {STANDARD: Servo(12_000, 12_000, 0)}
        self._queue: deque[Command] = deque()
        self._current: tuple[Command, float, float, list[int]] | None = None
        self._typed: deque[str] = deque()
        self._rest = b""
        self._silent_until = 0.0

    def hear(self, content: bytes) -> None:
        """Bytes that arrived."""
        *lines, self._rest = (self._rest + content).replace(b"\n", b"\r").split(b"\r")
        self._typed.extend(line.decode("ascii", "replace") for line in lines if line)

    def pass_time(self, seconds: float) -> None:
        """So much of its time passes."""
        self._now += seconds
        now = self._now
        if now < self._silent_until:
            return
        if self.chatters and now > self._said_at + 0.05:  # another program has left T,50,0 on
            self._said_at = now
            self._line("I,128,255,130,000,007", "\r\n")
        while True:
            self._read_commands()
            if self._current is None:
                break
            command, _, end, _ = self._current
            if end > now:
                break
            self._pass_until(end)
            self._finish(command)
        self._pass_until(now)

    def _pass_until(self, moment: float) -> None:
        """The servos' pulses and their power, and the motors of the current move, up to a moment."""
        ticks = int(moment / TICK) - int(self._t / TICK)
        if self._t < self._power_off_at <= moment:
            self._servo_power = False
        if self._t < self._power_back <= moment:
            self.voltage = 300
        moving = [servo for servo in self._servos.values() if servo.value != servo.target]
        for number in range(ticks if moving else 0):
            at = (int(self._t / TICK) + 1 + number) * TICK
            for servo in moving:
                change = servo.target - servo.value
                most = abs(change) if servo.rate == 0 else min(abs(change), servo.rate)
                servo.value += int(math.copysign(most, change))
            self._move_to(at)
            self._note(at)
        self._t = max(self._t, moment)
        self._move_to(self._t)

    def _move_to(self, moment: float) -> None:
        if self._current is not None and self._current[0].kind == "move":
            command, start, end, done = self._current
            if not self.moved:
                self.moved.append(self._place())
            share = 1.0 if moment >= end else (moment - start) / (end - start)
            for axis in (0, 1):
                wanted = int(command.steps[axis] * share)
                self.count[axis] += wanted - done[axis]
                if self.voltage >= 100:
                    self.carriage[axis] += wanted - done[axis]
                done[axis] = wanted
            if self.moved[-1] != (place := self._place()):
                self.moved.append(place)

    def _finish(self, command: Command) -> None:
        self._current = None
        self._note(self._t)
        if self._queue:
            self._start(self._queue.popleft())

    def _start(self, command: Command) -> None:
        if command.kind == "servo":
            pin, pulse, rate = command.servo
            if pin not in self._servos:
                self._servos[pin] = Servo(pulse, pulse, rate)  # the first pulse of a channel: it jumps
            self._servos[pin].target, self._servos[pin].rate = pulse, rate
        elif command.kind == "enable":
            self._enable(*command.enable)
        elif command.kind == "move":
            self._on = [True, True]
        self._current = (command, self._t, self._t + command.seconds, [0, 0])

    def _enable(self, first: int, second: int) -> None:
        self._on = [first > 0, second > 0]
        if first:
            self._resolution = {1: 16, 2: 8, 3: 4, 4: 2, 5: 1}[first]
        if self.version >= (2, 6, 2):
            self.count = [0, 0]

    def _note(self, moment: float) -> None:
        self.trace.append((moment, (self.carriage[0], self.carriage[1]), self.pen))

    # Commands.

    _QUEUED = ("XM", "SM", "S2", "SP", "HM", "LM")

    def _read_commands(self) -> None:
        """The parser stands still while the queue is full and the next command is one for the queue."""
        while self._typed:
            name = self._typed[0].split(",")[0].upper()
            queued = name in self._QUEUED or (name == "EM" and self.version >= (2, 8, 0))
            if queued and self._queue:
                return
            if self._silent_until > self.seconds:
                return
            line = self._typed.popleft()
            self.received.append(line)
            self._obey(name, line.split(",")[1:])

    def _push(self, command: Command) -> None:
        if self._current is None:
            self._start(command)
        else:
            self._queue.append(command)

    def _obey(self, name: str, values: list[str]) -> None:
        try:
            numbers = [] if name == "PI" else [int(value) for value in values]
        except ValueError:
            self._error(name, "!5 Err: Need comma next, found: 'x'")
            return
        known = {
            "V": self._tell_version, "QC": self._tell_voltage, "QS": self._tell_steps, "QM": self._tell_motion,
            "QB": self._tell_button, "QE": self._tell_enabled, "QG": self._tell_general, "QR": self._tell_power,
            "QL": self._tell_variable, "PI": self._tell_pin, "QT": self._tell_tag, "ES": self._stop,
            "CU": self._configure, "EM": self._switch, "CS": self._clear, "SL": self._set_variable,
            "SR": self._set_power, "S2": self._servo, "SP": self._pen, "SC": self._set_servo, "XM": self._mixed,
            "SM": self._straight, "SN": self._set_nodes, "QN": self._tell_nodes,
        }  # fmt: skip
        since = {"QE": (2, 8, 0), "QG": (2, 6, 1), "QR": (2, 5, 6), "SR": (2, 5, 6), "QT": (2, 5, 4)}
        if name not in known or self.version < since.get(name, (0,)):
            codes = "".join(f"{ord(letter):2X}" for letter in name)
            self._error(name, f"!8 Err: Unknown command '{name}:{codes}'")
            return
        known[name](numbers)

    def _line(self, text: str, end: str) -> None:
        self.cable.say((text + end).encode())

    def _ok(self, name: str) -> None:
        self._line(name, "\n") if self.future else self._line("OK", "\r\n")

    def _answer(self, name: str, text: str, *, ends: bool = True, reverse: bool = False) -> None:
        """An answer to a query; reverse: this one ends with NL CR in legacy syntax."""
        if self.future:
            self._line(f"{name},{text}", "\n")
            return
        self._line(text, "\n\r" if reverse else "\r\n")
        if ends:
            self._line("OK", "\r\n")

    def _error(self, name: str, text: str) -> None:
        self._line(f"{name},{text}" if self.future else text, "\n" if self.future else "\r\n")

    def _tell_version(self, _: list[int]) -> None:
        text = f"EBBv13_and_above EB Firmware Version {self.written}"
        self._answer("V", text, ends=False)

    def _tell_voltage(self, _: list[int]) -> None:
        self._answer("QC", f"0394,{self.voltage:04d}")

    def _tell_steps(self, _: list[int]) -> None:
        self._move_to(self._t)
        self._answer("QS", f"{self.count[0]},{self.count[1]}", reverse=True)

    def _motion(self) -> tuple[int, int, int, int]:
        command = None if self._current is None else self._current[0]
        moving = command is not None and command.kind == "move"
        first, second = (int(moving and command is not None and command.steps[axis] != 0) for axis in (0, 1))
        return int(command is not None), first, second, int(bool(self._queue))

    def _tell_motion(self, _: list[int]) -> None:
        text = ",".join(map(str, self._motion()))
        self._answer("QM", text if self.future else f"QM,{text}", ends=False, reverse=True)

    def _tell_general(self, _: list[int]) -> None:
        command, first, second, waiting = self._motion()
        bits = waiting | second << 1 | first << 2 | command << 3 | 1 << 4 | int(self._pressed) << 5
        if self.version >= (3, 0, 0):
            bits |= int(self._dropped and self._threshold > 0) << 6
            self._dropped = self.voltage < self._threshold
        else:
            bits |= 0b11 << 6  # pins RB2 and RB5 are pulled up
        self._pressed = False
        self._answer("QG", f"{bits:02X}", ends=False)

    def _tell_button(self, _: list[int]) -> None:
        pressed, self._pressed = self._pressed, False
        self._answer("QB", str(int(pressed)))

    def _tell_enabled(self, _: list[int]) -> None:
        self._answer("QE", ",".join(str(self._resolution if on else 0) for on in self._on), reverse=True)

    def _tell_pin(self, _: list[int]) -> None:
        asked = self.received[-1].upper()
        low = {"PI,E,0": self._on[0], "PI,C,1": self._on[1]}.get(asked)
        high = {"PI,E,2": (16, 8, 2), "PI,E,1": (16, 8, 4), "PI,A,6": (16,)}.get(asked, ())
        value = int(self._resolution in high) if low is None else int(not low)
        self._answer("PI", str(value) if self.future else f"PI,{value}", ends=False)

    def _tell_power(self, _: list[int]) -> None:
        self._answer("QR", str(int(self._servo_power)), reverse=True)

    def _tell_variable(self, values: list[int]) -> None:
        self._answer("QL", str(self._variables[values[0] if values and self.version >= (3, 0, 0) else 0]))

    def _set_nodes(self, values: list[int]) -> None:
        self._nodes = values[0]
        self._ok("SN")

    def _tell_nodes(self, _: list[int]) -> None:
        self._answer("QN", f"{self._nodes:010d}")

    def _tell_tag(self, _: list[int]) -> None:
        self._answer("QT", "East EBB")

    def _stop(self, values: list[int]) -> None:
        self.stops += 1
        queued, current = any(command.kind == "move" for command in self._queue), self._current
        self._move_to(self._t)
        moving = current is not None and current[0].kind == "move"
        if self.version >= (3, 0, 0):
            self._queue.clear()
            self._current = None
        else:  # only moves are dropped: a delay or a servo's command goes on
            self._queue = deque(command for command in self._queue if command.kind != "move")
            if moving:
                self._current = None
                if self._queue:
                    self._start(self._queue.popleft())
        if values == [1]:
            self._on = [False, False]
        self._note(self._t)
        told = str(int(queued or moving))
        self._answer("ES", told if self.version >= (3, 0, 0) else f"{told},0,0,0,0", reverse=True)

    def _configure(self, values: list[int]) -> None:
        if values[:1] == [10] and self.version >= (3, 0, 0):
            before, after = self.future, bool(values[1]) or self._future_only
            self.future = after
            if before != after:  # the answer begins in the old syntax and ends in the new one
                self._line("CUOK" if before else "", "\r\n" if before else "\n")
                return
        if values[:1] == [60]:
            self._threshold = values[1]
        self._ok("CU")

    def _switch(self, values: list[int]) -> None:
        pair = (values[0], values[1] if len(values) > 1 else int(self._on[1]))
        if self.version >= (2, 8, 0):
            self._push(Command("enable", enable=pair))
        else:
            self._enable(*pair)
        self._ok("EM")

    def _clear(self, _: list[int]) -> None:
        self.count = [0, 0]
        self._ok("CS")

    def _set_variable(self, values: list[int]) -> None:
        if not values or not 0 <= values[0] <= 255:
            self._error("SL", "!6 Err: Invalid parameter value")
            return
        self._variables[values[1] if len(values) > 1 and self.version >= (3, 0, 0) else 0] = values[0]
        self._ok("SL")

    def _set_power(self, values: list[int]) -> None:
        self._reload = values[0] / 1000  # a countdown that runs goes on
        if len(values) > 1:
            self._servo_power = bool(values[1])
        self._ok("SR")

    def _pen_moves(self) -> None:
        if self.version >= (2, 5, 6):
            self._servo_power = True
            self._power_off_at = self._t + self._reload if self._reload else math.inf

    def _servo(self, values: list[int]) -> None:
        pulse, pin, rate, delay = (*values, 0, 0, 0, 0)[:4]
        if not 0 <= pin <= 24 or not 0 <= pulse <= 65_535:
            self._error("S2", "!6 Err: Invalid parameter value")
            return
        if pin == STANDARD and self.version >= (2, 7, 0):
            self._pen_moves()
        if pulse == 0:
            self._servos.pop(pin, None)
        else:
            self._push(Command("servo", delay / 1000, servo=(pin, pulse, rate)))
        self._ok("S2")

    _up, _down = 12_000, 16_000

    def _set_servo(self, values: list[int]) -> None:
        if values[0] == 4:
            self._up = values[1]
        elif values[0] == 5:
            self._down = values[1]
        self._ok("SC")

    def _pen(self, values: list[int]) -> None:
        self._pen_moves()
        delay = values[1] / 1000 if len(values) > 1 else 0.0
        self._push(Command("servo", delay, servo=(STANDARD, self._up if values[0] else self._down, 400)))
        self._ok("SP")

    def _straight(self, values: list[int]) -> None:
        milliseconds, first, second = (*values, 0)[:3]
        self._push_move("SM", milliseconds, (first, second))

    def _mixed(self, values: list[int]) -> None:
        number, self.made = self.made, self.made + 1
        fault = self.faults.get(number)
        if fault is not None:
            self._misbehave(fault)
            if fault != "late":
                return
            self._silent_until = self.seconds + self.silence
            del self.faults[number]
            self._typed.appendleft(self.received.pop())
            return
        milliseconds, right, down = values[:3]
        self._push_move("XM", milliseconds, (right + down, right - down))

    def _push_move(self, name: str, milliseconds: int, steps: tuple[int, int]) -> None:
        if milliseconds < 1:
            self._error(name, "!6 Err: Invalid parameter value")
            return
        for axis, count in enumerate(steps, start=1):
            too_fast = abs(count) // milliseconds > 25 if self.version < (3,) else abs(count) > 25 * milliseconds
            if too_fast and self.version < (3,):
                self._line(f"!0 Err: <axis{axis}> step rate > 25K steps/second.", "\n\r")
                return
            if too_fast:
                self._error(name, f"!0 Err: <axis{axis}> step rate too high")
                self._line("" if self.future else "OK", "\n" if self.future else "\r\n")  # both follow it
                return
        kind = "move" if steps != (0, 0) else "delay"
        self._push(Command(kind, milliseconds / 1000, steps))
        self._ok(name)

    def _misbehave(self, fault: str) -> None:
        if fault == "error":
            self._error("XM", "!6 Err: Invalid parameter value")
        elif fault == "garbage":
            self._line("\x7f~~", "\r\n")
        elif fault == "half":
            self._line("O", "")
        elif fault == "lost":
            return
        elif fault == "mute":
            self._silent_until = math.inf
        elif fault == "unplug":
            self.cable.unplug()
        elif fault == "reset":
            self.restart()


class EbbAtPort(EbbController):
    """The same at a port with a name that outlives a pulled cable: `port`, a link."""

    def __init__(
        self, port: Path, version: str = "2.8.1", *, future: bool | str = False, lift: int = STANDARD,
        faults: dict[int, str] | None = None,
    ) -> None:  # fmt: skip
        super().__init__(version, future=future, lift=lift, faults=faults)
        self.port = port
        self._link()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.cable.unplug()

    def pull_out(self) -> None:
        """Pulls the cable: the board has no power of its own and forgets everything."""
        self.cable.unplug()

    def plug_in(self) -> None:
        """Plugs the cable in again: the board boots."""
        self.restart()
        self.cable.plug()
        self._link()

    def _link(self) -> None:
        self.port.unlink(missing_ok=True)
        self.port.symlink_to(self.cable.name)


class TimedEbb(EbbAtPort):
    """The same, alive while the driver waits, by `clock`: nothing depends on a busy computer."""

    def __init__(self, port: Path, clock: SimulatedTime, version: str = "2.8.1", **how: Any) -> None:
        self.clock = clock
        clock.attach(self)
        super().__init__(port, version, **how)

    def settle(self) -> None:
        """Returns when all that was sent is done."""
        self.clock.sleep(1.0)


class Ebb(EbbAtPort):
    """The same, alive in a thread, `pace` times faster than real: for drivers in other processes."""

    def __init__(self, port: Path, version: str = "2.8.1", *, pace: float = 100.0, **how: Any) -> None:
        self.pace = pace
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        Cable(self)
        super().__init__(port, version, **how)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join(5)
        self.cable.unplug()

    def pull_out(self) -> None:
        with self._lock:
            super().pull_out()

    def plug_in(self) -> None:
        with self._lock:
            super().plug_in()

    def _run(self) -> None:
        before = time.monotonic()
        while not self._over.wait(0.001):
            now = time.monotonic()
            gone, before = (now - before) * self.pace, now
            with self._lock:
                self.cable.step(gone, settle=False)
