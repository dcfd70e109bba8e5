"""The studio's robot: it moves the tip exactly along its waypoints, and its clock is the studio's."""

import threading
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import RobotError, WorkspaceViolation
from frida_painter.hardware.robot import MotionReport, Waypoints
from frida_painter.hardware.workspace import Point, Workspace
from frida_painter.virtual.faults import NO_FAULTS, Faults
from frida_painter.virtual.table import Table

_FASTEST = 1.0
_TOLERANCE = 1e-6


@dataclass
class Clock:
    """The studio's time in seconds, the same for robot, camera and paint."""

    now: float = 0.0


class VirtualRobot:
    """Implements hardware.robot.Robot over a table. After `stop` it moves again only when it is re-armed."""

    def __init__(self, table: Table, workspace: Workspace, home: Point, clock: Clock) -> None:
        self.faults: Faults = NO_FAULTS
        self.motions = 0
        self._table, self._workspace, self._home, self._clock = table, workspace, np.array(home), clock
        self._tip = np.array(home)
        self._connected = False
        self._stopped = threading.Event()

    def connect(self) -> None:
        """Switches the robot on; doing it twice changes nothing."""
        self._connected = True

    def remember(self, tip: NDArray[np.float64]) -> None:
        """Takes up after a motion of which the diary tells, which ended at `tip` [3] metres."""
        self._tip = tip.copy()
        self.motions += 1

    def rearm(self) -> None:
        """Allows motions again after a stop; for the person who has looked."""
        self._stopped.clear()

    def home(self) -> MotionReport:
        """Goes aside by way of hover height, so that the camera sees the whole canvas."""
        above = np.array([*self._tip[:2], max(self._tip[2], self._home[2])])
        return self.follow(Waypoints("home", np.stack((above, self._home)), self._workspace.travel_speed))

    def pose(self) -> NDArray[np.float64]:
        """Where the tip is, [3] metres. Raises RobotError where the robot is not there."""
        self._require_alive("pose")
        return self._tip.copy()

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Moves the tip in straight lines to the first waypoint and on through all of them.

        Raises WorkspaceViolation, without moving, where one lies outside the workspace or is not a
        number; RobotError where the robot is stopped, closed or dead.
        """
        self._require_alive(waypoints.label)
        self._check(waypoints)
        number, self.motions = self.motions, self.motions + 1
        if self.faults.dead_from_motion is not None and number >= self.faults.dead_from_motion:
            raise RobotError(
                f"{waypoints.label}: the virtual robot does not answer any more; look at it before going on."
            )
        path = np.concatenate([self._tip[None], waypoints.position])
        if number in self.faults.stuck_motions:
            path = path[: max(2, len(path) // 2)]
        started = self._clock.now
        approach = float(np.linalg.norm(path[1] - path[0])) / self._workspace.travel_speed
        along = float(np.linalg.norm(np.diff(path[1:], axis=0), axis=1).sum()) / waypoints.speed
        self._clock.now += approach + along
        self._table.move(path, self._clock.now, self.faults)
        self._tip = path[-1].copy()
        return MotionReport(waypoints.label, started, self._clock.now, self._tip.copy())

    def stop(self) -> None:
        """Stops, and stays stopped until `rearm`."""
        self._stopped.set()

    def close(self) -> None:
        """Switches the robot off."""
        self._connected = False

    def _require_alive(self, label: str) -> None:
        if not self._connected:
            raise RobotError(f"{label}: the virtual robot is not connected; call connect() first.")
        if self._stopped.is_set():
            raise RobotError(f"{label}: the virtual robot was stopped; look at it, then re-arm it.")
        if self.faults.dead_from_motion is not None and self.motions > self.faults.dead_from_motion:
            raise RobotError(f"{label}: the virtual robot does not answer any more; look at it before going on.")

    def _check(self, waypoints: Waypoints) -> None:
        position = waypoints.position
        if position.ndim != 2 or position.shape[1] != 3 or len(position) == 0:
            raise WorkspaceViolation(
                f"{waypoints.label}: waypoints of shape {position.shape} were sent; one or more (x, y, z) are needed."
            )
        if not 0 < waypoints.speed <= _FASTEST:
            raise WorkspaceViolation(
                f"{waypoints.label}: {waypoints.speed} m/s was asked for; allowed is above 0 to {_FASTEST} m/s."
            )
        lower, upper = np.array(self._workspace.lower), np.array(self._workspace.upper)
        inside = (position >= lower - _TOLERANCE) & (position <= upper + _TOLERANCE)
        if not inside.all():
            point, axis = np.argwhere(~inside)[0]
            raise WorkspaceViolation(
                f"{waypoints.label}: waypoint {point} has {'xyz'[axis]} = {position[point, axis]:g} m; the virtual "
                f"robot reaches from {lower[axis]:g} to {upper[axis]:g} m. It did not move; plan inside its workspace."
            )
