"""The robot kind `axidraw`: plotters with an EiBotBoard (EBB) and a brush on a servo, such as AxiDraw and NextDraw.

ebb.py speaks to the board. The motion is planned here: short straight moves in whole steps and milliseconds.
"""

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from frida_painter import registry
from frida_painter.errors import ConfigError, MotionFailed, RobotDisconnected, RobotError, ZeroUnknown
from frida_painter.hardware.deadline import steady
from frida_painter.hardware.gcode import Servo
from frida_painter.hardware.interlock import PATIENCE
from frida_painter.hardware.kinds import MachineName, Needed, RobotKind, at_port, by_name, find_port, require_home
from frida_painter.hardware.robot import MachineFact, MotionReport, Point, StopLine, Waypoints, Workspace, Zero
from frida_painter.hardware.timing import AxisTiming
from frida_painter_drivers.driver import Driver
from frida_painter_drivers.ebb import MAX_STEP_RATE, STOP_BYTES, Board, BoardState
from frida_painter_drivers.serial_line import SerialLine

STEPS_PER_MM = 80
"""Steps per millimetre of an AxiDraw at 1/16 microstepping: 2032 per inch."""
MAX_SPEED = 0.99 * MAX_STEP_RATE / (1000 * STEPS_PER_MM * math.sqrt(2))
"""Greatest speed in every direction, m/s: on a diagonal one motor makes all the steps."""
_PIECE = 0.025  # seconds of a move: after a stop the board finishes no more than the current one
_JERK = 0.04  # m/s by which the speed of a motor's belt may jump in a corner
_JOG_SPEED = 0.03
_ACCELERATION = 0.8  # m/s2
_TICK = 24  # milliseconds between two pulses of a servo
_TOGETHER = 1e-9  # metres


# Lifts: the servo that raises the brush, and the pin at which the board drives it.


class Lift(NamedTuple):
    """Kind of lift: pin of the board (RPn) that drives its servo, and its range.

    Heights are those of a brush in the middle of its travel, to be calibrated.
    """

    pin: int
    servo: Servo


LIFTS = {
    "standard": Lift(4, Servo((-0.002, 9855), (0.010, 27_831))),
    "brushless": Lift(5, Servo((-0.002, 5400), (0.010, 12_600))),
}
"""Lifts by name. "brushless" is that of NextDraw and of AxiDraws with the upgrade, "standard" that of all others."""


