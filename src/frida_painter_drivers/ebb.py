"""The EiBotBoard (EBB): its commands over an open serial line, in the syntaxes of firmware 2 and 3.

Protocol: evil-mad.github.io/EggBot/ebb.html (firmware 3) and ebb2.html (firmware 2).

The board answers a command with "OK" (legacy syntax) or with the command's name (future syntax, which NextDraw's
software leaves on). It reads no command while its queue of one move is full. So a stop waits for the current move.
"""

import re
import time
import zlib
from contextlib import suppress
from typing import NamedTuple

from frida_painter.errors import MotionFailed, RobotDisconnected, RobotError
from frida_painter.hardware.interlock import PATIENCE, Interlock
from frida_painter_drivers.serial_line import SerialLine

MAX_STEP_RATE = 25_000
"""Greatest rate of each motor, steps/s; the board refuses a faster move."""
STOP_BYTES = b"\rES\r"
"""Bytes that make the board drop its moves: ES on a new line, after any partial command."""
_SLICE = 0.02
_POLL = 0.005
_QUIET = 0.06  # seconds without a byte after which an earlier answer is over
_UNASKED = ("I,", "A,", "Limit switch")
_VERSION = re.compile(r"EBB.*Firmware Version (\d+)\.(\d+)\.(\d+)")
_OLDEST = (2, 4, 4)
_MIN_VOLTAGE = 250  # reading of QC: about 9 V at the motors' plug
_MARK = (70, 82, 73, 68)
_STEPS_INDEX, _MARK_INDEX = 19, 20  # of the 32 variables of firmware 3
_OFFSET_UNIT = 4  # steps: two offsets of 16 bits fit into the node counter of firmware 2


class BoardState(NamedTuple):
    """State of the board between two commands.

    moving: True if a command is executed or waits
    button: True if the button was pressed since the last question
    power_lost: True if the motors' power supply failed since the last question
    """

    moving: bool
    button: bool = False
    power_lost: bool = False


