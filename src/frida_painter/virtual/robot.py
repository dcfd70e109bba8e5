"""The studio's robot: an arm moves the tip along its waypoints, and its clock is the studio's."""

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import MotionFailed, RobotDisconnected, RobotError, RobotStopped, WorkspaceViolation
from frida_painter.hardware.robot import MotionReport, Timing, Waypoints
from frida_painter.virtual.faults import NO_FAULTS, Faults
from frida_painter.virtual.simulation_log import Note, unnoted
from frida_painter.virtual.table import StudioLayout, Table

# What carries the brush's tip in the studio: an arm gets a way to go, and tells the way it really went.

# In its own pace an arm heeds a stop this often, s.
_SLICE = 0.005


@dataclass(frozen=True)
class Way:
    """What an arm is asked to do: a polyline [k, 3] in metres from where the tip is.

    The first piece, towards the first waypoint, is gone at `travel_speed` m/s, the others at `speed`.
    label says in messages what it is for.
    """

    label: str
    path: NDArray[np.float64]
    speed: float
    travel_speed: float

    def to_waypoint(self, number: int) -> "Way":
        """What of it leads to waypoint `number`; the first point of the path is where the tip was."""
        return replace(self, path=self.path[: number + 2])

    def when(self) -> NDArray[np.float64]:
        """Seconds after the start [k] at which each point is reached by a tip that always has its full speed."""
        legs = np.linalg.norm(np.diff(self.path, axis=0), axis=1) / self.speeds()
        return np.concatenate([[0.0], np.cumsum(legs)])

    def speeds(self) -> NDArray[np.float64]:
        """The speed asked for [k - 1] on each piece, m/s."""
        return np.r_[self.travel_speed, np.full(len(self.path) - 2, self.speed)]


@dataclass(frozen=True)
class Course:
    """What the tip really did: its places [n, 3] in metres, how many seconds that took, whether it was stopped.

    An arm with joints also tells, for each of these places, where the tip was meant to be at that
    moment, and the angles of its joints [n, joints] (rad); these moments are then evenly spaced.
    """

    places: NDArray[np.float64]
    seconds: float
    stopped: bool = False
    meant: NDArray[np.float64] | None = None
    angles: NDArray[np.float64] | None = None


class Watcher(Protocol):
    """Whoever looks on while an arm works."""

    def open(self) -> None:
        """Gets ready, before anything moves."""

    def watch(self, course: Course) -> None:
        """Sees a motion that has just been made, with what it left on the canvas."""

    def close(self) -> None:
        """Has seen enough."""


class Nobody:
    """Looks on where nobody does."""

    def open(self) -> None:
        """Needs nothing."""

    def watch(self, course: Course) -> None:
        """Sees nothing."""

    def close(self) -> None:
        """Nothing was seen."""


class Arm(Protocol):
    """An arm of the studio; it knows nothing of painting, and time only passes in it while it moves."""

    def connect(self, tip: NDArray[np.float64]) -> None:
        """Takes its posture with the tip there [3], or as it was remembered. Raises RobotError where it cannot."""

    def move(self, way: Way, stopped: threading.Event, pace: float) -> Course:
        """Goes that way, each second of it in `pace` seconds of the world's, 0 as fast as can be computed.

        Once `stopped` is set it brakes at once, and the course ends where it came to rest. Raises
        WorkspaceViolation, without moving, where it cannot go that way.
        """

    def state(self) -> Sequence[float]:
        """All that the next motion follows from, beside where the tip is; empty where nothing does."""

    def remember(self, state: Sequence[float]) -> None:
        """Takes up, when it is connected next, from that state."""

    def close(self) -> None:
        """Lets go of what `connect` took."""


class FreeArm:
    """Carries the tip exactly along its way, as no real arm does.

    timing: how it starts and stops; None: it always has the speed asked for.
    """

    def __init__(self, timing: Timing | None = None) -> None:
        self._timing = timing

    def connect(self, tip: NDArray[np.float64]) -> None:
        """There is nothing to be done."""

    def move(self, way: Way, stopped: threading.Event, pace: float) -> Course:
        """Goes that way; where it takes no time there is none to be stopped in."""
        path, when = self._schedule(way)
        if pace > 0:
            began = time.monotonic()
            while (gone := (time.monotonic() - began) / pace) < when[-1]:
                if stopped.wait(min(_SLICE, (when[-1] - gone) * pace)):
                    return _until((time.monotonic() - began) / pace, path, when)
        return Course(path, float(when[-1]))

    def state(self) -> Sequence[float]:
        """Nothing beside the tip."""
        return ()

    def remember(self, state: Sequence[float]) -> None:
        """There is nothing to be remembered."""

    def close(self) -> None:
        """There is nothing to let go of."""

    def _schedule(self, way: Way) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Points [k, 3] of the way, and when (s) [k] the tip is there."""
        if self._timing is None:
            return way.path, way.when()
        places = self._timing.places(way.path, way.speeds())
        return places, np.asarray(np.arange(len(places)) * self._timing.period, np.float64)


def _until(seconds: float, path: NDArray[np.float64], when: NDArray[np.float64]) -> Course:
    """What of a path, whose points are reached at `when`, is done by a stop after that time."""
    seconds = min(seconds, float(when[-1]))
    done = when < seconds
    here = [np.interp(seconds, when, column) for column in path.T]
    return Course(np.concatenate([path[done], [here]]), seconds, stopped=True)


_FASTEST = 1.0
_TOLERANCE = 1e-6
_SLOW = 10.0


@dataclass
class Clock:
    """The studio's time in seconds, the same for robot, camera and paint."""

    now: float = 0.0


