"""The interlock inside every driver: permits motions only while the driver is connected and has no fault or stop.

The interlock belongs to one driver. It stands between the driver and the maker's library and knows whether this
connection is open, at fault or stopped. It forgets that when the driver connects again.

The guard (easel/guard.py) is a different layer: it wraps a whole robot in the easel's process and trusts no driver.
"""

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np

from frida_painter.errors import FridaError, MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.deadline import in_our_errors, one_line, within
from frida_painter.hardware.robot import Waypoints

Answer = TypeVar("Answer")
Failure = TypeVar("Failure", bound=FridaError)
PATIENCE = 5.0
"""Seconds within which any machine answers a question that moves nothing."""


class Interlock:
    """Interlock of one driver: permits calls while the robot is connected, has no fault and was not stopped.

    name: of the robot, in messages

    After a fault or a stop the driver must be closed and connected again, by a person who has looked at the robot.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._stopped = threading.Event()
        self._open = False
        self._fault = ""

    @property
    def stopped(self) -> bool:
        """True if a stop was requested since the robot was connected."""
        return self._stopped.is_set()

    def mark_connected(self) -> None:
        """Marks the robot as connected, without fault and not stopped."""
        self._open, self._fault = True, ""
        self._stopped.clear()

    def mark_disconnected(self) -> None:
        """Marks the robot as disconnected."""
        self._open = False

    def stop(self) -> None:
        """Blocks all motions from now on. Never waits; may be called from any thread, repeatedly."""
        self._stopped.set()

    def fault(self, error: FridaError) -> FridaError:
        """Blocks all motions from now on because of `error`, and returns `error` to be raised."""
        self._fault = self._fault or str(error)
        return error

    def failure(self, kind: type[Failure], label: str, said: str, *more: Any) -> Failure:
        """Returns an error of the robot: "LABEL: ROBOT SAID". more: of the error's kind, such as a code"""
        return kind(f"{label}: {self.name} {said}", *more)

    @contextmanager
    def blocking(self) -> Iterator[None]:
        """Within it, an error blocks all motions from now on."""
        try:
            yield
        except FridaError as error:
            raise self.fault(error) from None

    def require_ready(self, label: str) -> None:
        """Raises RobotStopped after a stop, RobotError after a fault or if the robot is not connected."""
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

    def heed_stop(self, label: str) -> None:
        """Raises RobotStopped if a stop came during a motion."""
        if self._stopped.is_set():
            raise RobotStopped(f"{label}: {self.name} was stopped; look at it before it is connected anew.")

    def require_path(self, waypoints: Waypoints) -> None:
        """Raises MotionFailed, before anything is sent, if the waypoints are no valid path."""
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
        """Returns the result of a call into the maker's library, with a deadline of `seconds`.

        An overdue call is left in a thread that does not keep the program alive.
        Raises RobotDisconnected if the call is overdue, RobotError for any exception of the library, and
        FridaErrors unchanged. Each of them blocks all further motions.
        """
        try:
            return in_our_errors(
                lambda: within(seconds, f"{self.name}: {what}", call),
                late=lambda: RobotDisconnected(
                    f"{what}: {self.name} did not answer within {seconds:.0f} s; look at it and at its cable."
                ),
                failed=lambda why: RobotError(f"{what}: {self.name} failed ({why}); look at it before going on."),
            )
        except BaseException as error:  # also KeyboardInterrupt: the machine is then in an unknown state
            self._fault = self._fault or (str(error) if isinstance(error, FridaError) else one_line(error))
            raise


def motion_timeout(path: float, speed: float) -> float:
    """Returns the time limit in seconds of a motion over `path` metres at `speed` m/s: twice its duration plus five."""
    return 2 * path / speed + PATIENCE