@dataclass(frozen=True)
class AxidrawSettings:
    """Settings of an AxiDraw.

    home: home position of the tip, metres
    port: of the board, or its name tag; None for the first board found
    lift: "standard" or "brushless" (LIFTS)
    servo: two calibrated heights with pulses in units of 1/12 microsecond; None for the whole range of the lift
    approach: m/s to the first waypoint, above 0 to MAX_SPEED
    up_speed, down_speed: m/s at which the lift raises and lowers the brush, 0.001 to 0.2

    The zero of the robot's frame is the home corner of the carriage. x points to the right and y away from you, so
    that y is negative everywhere on the table.
    Raises ConfigError if a value is not allowed.
    """

    home: Point
    port: str | None = None
    lift: str = "standard"
    servo: Servo | None = None
    approach: float = 0.15
    up_speed: float = 0.05
    down_speed: float = 0.03

    def __post_init__(self) -> None:
        if self.lift not in LIFTS:
            raise ConfigError(f"An AxiDraw was given the lift {self.lift!r}; there are {' and '.join(LIFTS)}.")
        if not 0 < self.approach <= MAX_SPEED:
            raise ConfigError(
                f"An AxiDraw was given a travel speed of {self.approach:g} m/s; its board makes {MAX_STEP_RATE} steps "
                f"a second, which is {MAX_SPEED:.3f} m/s on a diagonal. Set travel_speed to at most that."
            )
        speeds = (self.up_speed, self.down_speed)
        if not all(0.001 <= speed <= 0.2 for speed in speeds):
            raise ConfigError(f"An AxiDraw was given lift speeds of {speeds} m/s; they are from 0.001 to 0.2 m/s.")

    @property
    def pin(self) -> int:
        """Pin of the board that drives the lift's servo."""
        return LIFTS[self.lift].pin

    @property
    def range(self) -> Servo:
        """Heights and pulses of the lift."""
        return self.servo or LIFTS[self.lift].servo

    @property
    def timing(self) -> AxisTiming:
        """Limits on the motion: of the two belts, which run along the diagonals, and of the lift."""
        belt, up = MAX_STEP_RATE / (1000 * STEPS_PER_MM), max(self.up_speed, self.down_speed)
        return AxisTiming(
            speed=(belt, belt, up),
            acceleration=(math.inf, math.inf, math.inf),
            axes=((1.0, 1.0, 0.0), (1.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
            jerk=(_JERK, _JERK, up),
            along=_ACCELERATION,
            between=0.08,
        )


# Motion for an EiBotBoard.


@dataclass(frozen=True)
class Move:
    """Move of the plotter: one command of the board, and one before it if the height changes.

    waypoint: index of the waypoint to which the move leads
    steps: (right, towards you)
    milliseconds: duration
    height: of the tip at the end, metres
    """

    waypoint: int
    steps: tuple[int, int]
    milliseconds: int
    height: float


def moves(here: NDArray[np.float64], waypoints: Waypoints, settings: AxidrawSettings) -> Iterator[Move]:
    """Yields the moves from `here` [3] (m) through all waypoints, with ramps between stops and slow corners.

    Steps are counted from the zero of the robot's frame, and milliseconds from the start, so that rounding errors do
    not add up.
    """
    path = np.concatenate([here[None], waypoints.position])
    way = np.diff(path, axis=0)
    length = np.linalg.norm(way, axis=1)
    used = np.flatnonzero(length > _TOGETHER)
    if len(used) == 0:
        return
    speed = np.full(len(way), waypoints.speed)
    speed[0] = settings.approach
    rise = way[:, 2] / np.maximum(length, _TOGETHER)
    lift = np.where(rise > 0, settings.up_speed, settings.down_speed)
    speed = np.minimum(speed, lift / np.maximum(np.abs(rise), 1e-9))
    corners = path[np.r_[used, used[-1] + 1]]
    entry, peak, gain = settings.timing.ramps(corners, speed[used])
    at, clock, done = _steps(here), 0.0, 0
    for number, index in enumerate(used):
        reach, seconds = _ramp(entry[number], entry[number + 1], peak[number], gain[number], length[index])
        count = max(1, math.ceil(seconds / _PIECE))
        for piece in range(1, count + 1):
            place = path[index] + reach(seconds * piece / count) / length[index] * way[index]
            if piece == count:
                place = path[index + 1]
            there = _steps(place)
            right, down = there[0] - at[0], there[1] - at[1]
            clock += 1000 * seconds / count
            fewest = math.ceil(max(abs(right + down), abs(right - down)) * 1000 / MAX_STEP_RATE)
            milliseconds = max(round(clock) - done, fewest, 1)
            done += milliseconds
            yield Move(int(index), (right, down), milliseconds, float(place[2]))
            at = there


def _ramp(first: float, last: float, peak: float, gain: float, length: float) -> tuple[Callable[[float], float], float]:
    """Returns the distance as a function of the time, and the duration, of a segment with two ramps.

    first, last, peak: speeds at its ends and between its ramps, m/s
    gain: acceleration, m/s2; infinite for none
    """
    up, down = ((peak - end) / gain for end in (first, last))
    ramps = (first + peak) / 2 * up, (last + peak) / 2 * down
    flat = max(length - sum(ramps), 0.0) / peak
    seconds = up + flat + down

    def reach(moment: float) -> float:
        if moment < up:
            return first * moment + gain * moment**2 / 2
        if moment < up + flat:
            return ramps[0] + peak * (moment - up)
        left = max(seconds - moment, 0.0)
        return length - last * left - (gain * left**2 / 2 if left > 0 else 0.0)

    return reach, seconds


def _steps(place: NDArray[np.float64]) -> tuple[int, int]:
    """Returns the steps to the right and towards you of a position in the robot's frame (y away from you)."""
    return round(1000 * STEPS_PER_MM * float(place[0])), round(-1000 * STEPS_PER_MM * float(place[1]))


_NEEDED = Needed(module="serial", extra="plotter")
_BOARD = (0x04D8, 0xFD92)  # numbers of maker and product that an EiBotBoard tells the USB


class AxidrawRobot(Driver):
    """Robot with an EiBotBoard. Implements ZeroedRobot, LineStoppedRobot and PausableRobot as well.

    Its position is the count of the board's steps, so it cannot detect lost steps. A mark in the board's memory, which
    is lost with the count, tells after a new connection whether the count is still true.
    """

    def __init__(self, settings: AxidrawSettings) -> None:
        super().__init__("the AxiDraw", settings.home, settings.approach)
        self.settings = settings
        self._line: SerialLine | None = None
        self._board: Board | None = None
        self._height = settings.range.high[0]
        self._offset = (0, 0)  # steps to the right and towards you at which the counters were zero
        self._lost = "it was not connected yet"
        self._pressed = self._breaks_off = False  # the latter: the last motion has not ended

    def _open(self, *, examines: bool) -> None:
        """Finds the board, raises the brush and reads whether the zero survived; if not, the motors are left off.

        Raises RobotError if the motors have no power or the firmware is too old.
        """
        self._line = SerialLine.open(self._port(), 9600)
        self._board = board = Board(self._line, self._interlock)
        board.greet()
        if examines:
            return
        if board.voltage_is_low():
            raise RobotError(_NO_POWER)
        known = _read_zero(board)
        if isinstance(known, str):
            self._offset, self._lost = (0, 0), known
            board.forget_zero()
            board.switch_motors(False)  # so that the carriage can be pushed into its corner
        else:
            self._offset, self._lost = known, ""
        board.watch_power()
        if self.settings.lift == "standard":
            board.hold_lift(round(self.settings.range.high[1]))
        self._raise_lift(board)
        board.button()  # a press before the connection meant something else
        self._pressed = False

    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres, from the steps made. Its height is the servo's last command."""
        board = self._ready("pose")
        with self._interlock.blocking():
            return self._place(board)

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Moves along the waypoints with acceleration and braking; returns when the motors stand.

        Raises ConfigError before anything moves, if the servo does not reach a height or the board a speed.
        Raises ZeroUnknown if the position is not known, MotionFailed, RobotDisconnected, RobotStopped.
        """
        self._require_way(waypoints)
        if self._lost:
            said = f"does not know where it stands: {self._lost}. Find its zero again: push the carriage into its home "
            raise self._failure(ZeroUnknown, waypoints.label, f"{said}corner, and confirm that.")
        return super().follow(waypoints)

    def stop_line(self) -> StopLine | None:
        """Returns the line over which another process can stop the board. Implements LineStoppedRobot."""
        line = self._line
        return None if line is None else line.stop_line(STOP_BYTES)

    def close(self) -> None:
        """Disconnects from the board, which goes on to hold its motors and the lift."""
        line, board = self._line, self._board
        if board is not None and self._breaks_off and not self._lost:
            with contextlib.suppress(RobotError):  # after a stop or a fault the counters are true, too
                board.drain()
                board.note_steps()
        self._line, self._board, self._breaks_off = None, None, False
        self._interlock.mark_disconnected()
        if line is not None:
            line.close()

    def zero(self) -> Zero:
        """Returns the knowledge about the zero: lost after a start of the board or while its motors had no power."""
        self._ready("zero")
        return Zero(self._lost)

    def find_zero(self) -> None:
        """Raises RobotError: an AxiDraw has no switches. A person pushes its carriage into the corner."""
        raise RobotError(
            f"{self._interlock.name} has no switches to find its zero; push its carriage into the home corner, and "
            "confirm that."
        )

    def jog(self, step: NDArray[np.float64]) -> None:
        """Moves the tip slowly by `step` [3] metres, also if the zero is lost.

        Raises WorkspaceViolation, before anything moves, if the servo does not reach that height.
        Raises the errors of `follow`.
        """
        waypoints = Waypoints("jog", (self.pose() + step)[None], _JOG_SPEED)
        self.settings.range.require(float(waypoints.position[0, 2]))
        super().follow(waypoints)

    def set_zero(self, tip: NDArray[np.float64]) -> None:
        """Declares that the tip stands at `tip` [3] (m) now, switches the motors on and marks the board's memory.

        The height is that of the servo, so tip[2] has no effect.
        Raises ConfigError if `tip` is no position.
        """
        if tip.shape != (3,) or not np.isfinite(tip).all() or np.abs(tip).max() > 1.6:
            raise ConfigError(f"{self._interlock.name} was told to stand at {tip}; give x, y, z within 1.6 m.")
        board = self._ready("set the zero")
        with self._interlock.blocking():
            board.forget_zero()
            if not board.motors_on():
                board.switch_motors(True)
            board.clear_steps()
            right, down = (board.round_zero(steps) for steps in _steps(tip))
            board.remember_zero(right, down)
        self._offset, self._lost = (right, down), ""

    def timing(self) -> AxisTiming:
        """Returns the limits of the board, the belts and the lift, by which the motion is planned here."""
        return self.settings.timing

    def wants_pause(self) -> bool:
        """Returns True, once, if the board's button was pressed since the last call."""
        board = self._ready("button")
        with self._interlock.blocking():
            pressed = board.button() or self._pressed
        self._pressed = False
        return pressed

    def _facts(self) -> Iterator[MachineFact]:
        board = self._ready("examine")
        yield MachineFact(f"An EiBotBoard with firmware {board.version_text} answers at {board.port}.")
        if board.voltage_is_low():
            yield MachineFact(_NO_POWER, "refusal")
        known = _read_zero(board)
        yield MachineFact(
            f"Its zero is not known: {known}. Painting begins with a question about that."
            if isinstance(known, str)
            else "Its zero is known, and its motors hold the carriage."
        )
        yield MachineFact(
            f"It makes {MAX_STEP_RATE} steps a second per motor: {MAX_SPEED:.3f} m/s on a diagonal. Travel is set to "
            f"{self.settings.approach:g} m/s."
        )
        lift, servo = self.settings.lift, self.settings.range
        other = next(name for name in LIFTS if name != lift)
        yield MachineFact(
            f"The lift is taken for {lift}, at pin {self.settings.pin} with pulses of {servo.low[1]:g} to "
            f"{servo.high[1]:g}. The board cannot tell whether a servo is there: if the brush does not move as the "
            f"plotter is connected, write lift={other}."
        )
        if lift == "standard" and board.version < (2, 7, 0):
            yield MachineFact(
                f"Firmware {board.version_text} has faults in the power of the lift's servo; they are worked around, "
                "and 2.8.1 or newer is better (wiki.evilmadscientist.com/Updating_EBB_firmware).",
                "warning",
            )
        if not board.tells_power_loss:
            yield MachineFact(
                "A short failure of the motors' power supply goes unnoticed before firmware 3: if it was unplugged, "
                "unplug the USB cable, too.",
                "warning",
            )
        yield MachineFact("Its button pauses the painting after the current stroke.")

    def _port(self) -> str:
        with registry.importing("plotter", "An AxiDraw", RobotError):
            from serial.tools.list_ports import comports
        if self.settings.port is not None:  # or the name that its owner gave to a board, which is its serial number
            return find_port(self.settings.port)
        boards = [port for port in comports() if (port.vid, port.pid) == _BOARD]
        if not boards:
            raise RobotDisconnected("No AxiDraw was found; plug in its USB cable, or say which port it is at.")
        return str(boards[0].device)

    def _ready(self, label: str) -> Board:
        self._interlock.require_ready(label)
        if self._board is None:
            raise self._failure(RobotError, label, "is not connected; call connect() first.")
        return self._board

    def _require_way(self, waypoints: Waypoints) -> None:
        self._ready(waypoints.label)
        super()._require_way(waypoints)
        if waypoints.speed > MAX_SPEED:
            raise ConfigError(
                f"{waypoints.label}: {self._interlock.name} was given a speed of {waypoints.speed:g} m/s; its board "
                f"makes {MAX_STEP_RATE} steps a second, which is {MAX_SPEED:.3f} m/s on a diagonal. It did not move."
            )
        for height in waypoints.position[:, 2].tolist():
            self.settings.range.value(height)

    def _go(self, waypoints: Waypoints) -> NDArray[np.float64]:
        board = self._ready(waypoints.label)
        started = time.monotonic()
        self._require_power(board, waypoints.label, board.state())
        self._breaks_off = True
        todo = list(moves(self._place(board), waypoints, self.settings))
        before = ([self._height] + [move.height for move in todo[:-1]])[-1]
        pulses = [round(self.settings.range.value(move.height)) for move in todo]
        until = started + 2 * sum(move.milliseconds for move in todo) / 1000 + PATIENCE
        for move, pulse in zip(todo, pulses, strict=True):
            self._make(board, move, pulse, waypoints.label)
        if todo and todo[-1].height != before:  # the servo is up to two pulses late
            board.do(f"SM,{2 * _TICK},0,0", waypoints.label, None, time.monotonic() + PATIENCE)
        self._require_power(board, waypoints.label, board.wait(waypoints.label, until))
        board.note_steps()
        self._breaks_off = False
        self._alive = steady()
        return self._place(board)

    def _halt(self) -> None:
        """Sends ES: the board drops its current and queued moves. The brush stays at its height; the motors hold."""
        if self._board is not None:
            self._board.halt()

    def _make(self, board: Board, move: Move, pulse: int, label: str) -> None:
        """Has the board make a move. The lift moves in parallel with the belts, at its own rate and never at once."""
        until = time.monotonic() + PATIENCE  # a board that is alive takes a move as soon as an earlier one is over
        if move.height != self._height:
            rate = self._rate(self.settings.up_speed if move.height > self._height else self.settings.down_speed)
            delay = 0 if move.steps != (0, 0) else move.milliseconds
            board.do(f"S2,{pulse},{self.settings.pin},{rate},{delay}", label, move.waypoint, until)
            self._height = move.height
        if move.steps != (0, 0):
            right, down = move.steps
            board.do(f"XM,{move.milliseconds},{right},{down}", label, move.waypoint, until)
        self._alive = steady()

    def _rate(self, speed: float) -> int:
        """Returns the change of the pulse from one to the next at a speed of the lift in m/s."""
        (low, at_low), (high, at_high) = self.settings.range.low, self.settings.range.high
        return max(1, round(abs(at_high - at_low) / (high - low) * speed * _TICK / 1000))

    def _raise_lift(self, board: Board) -> None:
        """Raises the brush vertically from an unknown height, at the lift's rate."""
        (low, _), (high, at_high) = self.settings.range.low, self.settings.range.high
        seconds = (high - low) / self.settings.up_speed
        rate = self._rate(self.settings.up_speed)
        until = time.monotonic() + PATIENCE + seconds
        board.do(f"S2,{round(at_high)},{self.settings.pin},{rate},{round(1000 * seconds)}", "connect", None, until)
        board.wait("connect", until)
        self._height = high

    def _require_power(self, board: Board, label: str, state: BoardState) -> None:
        """Raises MotionFailed, and forgets the zero, if the motors have no power, or had none for a while."""
        self._pressed = self._pressed or state.button
        if state.power_lost or board.voltage_is_low():
            self._lost = "its motors lost their power, so its carriage may have moved"
            board.forget_zero()
            raise MotionFailed(
                f"{label}: {self._interlock.name} lost the power of its motors, so its carriage may have moved. Look "
                "at its power supply, then connect anew; its zero has to be found again."
            )

    def _place(self, board: Board) -> NDArray[np.float64]:
        first, second = board.steps()
        right, down = self._offset[0] + (first + second) / 2, self._offset[1] + (first - second) / 2
        return np.array([right / STEPS_PER_MM / 1000, -down / STEPS_PER_MM / 1000, self._height])


_NO_POWER = "The AxiDraw has no power for its motors; plug in its power supply."


def _read_zero(board: Board) -> tuple[int, int] | str:
    """Returns the steps (right, towards you) at which the counters were zero, or why they cannot be trusted.

    Another program that paints with the board sets the counters to zero and leaves the carriage there.
    """
    marked = board.recall_zero()
    if isinstance(marked, str):
        return marked
    if not board.motors_on():
        return "its motors were off, so its carriage may have been pushed; push it into the home corner, its zero"
    if board.steps() == (0, 0):
        return "its counters stand at zero, as after another program"
    return marked


def _open(name: MachineName, workspace: Workspace) -> AxidrawRobot:
    name.require("servo", "lift", "up_speed", "down_speed", where=False)
    read: dict[str, Callable[[str], Any]] = {
        "lift": lambda kind: str(LIFTS[kind] and kind), "servo": Servo.of, "up_speed": float, "down_speed": float,
    }  # fmt: skip
    told: dict[str, Any] = {option: name.choose(option, read[option], None) for option in name.options}
    if workspace.painting_speed > MAX_SPEED:
        raise ConfigError(
            f"The workspace has a painting_speed of {workspace.painting_speed:g} m/s; an AxiDraw paints with at most "
            f"{MAX_SPEED:.3f} m/s, which are {MAX_STEP_RATE} steps a second on a diagonal."
        )
    home, approach = require_home(name, workspace), workspace.travel_speed
    return AxidrawRobot(AxidrawSettings(home, name.where or None, approach=approach, **told))


KIND = RobotKind(
    "axidraw",
    "axidraw[:PORT][,lift=standard|brushless][,servo=Z/PULSE/Z/PULSE][,up_speed=M/S][,down_speed=M/S]",
    "AxiDraw, NextDraw and other plotters with an EBB",
    open=_open,
    needed=_NEEDED,
    identify=lambda name: at_port(name.where) if name.where else by_name(name),
)