class VirtualRobot:
    """Implements hardware.robot.Robot over a table. After `stop` it moves again only when it is re-armed.

    pace: seconds that a second of its motions really takes: 1 moves as a robot would, 0 as fast as can
    be computed. faults, motions: what goes wrong, and how many motions were begun; note: told of the
    state of the arm after every motion; watcher: looks on.
    """

    def __init__(self, table: Table, layout: StudioLayout, arm: Arm, clock: Clock, pace: float = 0.0) -> None:
        self.faults: Faults = NO_FAULTS
        self.motions = 0
        self.note: Note = unnoted
        self.watcher: Watcher = Nobody()
        self._table, self._workspace, self._arm, self._clock = table, layout.workspace, arm, clock
        self._pace = pace
        self._home = np.array(layout.home)
        self._tip = np.array(layout.home)
        self._connected = False
        self._stopped = threading.Event()

    def connect(self) -> None:
        """Switches the robot on; doing it twice changes nothing. Raises RobotError where its arm cannot be had."""
        if not self._connected:
            self._arm.connect(self._tip)
            self.watcher.open()
        self._connected = True

    def remember(self, tip: NDArray[np.float64]) -> None:
        """Takes up after a motion of which the log tells, which ended at `tip` [3] metres."""
        self._tip = tip.copy()
        self.motions += 1

    def remember_arm(self, state: list[float]) -> None:
        """Takes up with the arm in the state of which the log tells."""
        self._arm.remember(state)

    def rearm(self) -> None:
        """Allows motions again after a stop; for the person who has looked."""
        self._stopped.clear()

    def home(self) -> MotionReport:
        """Goes aside by way of hover height, so that the camera sees the whole canvas."""
        above = np.array([*self._tip[:2], max(self._tip[2], self._home[2])])
        return self.follow(Waypoints("home", np.stack((above, self._home)), self._workspace.travel_speed))

    def pose(self) -> NDArray[np.float64]:
        """Where the tip is, [3] metres, also of a robot that was stopped. Raises RobotError where it is not there."""
        self._require_there("pose")
        return np.full(3, np.nan) if self.faults.unknown_pose else self._tip.copy()

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Moves the tip in straight lines to the first waypoint and on through all of them.

        Raises WorkspaceViolation, without moving, where one lies outside the workspace, is not a number
        or is out of the arm's reach; RobotStopped where the robot is or becomes stopped; RobotError
        where it is closed or fails.
        """
        self._require_there(waypoints.label)
        self._require_armed(waypoints.label)
        self._check(waypoints)
        number, self.motions = self.motions, self.motions + 1
        self._require_alive(waypoints.label, number)
        way, error = self._as_it_goes(waypoints, number)
        started = self._clock.now
        try:
            course = self._arm.move(way, self._stopped, self._pace)
        except WorkspaceViolation:
            self.motions = number  # it was not begun
            raise
        self._clock.now += course.seconds
        # The brush feels the way as a whole: what it leaves does not depend on how often a stop is looked for.
        self._table.move(course.places, self._clock.now, self.faults)
        self._tip = course.places[-1].copy()
        if state := self._arm.state():
            self.note({"did": "arm", "state": list(state)})
        self.watcher.watch(course)
        if course.stopped:
            self._require_armed(waypoints.label)
        if error is not None:
            raise error
        reached = waypoints.position[-1] if number in self.faults.lying_motions else self._tip
        return MotionReport(waypoints.label, started, self._clock.now, reached.copy())

    def stop(self) -> None:
        """Stops, and stays stopped until `rearm`."""
        self._stopped.set()

    def close(self) -> None:
        """Switches the robot off; whoever looked on has seen all."""
        if self._connected:
            self._arm.close()
            self.watcher.close()
        self._connected = False

    def _as_it_goes(self, waypoints: Waypoints, number: int) -> tuple[Way, RobotError | None]:
        """The way that motion `number` takes, and the error with which it ends, where something goes wrong."""
        faults, label = self.faults, waypoints.label
        slowness = _SLOW if number in faults.slow_motions else 1.0
        path = np.concatenate([self._tip[None], waypoints.position])
        way = Way(label, path, waypoints.speed / slowness, self._workspace.travel_speed / slowness)
        halfway = way.to_waypoint(max(0, len(path) // 2 - 2))
        if number in faults.hanging_motions:
            threading.Event().wait()
        for failure in faults.failed_motions:
            if failure.motion == number:
                message = (
                    f"{label}: the virtual robot ended with error {failure.code} at waypoint {failure.waypoint}; "
                    "look at it before going on."
                )
                return way.to_waypoint(failure.waypoint), MotionFailed(message, failure.code, failure.waypoint)
        if number in faults.protective_stops:
            return halfway, RobotStopped(f"{label}: the virtual robot met with resistance and stopped by itself.")
        if number in faults.stuck_motions | faults.lying_motions:
            return halfway, None
        return way, None

    def _require_there(self, label: str) -> None:
        if not self._connected:
            raise RobotError(f"{label}: the virtual robot is not connected; call connect() first.")
        self._require_alive(label, self.motions - 1)

    def _require_alive(self, label: str, number: int) -> None:
        if self.faults.dead_from_motion is not None and number >= self.faults.dead_from_motion:
            raise RobotDisconnected(f"{label}: the virtual robot does not answer any more; look at it before going on.")

    def _require_armed(self, label: str) -> None:
        if self._stopped.is_set():
            raise RobotStopped(f"{label}: the virtual robot was stopped; look at it, then re-arm it.")

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