class Board:
    """EiBotBoard at an open line. Its counters of steps are those of the two motors.

    port: name of its serial line
    version: of the firmware, once greeted

    Raises RobotDisconnected if it does not answer, RobotError if it answers nonsense or refuses.
    """

    def __init__(self, line: SerialLine, interlock: Interlock) -> None:
        self._line, self._interlock, self.port = line, interlock, line.name
        self._future = False
        self.version = (0, 0, 0)

    @property
    def version_text(self) -> str:
        """Version of the firmware as its makers write it."""
        return ".".join(map(str, self.version))

    @property
    def tells_power_loss(self) -> bool:
        """True if the board remembers that the motors' power supply failed (firmware 3)."""
        return self.version >= (3, 0, 0)

    def greet(self) -> None:
        """Asks for the version and switches to legacy syntax, if the board has it.

        Raises RobotDisconnected if this is no EiBotBoard, RobotError if its firmware is too old.
        """
        self._line.write(b"\r")  # ends a partial command
        self.drain()
        answer = self._ask_version()
        if answer.startswith("V,EBB"):
            self._line.write(b"CU,10,0\r")  # its answer begins in one syntax and ends in the other
            answer = self._ask_version()
        self._future = answer.startswith("V,")
        found = _VERSION.search(answer)
        if found is None:
            raise RobotDisconnected(
                f"What answers at {self._line.name} is no EiBotBoard; it said {answer[:60]!r}. Give the plotter's port."
            )
        self.version = (int(found[1]), int(found[2]), int(found[3]))
        if self.version < _OLDEST:
            raise RobotError(
                f"{self._interlock.name} has the firmware {self.version_text}, which does not count its steps; update "
                "it (wiki.evilmadscientist.com/Updating_EBB_firmware)."
            )

    def voltage_is_low(self) -> bool:
        """Returns True if the motors have no power supply."""
        reading = self._ask("QC").partition(",")[2]
        return not (reading.isascii() and reading.isdigit()) or int(reading) < _MIN_VOLTAGE

    def watch_power(self) -> None:
        """Has firmware 3 remember a failure of the motors' power supply from now on."""
        if self.tells_power_loss:
            self._do(f"CU,60,{_MIN_VOLTAGE}")
            self.state()

    def state(self) -> BoardState:
        """Returns what the board does and remembers. Firmware 3 forgets both events when it is asked."""
        if self.version < (3, 0, 0):
            parts = self._ask("QM", ends=False).removeprefix("QM,").split(",")
            if len(parts) < 4 or not set(parts) <= {"0", "1"}:
                raise self._nonsense("QM", ",".join(parts))
            return BoardState("1" in parts)
        answer = self._ask("QG", ends=False)
        try:
            bits = int(answer, 16)
        except ValueError:
            raise self._nonsense("QG", answer) from None
        return BoardState(bool(bits & 0x0F), bool(bits & 0x20), bool(bits & 0x40))

    def button(self) -> bool:
        """Returns True if the button was pressed since the last question. Firmware 3 tells it in `state`, too."""
        if self.version >= (3, 0, 0):
            return self.state().button
        return self._ask("QB") == "1"

    def steps(self) -> tuple[int, int]:
        """Returns the counters of the two motors."""
        first, second = self._numbers("QS", 2)
        return first, second

    def clear_steps(self) -> None:
        """Sets the counters of the two motors to zero."""
        self._do("CS")

    def motors_on(self) -> bool:
        """Returns True if both motors are on at 1/16 steps, so that the carriage cannot be pushed."""
        if self.version >= (2, 8, 0):
            return self._numbers("QE", 2) == [16, 16]
        # Enable pins are low if the motors are on; all three pins for the step size are high at 1/16 (plotink).
        pins = [self._ask(f"PI,{pin}", ends=False).rpartition(",")[2] for pin in ("E,0", "C,1", "E,2", "E,1", "A,6")]
        return pins == ["0", "0", "1", "1", "1"]

    def switch_motors(self, on: bool) -> None:
        """Switches both motors on at 1/16 steps, or off; most boards then set their counters to zero."""
        self._do("EM,1,1" if on else "EM,0,0")
        self.wait()

    def hold_lift(self, pulse: int) -> None:
        """Switches the power of the servo at pin 4 on and keeps it on; by default it ends 60 s after the last move.

        pulse: at which the servo stands afterwards, on boards that switch the power on for the commands SP alone

        Raises RobotError if the board does not confirm.
        """
        if self.version < (2, 6, 0):  # older boards do not switch it, or switch it on with each motion
            return
        self._do("SR,0,1")
        if self.version < (2, 7, 0):  # S2 does not restore the power (EggBot issue 144), and a countdown may still run
            self._do(f"SC,4,{pulse}")
            self._do("SP,1")
        if self._ask("QR") != "1":
            raise RobotError(f"{self._interlock.name} does not give its lift's servo power; look at its board.")

    # The zero. The board's memory is lost with its power, as its counters are.

    def remember_zero(self, right: int, down: int) -> None:
        """Writes a mark and the carriage's position in steps, at which the counters were zero, to the board's memory.

        The position is rounded first by `round_zero`.
        """
        if self.version >= (3, 0, 0):
            content = b"".join(value.to_bytes(4, "big", signed=True) for value in (right, down))
            for index, byte in enumerate((*_MARK, *content), start=_MARK_INDEX):
                self._do(f"SL,{byte},{index}")
        else:
            offsets = [value // _OFFSET_UNIT + 0x8000 for value in (right, down)]
            self._do(f"SN,{offsets[0] << 16 | offsets[1]}")
        self.note_steps()

    def note_steps(self) -> None:
        """Writes to the board's memory what tells the counters as they are from those of another program.

        Each program that switches the motors on (EM) sets the counters to zero, wherever the carriage stands.
        """
        index = f",{_STEPS_INDEX}" if self.version >= (3, 0, 0) else ""
        self._line.write(f"SL,{_digest(self.steps())}{index}\r".encode("ascii"))
        self._read("SL")  # not by `do`, which heeds a stop

    def round_zero(self, steps: int) -> int:
        """Returns steps as the board's memory can hold them."""
        return steps if self.version >= (3, 0, 0) else round(steps / _OFFSET_UNIT) * _OFFSET_UNIT

    def forget_zero(self) -> None:
        """Deletes the mark from the board's memory."""
        self._do(f"SL,0,{_MARK_INDEX}" if self.version >= (3, 0, 0) else "SL,0")

    def recall_zero(self) -> tuple[int, int] | str:
        """Returns the position that `remember_zero` wrote, or why it is not true any more."""
        known = self._recall()
        if known is None:
            return (
                "its board was reset or just switched on; its zero is the home corner, into which it can be pushed now"
            )
        index = f",{_STEPS_INDEX}" if self.version >= (3, 0, 0) else ""
        if self._numbers(f"QL{index}", 1)[0] != _digest(self.steps()):
            return "another program has moved it, or its last motion broke off; push it into the home corner, its zero"
        return known

    def _recall(self) -> tuple[int, int] | None:
        if self.version >= (3, 0, 0):
            memory = [self._numbers(f"QL,{_MARK_INDEX + index}", 1)[0] for index in range(12)]
            if tuple(memory[:4]) != _MARK:
                return None
            right, down = (int.from_bytes(bytes(part), "big", signed=True) for part in (memory[4:8], memory[8:]))
            return right, down
        if self._numbers("QL", 1)[0] == 0:
            return None
        both = self._numbers("QN", 1)[0]
        return ((both >> 16) - 0x8000) * _OFFSET_UNIT, ((both & 0xFFFF) - 0x8000) * _OFFSET_UNIT

    # Commands and questions.

    def do(self, command: str, label: str, waypoint: int | None, until: float) -> None:
        """Sends a command and waits until the board took it, which it does when its queue has a place.

        label, waypoint: of the motion, for messages
        until: deadline on the clock of time.monotonic

        Raises RobotStopped if the robot was stopped, MotionFailed if the board refuses, RobotDisconnected.
        """
        self._interlock.heed_stop(label)
        self._line.write(command.encode("ascii") + b"\r")
        wanted = {"OK", command.partition(",")[0]}
        while True:
            answer = self._listen()
            self._interlock.heed_stop(label)
            if answer in wanted:
                return
            if answer:
                where = "" if waypoint is None else f" at waypoint {waypoint}"
                said = f"answered {answer[:60]!r} to {command!r}{where}, and is stopped; look at it, then connect anew."
                raise self._interlock.failure(MotionFailed, label, said, answer[:60], waypoint)
            if time.monotonic() > until:
                said = f"said nothing for {PATIENCE:.0f} s after {command!r}; a command was lost, or its board hangs."
                raise self._interlock.failure(RobotDisconnected, label, f"{said} Look at it and its cable.")

    def wait(self, label: str = "connect", until: float | None = None) -> BoardState:
        """Returns when nothing moves and nothing is queued, with the events since.

        until: deadline on the clock of time.monotonic; by default a few seconds from now

        Raises RobotStopped, MotionFailed if the deadline passes.
        """
        until = time.monotonic() + PATIENCE if until is None else until
        button = power_lost = False
        while True:
            state = self.state()
            button, power_lost = button or state.button, power_lost or state.power_lost
            if not state.moving:
                return BoardState(False, button, power_lost)
            self._interlock.heed_stop(label)
            if time.monotonic() > until:
                said = "did not arrive in time, and is stopped; look at it."
                raise self._interlock.failure(MotionFailed, label, said)
            time.sleep(_POLL)

    def halt(self) -> None:
        """Sends ES. A lost line is ignored."""
        with suppress(RobotError):
            self._line.write(STOP_BYTES)

    def _do(self, command: str) -> None:
        self.do(command, "connect", None, time.monotonic() + PATIENCE)

    def _numbers(self, question: str, count: int) -> list[int]:
        answer = self._ask(question)
        try:
            numbers = [int(part) for part in answer.split(",")]
        except ValueError:
            raise self._nonsense(question, answer) from None
        if len(numbers) != count:
            raise self._nonsense(question, answer)
        return numbers

    def _ask(self, question: str, *, ends: bool = True) -> str:
        """Returns the answer to a question, without its name. ends: True if legacy syntax sends an "OK" after it."""
        self._line.write(question.encode("ascii") + b"\r")
        answer = self._read(question)
        name = question.partition(",")[0]
        if self._future:
            if answer.startswith(f"{name},!") or not answer.startswith(f"{name},"):
                raise self._nonsense(question, answer)
            return answer.removeprefix(f"{name},")
        if answer.startswith("!"):
            raise self._nonsense(question, answer)
        if ends and (second := self._read(question)) != "OK":
            raise self._nonsense(question, f"{answer}, {second}")
        return answer

    def _ask_version(self) -> str:
        """Returns the answer to V, or the last line if none came in time. Late answers to others come first."""
        until = time.monotonic() + PATIENCE
        self._line.write(b"V\r")
        answer = self._read("V")
        while _VERSION.search(answer) is None and time.monotonic() < until:
            answer = self._listen() or answer
        return answer

    def _read(self, question: str) -> str:
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            if answer := self._listen():
                return answer
        raise RobotDisconnected(
            f"{self._interlock.name} did not answer {question} in {PATIENCE:.0f} s; look at it and at its cable."
        )

    def _listen(self) -> str | None:
        """Returns the next line within a moment, except for packets that another program has asked for (T, CU,53)."""
        answer = self._line.read(_SLICE)
        return None if answer is not None and answer.startswith(_UNASKED) else answer

    def drain(self) -> None:
        """Discards what the board still says, such as the second line of an error before the connection."""
        until = time.monotonic() + PATIENCE
        while self._line.read(_QUIET) is not None:
            if time.monotonic() > until:
                raise RobotDisconnected(
                    f"What is at {self._line.name} does not stop talking; it is no EiBotBoard. Give the plotter's port."
                )

    def _nonsense(self, question: str, answer: str) -> RobotError:
        return RobotError(f"{self._interlock.name} answered {answer[:80]!r} to {question}; look at it and its cable.")


def _digest(steps: tuple[int, int]) -> int:
    """Returns a number for two counters of steps, as large as a variable of firmware 2 holds: 1 to 127."""
    return 1 + zlib.crc32(repr(steps).encode()) % 127
