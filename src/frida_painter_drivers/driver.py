"""The base of drivers: the order of a motion, the way home and a stop."""

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import FridaError
from frida_painter.hardware.interlock import Interlock
from frida_painter.hardware.robot import MotionReport, Waypoints, plan_way_home


class Driver(ABC):
    """Driver of one robot behind an interlock.

    settings: with `home`, the home position of the tip in metres, and `approach`, the m/s to the first waypoint
    """

    settings: Any
    _interlock: Interlock

    @abstractmethod
    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres."""

    @abstractmethod
    def _go(self, waypoints: Waypoints) -> NDArray[np.float64]:
        """Moves along a valid path, and returns the position [3] (m) of the tip when it stands."""

    @abstractmethod
    def _halt(self) -> None:
        """Stops the machine. Raises nothing."""

    def home(self) -> MotionReport:
        """Moves to the home position, first vertically."""
        return self.follow(plan_way_home(self.pose(), self.settings.home, self.settings.approach))

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
