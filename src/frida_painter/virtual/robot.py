"""Robot of the studio: an arm moves the brush tip along its waypoints, by the studio's clock."""

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import MotionFailed, RobotDisconnected, RobotError, RobotStopped, WorkspaceViolation
from frida_painter.hardware.faults import NO_FAULTS, Faults
from frida_painter.hardware.robot import MotionReport, Waypoints
from frida_painter.hardware.timing import Timing
from frida_painter.virtual.simulation_log import Note, ignore_entry
from frida_painter.virtual.tabletop import StudioLayout, Table

# Arms: an arm gets a way and returns the course of the tip.

# seconds between checks for a stop in paced motions
_SLICE = 0.005


@dataclass(frozen=True)
class Way:
    """Order to an arm: a polyline [k, 3] in metres, from the current tip position.

    speed: speed in m/s after the first waypoint.
    travel_speed: speed in m/s to the first waypoint.
    label: name for messages.
    """

    label: str
    path: NDArray[np.float64]
    speed: float
    travel_speed: float

    def to_waypoint(self, number: int) -> "Way":
        """Returns the part of the way up to waypoint `number`; the path's first point is the start of the tip."""
        return replace(self, path=self.path[: number + 2])

    def when(self) -> NDArray[np.float64]:
        """Returns the seconds after the start [k] at each point, for a tip that always has its full speed."""
        legs = np.linalg.norm(np.diff(self.path, axis=0), axis=1) / self.speeds()
        return np.concatenate([[0.0], np.cumsum(legs)])

    def speeds(self) -> NDArray[np.float64]:
        """Returns the speed of each piece [k - 1], in m/s."""
        return np.r_[self.travel_speed, np.full(len(self.path) - 2, self.speed)]


@dataclass(frozen=True)
class Course:
    """Real motion of the tip.

    places [n, 3]: positions in metres.
    seconds: duration.
    stopped: True if the motion was stopped.
    meant [n, 3]: wanted positions at the same moments, for an arm with joints.
    angles [n, joints]: joint angles in radians, for an arm with joints. The moments are then evenly spaced.
    """

    places: NDArray[np.float64]
    seconds: float
    stopped: bool = False
    meant: NDArray[np.float64] | None = None
    angles: NDArray[np.float64] | None = None


class Watcher:
    """Observer of the arm's motions; this one does nothing."""

    def open(self) -> None:
        """Prepares, before anything moves."""

    def watch(self, course: Course) -> None:
        """Receives a finished motion; its marks are on the canvas."""

    def close(self) -> None:
        """Ends the observation."""


class Arm:
    """Arm of the studio; it knows nothing about painting, and its time passes only while it moves."""

    def connect(self, tip: NDArray[np.float64]) -> None:
        """Takes its posture with the tip at this position [3], or the remembered posture.

        Raises RobotError if that fails.
        """

    def move(self, way: Way, stopped: threading.Event, pace: float) -> Course:
        """Moves along the way; each second takes `pace` real seconds, 0 as fast as possible.

        When `stopped` is set, the arm brakes at once, and the course ends where it came to rest. Raises
        WorkspaceViolation, without moving, if it cannot go that way.
        """
        raise NotImplementedError

    def state(self) -> Sequence[float]:
        """Returns the state that the next motion depends on, apart from the tip position; empty if there is none."""
        return ()

    def remember(self, state: Sequence[float]) -> None:
        """Sets the state for the next `connect`."""

    def close(self) -> None:
        """Releases the resources of `connect`."""


class FreeArm(Arm):
    """Arm that moves the tip exactly along its way, as no real arm does.

    timing: accelerations. None: the tip always has its full speed.
    """

    def __init__(self, timing: Timing | None = None) -> None:
        self._timing = timing

    def move(self, way: Way, stopped: threading.Event, pace: float) -> Course:
        """Moves along the way; a motion without pace cannot be stopped."""
        if self._timing is None:
            path, when = way.path, way.when()
        else:
            path = self._timing.places(way.path, way.speeds())
            when = np.asarray(np.arange(len(path)) * self._timing.period, np.float64)
        if pace > 0:
            began = time.monotonic()
            while (gone := (time.monotonic() - began) / pace) < when[-1]:
                if stopped.wait(min(_SLICE, (when[-1] - gone) * pace)):
                    return _until((time.monotonic() - began) / pace, path, when)
        return Course(path, float(when[-1]))


