"""The robot kind `axidraw`: plotters with an EiBotBoard (EBB) and a pen on a servo, such as AxiDraw and NextDraw.

plotink only finds the board. This module exchanges the board's commands itself, because plotink writes errors to a
log and goes on. Protocol: evil-mad.github.io/EggBot/ebb.html.
"""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import ConfigError, FridaError, MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.drivers.gcode import SerialLine
from frida_painter.hardware.drivers.interlock import PATIENCE, Interlock, motion_timeout
from frida_painter.hardware.gcode import Servo
from frida_painter.hardware.kinds import MachineName, Needed, RobotKind, at_port, by_name, require_home
from frida_painter.hardware.robot import MotionReport, Point, Waypoints, Workspace

# Motion for an EiBotBoard: short straight moves in whole steps and milliseconds that start and end slowly.

STEPS_PER_MM = 80
"""Steps per millimetre of an AxiDraw at 1/16 microstepping: 2032 per inch."""
_PIECE = 0.001  # metres
_LONGEST = 0.05  # seconds: after a stop the board still finishes its current move
_SLOWEST = 0.004  # m/s at the start and end of a path


@dataclass(frozen=True)
class Move:
    """Move of the plotter: one command of the board.

    waypoint: index of the waypoint to which the move leads
    steps: (right, towards you)
    seconds: duration
    height: of the tip at the end, metres
    """

    waypoint: int
    steps: tuple[int, int]
    seconds: float
    height: float


def moves(here: NDArray[np.float64], waypoints: Waypoints, approach: float, acceleration: float) -> Iterator[Move]:
    """Yields the moves from `here` through all waypoints.

    here: position [3], metres
    approach: m/s to the first waypoint
    acceleration: m/s2 at the start and end of each way between two stops

    Steps are counted from the zero of the robot's frame, so that rounding errors do not add up.
    """
    at = _steps(here)
    path = np.concatenate([here[None], waypoints.position])
    level = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1)  # [k]
    for first, last in _ways(level):
        walked = np.r_[0, np.cumsum(level[first:last])]
        speed = np.array([approach if index == 0 else waypoints.speed for index in range(first, last)])
        for index in range(first, last):
            start, end = walked[index - first], walked[index - first + 1]
            count = max(1, math.ceil((end - start) / _PIECE))
            for piece in range(count):
                low, high = (start + (end - start) * (piece + part) / count for part in (0, 1))
                middle = (low + high) / 2
                pace = min(speed[index - first], math.sqrt(2 * acceleration * min(middle, walked[-1] - middle)))
                share = (piece + 1) / count
                place = path[index] + share * (path[index + 1] - path[index])
                there = _steps(place)
                steps = (there[0] - at[0], there[1] - at[1])
                seconds = (high - low) / max(pace, _SLOWEST) if high > low else 0.0
                yield from _split(Move(index, steps, seconds, float(place[2])))
                at = there


def _ways(level: NDArray[np.float64]) -> Iterator[tuple[int, int]]:
    """Yields ranges [first, last) of segments that the tip passes without a stop. A vertical segment stands alone."""
    first = 0
    for index, length in enumerate(level):
        if index == 0 or length < 1e-9 or level[index - 1] < 1e-9:
            if index > first:
                yield first, index
            first = index
    yield first, len(level)


def _split(move: Move) -> Iterator[Move]:
    """Splits a move into parts of at most _LONGEST seconds, the longest delay of a stop."""
    count = max(1, math.ceil(move.seconds / _LONGEST))
    done = (0, 0)
    for part in range(1, count + 1):
        now = (round(move.steps[0] * part / count), round(move.steps[1] * part / count))
        yield Move(move.waypoint, (now[0] - done[0], now[1] - done[1]), move.seconds / count, move.height)
        done = now


def _steps(place: NDArray[np.float64]) -> tuple[int, int]:
    """Returns the steps to the right and towards you of a position in the robot's frame (y away from you)."""
    return round(1000 * STEPS_PER_MM * float(place[0])), round(-1000 * STEPS_PER_MM * float(place[1]))


_NEEDED = Needed("pip install 'frida-painter[plotter]'", "plotink")
_SLICE = 0.02
_SERVO_PIN = 4
_MIN_VOLTAGE = 250  # reading of QC: about 9 V


@dataclass(frozen=True)
class AxidrawSettings:
    """Settings of an AxiDraw.

    home: home position of the tip, metres
    port: of the board, or its name tag; None for the first board found
    servo: two calibrated heights with pulses in units of 1/12 microsecond
    approach: m/s to the first waypoint, above 0 to 0.5
    acceleration: m/s2, above 0 to 10

    The zero of the robot's frame is the position of the carriage at the time of connection: the home corner. x
    points to the right and y away from you, so that y is negative everywhere on the table.
    Raises ConfigError if approach or acceleration is out of range.
    """

    home: Point
    port: str | None = None
    servo: Servo = field(default_factory=lambda: Servo((-0.002, 9855), (0.010, 27831)))
    approach: float = 0.15
    acceleration: float = 0.8

    def __post_init__(self) -> None:
        if not (0 < self.approach <= 0.5 and 0 < self.acceleration <= 10):
            raise ConfigError(
                f"An AxiDraw was given an approach of {self.approach} m/s and an acceleration of {self.acceleration} "
                "m/s2; they are above 0 to 0.5 m/s and above 0 to 10 m/s2."
            )


