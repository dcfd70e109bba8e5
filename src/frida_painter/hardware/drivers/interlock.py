"""The interlock inside every driver: it lets a motion through only while nothing stands against it.

There are two such layers, and they are two ideas. This one is part of one driver: it stands between
the driver and the library of its maker, and knows whether that one connection is open, at fault or
stopped; it forgets all of that when the driver connects anew. The guard (easel/guard.py) stands
around a whole robot in the easel's process and trusts no driver: it checks motions against the
workspace, gives the driver itself a deadline, and latches a stop over restarts until a person re-arms.
What both need, deadlines and errors with a name, is in hardware/deadline.py.
"""

import math
import threading
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from frida_painter.errors import FridaError, MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.deadline import in_our_errors, one_line, within
from frida_painter.hardware.robot import Waypoints

Answer = TypeVar("Answer")
PATIENCE = 5.0
"""Seconds within which any machine answers any question that moves nothing."""


class Interlock:
    """Closed while the robot is connected, has no fault and was not stopped; otherwise it lets nothing through.

    name: of the robot, in messages. After a fault or a stop the driver has to be closed and connected
    anew, which is for the person who has looked.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._stopped = threading.Event()
        self._open = False
        self._fault = ""

    @property
    def stopped(self) -> bool:
        """Whether somebody has asked to stop since the robot was connected."""
        return self._stopped.is_set()

    def opened(self) -> None:
        """The robot is connected, and nothing has gone wrong yet."""
        self._open, self._fault = True, ""
        self._stopped.clear()

    def closed(self) -> None:
        """The robot is not connected any more."""
        self._open = False

    def stop(self) -> None:
        """Lets nothing through from now on. Never waits; may be called from any thread and again."""
        self._stopped.set()

    def fault(self, error: FridaError) -> FridaError:
        """Lets nothing through from now on, because of `error`, which is given back to be raised."""
        self._fault = self._fault or str(error)
        return error

    def require_ready(self, label: str) -> None:
        """Raises RobotStopped after a stop, RobotError after a fault or where the robot is not connected."""
        if self._stopped.is_set():
            raise RobotStopped(
                f"{label}: {self.name} was stopped; look at it, then close the connection and connect it anew."
            )
        if self._fault:
            raise RobotError(
                f"{label}: {self.name} does not move after its last fault ({self._fault}); look at it, then close "
                "the connection and connect it anew."
            )
        if not self._open:
            raise RobotError(f"{label}: {self.name} is not connected; call connect() first.")

    def require_path(self, waypoints: Waypoints) -> None:
        """Raises MotionFailed, before anything is sent, where the waypoints are no path at all."""
        position = waypoints.position
        if position.ndim != 2 or position.shape[1] != 3 or len(position) == 0 or not np.isfinite(position).all():
            raise MotionFailed(
                f"{waypoints.label}: {self.name} was given waypoints of shape {position.shape} or numbers that are "
                "not finite; one or more (x, y, z) in metres are needed. It did not move."
            )
        if not 0 < waypoints.speed < math.inf:
            raise MotionFailed(
                f"{waypoints.label}: {self.name} was given a speed of {waypoints.speed} m/s; it is above 0 and "
                "finite. It did not move."
            )

    def asking(self, what: str, call: Callable[[], Answer], seconds: float = PATIENCE) -> Answer:
        """What a call into the maker's library returns, if it does so within `seconds`.

        A call that does not return is left behind in a thread that does not keep the program alive.
        Raises RobotDisconnected where it does not return in time, RobotError for whatever it raises;
        errors of our own tree pass. Either way nothing more is let through.
        """
        try:
            return in_our_errors(
                lambda: within(seconds, f"{self.name}: {what}", call),
                late=lambda: RobotDisconnected(
                    f"{what}: {self.name} did not answer within {seconds:.0f} s; look at it and at its cable."
                ),
                failed=lambda why: RobotError(f"{what}: {self.name} failed ({why}); look at it before going on."),
            )
        except BaseException as error:  # a person who interrupts the wait leaves the machine in some unknown state, too
            self._fault = self._fault or (str(error) if isinstance(error, FridaError) else one_line(error))
            raise


def time_allowed(path: float, speed: float) -> float:
    """Seconds within which a motion over `path` metres at `speed` m/s is done: twice what it takes, and five more."""
    return 2 * path / speed + PATIENCE