def _until(seconds: float, path: NDArray[np.float64], when: NDArray[np.float64]) -> Course:
    """Returns the course of a path that was stopped after this time; `when` has the times of its points."""
    seconds = min(seconds, float(when[-1]))
    done = when < seconds
    here = [np.interp(seconds, when, column) for column in path.T]
    return Course(np.concatenate([path[done], [here]]), seconds, stopped=True)


_FASTEST = 1.0
_TOLERANCE = 1e-6
_SLOW = 10.0


@dataclass
class Clock:
    """Time of the studio in seconds, shared by robot, camera and paint."""

    now: float = 0.0


class VirtualRobot:
    """Robot over a table; implements hardware.robot.Robot. After `stop` it moves again only after `rearm`.

    pace: real seconds per second of its motions: 1 like a real robot, 0 as fast as possible.
    faults: faults of the robot.
    motions: number of motions that began.
    note: receives the arm's state after every motion.
    watcher: observer of the motions.
    arm: arm that holds the brush.
    """

    def __init__(self, table: Table, layout: StudioLayout, arm: Arm, clock: Clock, pace: float = 0.0) -> None:
        self.faults: Faults = NO_FAULTS
        self.motions = 0
        self.note: Note = ignore_entry
        self.watcher = Watcher()
        self.arm = arm
        self._table, self._workspace, self._clock = table, layout.workspace, clock
        self._pace = pace
        self._home = np.array(layout.home)
        self._tip = np.array(layout.home)
        self._connected = False
        self._stopped = threading.Event()

    def connect(self) -> None:
        """Switches the robot on; a second call changes nothing. Raises RobotError if its arm cannot be connected."""
        if not self._connected:
            self.arm.connect(self._tip)
            self.watcher.open()
        self._connected = True

    def remember(self, tip: NDArray[np.float64]) -> None:
        """Repeats the effects of a motion from the log that ended at `tip` [3] metres."""
        self._tip = tip.copy()
        self.motions += 1

    def rearm(self) -> None:
        """Allows motions after a stop; for a person who has looked at the robot."""
        self._stopped.clear()

    def home(self) -> MotionReport:
        """Moves to the home position, first vertically, so that the camera sees the whole canvas."""
        above = np.array([*self._tip[:2], max(self._tip[2], self._home[2])])
        return self.follow(Waypoints("home", np.stack((above, self._home)), self._workspace.travel_speed))

    def pose(self) -> NDArray[np.float64]:
        """Returns the tip position, [3] metres, also after a stop.

        Raises RobotError if the robot is not connected, RobotDisconnected if it no longer answers.
        """
        self._require_there("pose")
        return np.full(3, np.nan) if self.faults.unknown_pose else self._tip.copy()

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Moves the tip in straight lines to the first waypoint and through all others.

        Raises WorkspaceViolation, without moving, if a waypoint is outside the workspace, is not a number or is out
        of reach. Raises RobotStopped if the robot is stopped before or during the motion, RobotError if it is
        closed or fails.
        """
        self._require_there(waypoints.label)
        self._require_armed(waypoints.label)
        self._check(waypoints)
        number, self.motions = self.motions, self.motions + 1
        self._require_alive(waypoints.label, number)
        way, error = self._as_it_goes(waypoints, number)
        started = self._clock.now
        try:
            course = self.arm.move(way, self._stopped, self._pace)
        except WorkspaceViolation:
            self.motions = number  # it was not begun
            raise
        self._clock.now += course.seconds
        # The canvas gets the way as a whole, so that marks do not depend on the checks for a stop.
        self._table.move(course.places, self._clock.now, self.faults)
        self._tip = course.places[-1].copy()
        if state := self.arm.state():
            self.note({"did": "arm", "state": list(state)})
        self.watcher.watch(course)
        if course.stopped:
            self._require_armed(waypoints.label)
        if error is not None:
            raise error
        reached = waypoints.position[-1] if number in self.faults.lying_motions else self._tip
        return MotionReport(waypoints.label, started, self._clock.now, reached.copy())

    def stop(self) -> None:
        """Stops the robot until `rearm`."""
        self._stopped.set()

    def close(self) -> None:
        """Switches the robot off, and closes the observer."""
        if self._connected:
            self.arm.close()
            self.watcher.close()
        self._connected = False

    def _as_it_goes(self, waypoints: Waypoints, number: int) -> tuple[Way, RobotError | None]:
        """Returns the real way of motion `number`, and the error at its end, if a fault happens."""
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
