"""The base of drivers: connection, examination, the order of a motion, the way home and a stop."""

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import ConfigError, FridaError
from frida_painter.hardware.interlock import Failure, Interlock
from frida_painter.hardware.robot import (
    Examination,
    LimitedRobot,
    MachineFact,
    MotionReport,
    Point,
    Waypoints,
    ZeroedRobot,
    plan_way_home,
)
from frida_painter.hardware.timing import AxisTiming


class Driver(ABC):
    """Driver of one robot behind an interlock. Implements Robot, TimedRobot and ExaminedRobot.

    name: of the robot, in messages
    resting: home position of the tip, metres
    approach: m/s to the first waypoint of a motion; raises ConfigError if it is not allowed
    """

    def __init__(self, name: str, resting: Point, approach: float) -> None:
        self._interlock = Interlock(name)
        self._require_between("an approach", approach, 1e-4, 1.0, "m/s")
        self.resting, self.approach = resting, approach
        self._alive = -math.inf

    @abstractmethod
    def _open(self, *, examines: bool) -> None:
        """Opens the connection and makes the machine ready; at an error, `close` follows.

        examines: True to change nothing in the machine, and to accept one that is not ready
        """

    @abstractmethod
    def close(self) -> None:
        """Disconnects from the robot; a second call does nothing."""

    @abstractmethod
    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres."""

    @abstractmethod
    def timing(self) -> AxisTiming | None:
        """Returns the limits of its motions; None if they are not known."""

    @abstractmethod
    def _facts(self) -> Iterator[MachineFact]:
        """Yields what the open machine tells, for a person."""

    @abstractmethod
    def _go(self, waypoints: Waypoints) -> NDArray[np.float64]:
        """Moves along a valid path, and returns the position [3] (m) of the tip when it stands."""

    @abstractmethod
    def _halt(self) -> None:
        """Stops the machine. Raises nothing."""

    def connect(self) -> None:
        """Connects to the robot and makes it ready. A failed attempt leaves nothing open.

        Raises RobotDisconnected if nobody answers, RobotError if a package is missing or the robot is not ready,
        MotionFailed if it has a fault, which only a person clears.
        """
        with self._opening():
            self._open(examines=False)

    def examine(self) -> Examination:
        """Connects, reads everything that the machine tells, and disconnects; moves and changes nothing."""
        with self._opening():
            self._open(examines=True)
            limits = self.travel_limits() if isinstance(self, LimitedRobot) else None
            homes = isinstance(self, ZeroedRobot) and self.zero().homes
            told = Examination(tuple(self._facts()), self.timing(), limits, homes)
        self.close()
        return told

    def alive_at(self) -> float:
        """Returns the time (s, steady) when the machine last showed that it moves or waits."""
        return self._alive

    def home(self) -> MotionReport:
        """Moves to the home position, first vertically."""
        return self.follow(plan_way_home(self.pose(), self.resting, self.approach))

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Moves along the waypoints; returns when the machine stands, with its position.

        Raises MotionFailed, RobotDisconnected, or RobotStopped if it was stopped here or at the machine. The machine
        is then stopped, and blocked until it is connected anew.
        """
        self._require_way(waypoints)
        started = time.monotonic()
        with self._moving():
            reached = self._go(waypoints)
        return MotionReport(waypoints.label, started, time.monotonic(), reached)

    def stop(self) -> None:
        """Stops the machine at once; it forgets its remaining motions."""
        self._interlock.stop()
        self._halt()

    @contextmanager
    def _opening(self) -> Iterator[None]:
        """Marks the robot as connected; an error within closes it again."""
        self.close()
        self._interlock.mark_connected()
        try:
            yield
        except BaseException:
            self.close()
            raise

    def _require_way(self, waypoints: Waypoints) -> None:
        """Raises RobotError if the robot is not ready, MotionFailed if the waypoints are no valid path."""
        self._interlock.require_ready(waypoints.label)
        self._interlock.require_path(waypoints)

    @contextmanager
    def _moving(self) -> Iterator[None]:
        """Within it, an error blocks all further motions and stops the machine."""
        try:
            yield
        except FridaError as error:
            self._interlock.fault(error)
            self._halt()
            raise

    def _failure(self, kind: type[Failure], label: str, said: str, *more: Any) -> Failure:
        """Returns an error that names the motion and the robot."""
        return self._interlock.failure(kind, label, said, *more)

    def _require_between(self, what: str, value: float, low: float, high: float, unit: str) -> None:
        """Raises ConfigError unless a setting is from `low` to `high`."""
        if not low <= value <= high:
            raise ConfigError(
                f"{self._interlock.name} was given {what} of {value:g} {unit}; it is from {low:g} to {high:g} {unit}."
            )
