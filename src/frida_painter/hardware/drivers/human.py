"""`human`: a person's own hand in the place of a robot, as the easel's process sees it.

Whoever talks with the person asks for a motion first and sends it here when it is done
(session/by_hand.py), so that stops, locks, clocks and records are those of any other robot.
"""

import time

import numpy as np
from numpy.typing import NDArray

from frida_painter.hardware.drivers.interlock import Interlock
from frida_painter.hardware.robot import MotionReport, Waypoints
from frida_painter.hardware.workspace import Point


class HumanRobot:
    """Implements hardware.robot.Robot: believes that what is sent to it has been done."""

    def __init__(self, home: Point) -> None:
        self._home = np.array(home)
        self._tip = self._home
        self._interlock = Interlock("the person")

    def connect(self) -> None:
        """Begins with the hand aside."""
        self._tip = self._home
        self._interlock.opened()

    def home(self) -> MotionReport:
        """The hand is out of the camera's sight."""
        return self.follow(Waypoints("home", self._home[None], 1.0))

    def pose(self) -> NDArray[np.float64]:
        """Where the hand was last, [3] metres."""
        self._interlock.require_ready("pose")
        return self._tip.copy()

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Takes note that the person has done it. Raises RobotStopped, MotionFailed where it is no path."""
        self._interlock.require_ready(waypoints.label)
        self._interlock.require_path(waypoints)
        self._tip = waypoints.position[-1].copy()
        now = time.monotonic()
        return MotionReport(waypoints.label, now, now, self._tip.copy())

    def stop(self) -> None:
        """Nothing more is taken note of; what stops a hand is the person."""
        self._interlock.stop()

    def close(self) -> None:
        """Lets go."""
        self._interlock.closed()