class AxidrawRobot:
    """Robot with an EiBotBoard. Implements hardware.robot.Robot.

    Its position is the count of the board's steps, so it cannot detect lost steps.
    """

    def __init__(self, settings: AxidrawSettings) -> None:
        self.settings = settings
        self._interlock = Interlock("the AxiDraw")
        self._line: SerialLine | None = None
        self._height = settings.servo.high[0]

    def connect(self) -> None:
        """Finds the board, enables the motors and raises the pen. The carriage must stand in its home corner.

        Raises RobotError if a package or the motor power is missing, RobotDisconnected if there is no board.
        """
        self.close()
        line = SerialLine.open(self._port(), 9600)
        self._interlock.mark_connected()
        try:
            version = self._ask(line, "V", ends=False)
            if not version.startswith("EBB"):
                raise RobotDisconnected(f"What answers at {line.name} is no EiBotBoard; it said {version[:60]!r}.")
            voltage = self._ask(line, "QC").partition(",")[2]
            if voltage.isdigit() and int(voltage) < _MIN_VOLTAGE:
                raise RobotError("The AxiDraw has no power for its motors; plug in its power supply.")
            self._do(line, "EM,1,1", "connect", None, time.monotonic() + PATIENCE)
            self._do(line, "CS", "connect", None, time.monotonic() + PATIENCE)
            self._lift(line, self.settings.servo.high[0], 0.0, "connect", None, time.monotonic() + PATIENCE)
        except FridaError:
            self._interlock.mark_disconnected()
            line.close()
            raise
        self._line = line

    def home(self) -> MotionReport:
        """Moves to the home position, first vertically."""
        here, aside = self.pose(), np.array(self.settings.home)
        above = np.array([here[0], here[1], max(here[2], aside[2])])
        return self.follow(Waypoints("home", np.stack((above, aside)), self.settings.approach))

    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres, from the steps made. Its height is the servo's last command."""
        line = self._ready("pose")
        try:
            return self._place(line)
        except FridaError as error:
            raise self._interlock.fault(error) from None

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Moves along the waypoints with acceleration and braking; returns when the motors stand.

        Raises ConfigError before anything moves, if the servo does not reach a height.
        Raises MotionFailed, RobotDisconnected, RobotStopped.
        """
        line = self._ready(waypoints.label)
        self._interlock.require_path(waypoints)
        started = time.monotonic()
        here = self.pose()
        todo = list(moves(here, waypoints, self.settings.approach, self.settings.acceleration))
        pulses = [round(self.settings.servo.value(move.height)) for move in todo]
        until = started + motion_timeout(sum(move.seconds for move in todo) + self._servo_seconds(todo), 1.0)
        try:
            for move, pulse in zip(todo, pulses, strict=True):
                self._make(line, move, pulse, waypoints.label, until)
            self._settle(line, waypoints.label, until)
            reached = self._place(line)
        except FridaError as error:
            self._interlock.fault(error)
            self._halt(line)
            raise
        return MotionReport(waypoints.label, started, time.monotonic(), reached)

    def stop(self) -> None:
        """Sends ES: the board drops its current and queued moves. The pen stays at its height, and the motors hold."""
        self._interlock.stop()
        if self._line is not None:
            self._halt(self._line)

    def close(self) -> None:
        """Disconnects from the board."""
        line, self._line = self._line, None
        self._interlock.mark_disconnected()
        if line is not None:
            line.close()

    def _port(self) -> str:
        try:
            from plotink import ebb_serial
        except ImportError as missing:
            raise RobotError(
                f"AxiDraws need the packages plotink and pyserial; install them with: {_NEEDED.install}"
            ) from missing
        if self.settings.port is None:
            port = ebb_serial.findPort()
            if port is None:
                raise RobotDisconnected("No AxiDraw was found; plug in its USB cable, or say which port it is at.")
        else:
            port = ebb_serial.find_named_ebb(self.settings.port) or self.settings.port
        return str(port)

    def _ready(self, label: str) -> SerialLine:
        self._interlock.require_ready(label)
        if self._line is None:
            raise RobotError(f"{label}: {self._interlock.name} is not connected; call connect() first.")
        return self._line

    def _make(self, line: SerialLine, move: Move, pulse: int, label: str, until: float) -> None:
        rise = move.height - self._height
        if rise != 0:
            # The servo moves in parallel with a move across. If only the height changes, the board waits for the
            # servo.
            wait = 0.0 if move.steps != (0, 0) else abs(rise) / self.settings.servo.speed
            self._lift(line, move.height, wait, label, move.waypoint, until, pulse)
        if move.steps != (0, 0):
            right, down = move.steps
            self._do(line, f"XM,{max(1, round(1000 * move.seconds))},{right},{down}", label, move.waypoint, until)

    def _lift(
        self, line: SerialLine, height: float, wait: float, label: str, waypoint: int | None, until: float,
        pulse: int | None = None,
    ) -> None:  # fmt: skip
        value = round(self.settings.servo.value(height)) if pulse is None else pulse
        self._do(line, f"S2,{value},{_SERVO_PIN},0,{round(1000 * wait)}", label, waypoint, until)
        self._height = height

    def _servo_seconds(self, todo: list[Move]) -> float:
        heights = np.array([self._height, *(move.height for move in todo)])
        return float(np.abs(np.diff(heights)).sum()) / self.settings.servo.speed

    def _settle(self, line: SerialLine, label: str, until: float) -> None:
        """Returns when the board reports that nothing moves and nothing is queued."""
        while True:
            answer = self._ask(line, "QM", ends=False)
            parts = answer.split(",")
            if parts[0] != "QM" or len(parts) < 4:
                raise RobotDisconnected(f"{label}: {self._interlock.name} said {answer[:60]!r}; look at its cable.")
            if all(part == "0" for part in parts[1:]):
                return
            self._heed_stop(label)
            if time.monotonic() > until:
                raise MotionFailed(
                    f"{label}: {self._interlock.name} did not arrive in time, and is stopped; look at it."
                )

    def _place(self, line: SerialLine) -> NDArray[np.float64]:
        answer = self._ask(line, "QS")
        try:
            first, second = (int(part) for part in answer.split(","))
        except ValueError:
            raise RobotDisconnected(
                f"{self._interlock.name} said {answer[:60]!r} when asked where it is; look at its cable."
            ) from None
        right, down = (first + second) / 2, (first - second) / 2
        return np.array([right / STEPS_PER_MM / 1000, -down / STEPS_PER_MM / 1000, self._height])

    def _do(self, line: SerialLine, command: str, label: str, waypoint: int | None, until: float) -> None:
        """Sends a command and waits for its "OK"."""
        self._heed_stop(label)
        line.write(command.encode("ascii") + b"\r")
        while True:
            answer = line.read(_SLICE)
            self._heed_stop(label)
            if answer == "OK":
                return
            if answer:
                where = "" if waypoint is None else f" at waypoint {waypoint}"
                raise MotionFailed(
                    f"{label}: {self._interlock.name} answered {answer[:60]!r} to {command!r}{where}, and is stopped; "
                    "look at it, then connect anew.",
                    answer[:60],
                    waypoint,
                )
            if time.monotonic() > until:
                raise RobotDisconnected(
                    f"{label}: {self._interlock.name} did not acknowledge {command!r} in time; look at it and its "
                    "cable."
                )

    def _ask(self, line: SerialLine, question: str, *, ends: bool = True) -> str:
        """Returns the board's answer to a question. ends: True if an "OK" follows the answer."""
        line.write(question.encode("ascii") + b"\r")
        answers: list[str] = []
        until = time.monotonic() + PATIENCE
        while len(answers) < (2 if ends else 1):
            answer = line.read(_SLICE)
            if answer:
                answers.append(answer)
            elif time.monotonic() > until:
                raise RobotDisconnected(
                    f"{self._interlock.name} did not answer {question} in {PATIENCE:.0f} s; look at it and at its "
                    "cable."
                )
        if answers[0].startswith("!") or (ends and answers[1] != "OK"):
            raise RobotError(f"{self._interlock.name} answered {', '.join(answers)[:80]!r} to {question}; look at it.")
        return answers[0]

    def _heed_stop(self, label: str) -> None:
        if self._interlock.stopped:
            raise RobotStopped(f"{label}: {self._interlock.name} was stopped; look at it before it is connected anew.")

    def _halt(self, line: SerialLine) -> None:
        """Sends ES on a new line, after any partial command. A lost line is ignored."""
        try:
            line.write(b"\rES\r")
        except RobotError:
            return


def _open(name: MachineName, workspace: Workspace) -> AxidrawRobot:
    name.require("servo", where=False)
    home, port, speed = require_home(name, workspace), name.where or None, workspace.travel_speed
    servo = name.choose("servo", Servo.of, None)
    if servo is None:
        return AxidrawRobot(AxidrawSettings(home, port, approach=speed))
    return AxidrawRobot(AxidrawSettings(home, port, servo, speed))


KIND = RobotKind(
    "axidraw",
    "axidraw[:PORT][,servo=Z/PULSE/Z/PULSE]",
    "AxiDraw, NextDraw and other plotters with an EBB",
    open=_open,
    needed=_NEEDED,
    identify=lambda name: at_port(name.where) if name.where else by_name(name),
)
