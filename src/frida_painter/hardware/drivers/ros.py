"""Robots behind ROS: arms that follow Cartesian trajectories of the brush's tip, over four topics of stock messages.

docs/how-to/ros.md specifies the arm's node. ros_connections.py has the connections: RospyConnection to a ROS 1
master, and RosbridgeConnection to any ROS behind a rosbridge server.
"""

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import ConfigError, FridaError, MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.drivers.interlock import PATIENCE, Interlock, motion_timeout
from frida_painter.hardware.kinds import MachineName, require_home
from frida_painter.hardware.robot import MotionReport, Point, Waypoints, Workspace

Message = Mapping[str, Any]
"""ROS message as nested mappings from field names to values."""

FOLLOW, STATUS, POSE, STOP = (
    ("follow", "trajectory_msgs/MultiDOFJointTrajectory"),
    ("status", "actionlib_msgs/GoalStatus"),
    ("pose", "geometry_msgs/PoseStamped"),
    ("stop", "std_msgs/Empty"),
)
TIP = "brush_tip"
_ACTIVE, _PREEMPTED, _SUCCEEDED, _ABORTED, _REJECTED = 1, 2, 3, 4, 5
_UPRIGHT = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
_SILENCE = 2.0
_POLL = 0.02


class RosConnection(Protocol):
    """Connection to ROS."""

    def open(self) -> None:
        """Connects. Raises RobotDisconnected or RobotError, and then leaves nothing open."""

    def hear(self, topic: str, kind: str, tell: Callable[[Message], None]) -> None:
        """Calls `tell` with every message of a topic, in a separate thread."""

    def announce(self, topic: str, kind: str) -> None:
        """Announces that messages will be published on a topic."""

    def is_heard(self, topic: str) -> bool:
        """Returns True if somebody listens to an announced topic, as far as that can be known."""

    def publish(self, topic: str, message: Message) -> None:
        """Sends a message now; it is never kept for later. Raises RobotDisconnected."""

    def close(self) -> None:
        """Disconnects; a second call does nothing."""


@dataclass(frozen=True)
class RosSettings:
    """Settings of a robot behind ROS.

    home: home position of the tip, metres
    approach: m/s to the first waypoint, above 0 to 1
    namespace: of the four topics, begins with "/"
    frame: coordinate frame of the waypoints
    ros: 1 or 2; the two name the fields of a time differently

    Raises ConfigError if a value is not allowed.
    """

    home: Point
    approach: float = 0.1
    namespace: str = "/brush"
    frame: str = "base"
    ros: int = 1

    def __post_init__(self) -> None:
        if not 0 < self.approach <= 1 or self.ros not in (1, 2) or not self.namespace.startswith("/"):
            raise ConfigError(
                f"A ROS arm was given an approach of {self.approach} m/s, ROS {self.ros} and the namespace "
                f"{self.namespace!r}; they are above 0 to 1 m/s, 1 or 2, and a name that begins with a slash."
            )


class RosRobot:
    """Robot behind ROS. Implements hardware.robot.Robot. Stops use a separate connection."""

    def __init__(self, settings: RosSettings, connection: RosConnection, stopper: RosConnection) -> None:
        self.settings = settings
        self._connection, self._stopper = connection, stopper
        self._interlock = Interlock(f"the arm behind ROS at {settings.namespace}")
        self._news = threading.Condition()
        self._tip: NDArray[np.float64] | None = None
        self._heard_at = float("-inf")
        self._goal: tuple[int, int] = (0, 0)
        self._status: tuple[int, str] | None = None
        self._nonsense = ""

    def connect(self) -> None:
        """Opens both connections and waits until the arm reports its pose and listens. Moves nothing.

        Raises RobotDisconnected if there is no ROS, or no arm behind it; RobotError if a package is missing.
        """
        self.close()
        self._tip, self._heard_at, self._nonsense = None, float("-inf"), ""
        try:
            for connection in (self._stopper, self._connection):
                connection.open()
            self._stopper.announce(self._topic(STOP), STOP[1])
            self._connection.announce(self._topic(FOLLOW), FOLLOW[1])
            self._connection.hear(self._topic(POSE), POSE[1], self._hear_pose)
            self._connection.hear(self._topic(STATUS), STATUS[1], self._hear_status)
            self._await_arm()
        except FridaError:
            self.close()
            raise
        self._interlock.mark_connected()

    def home(self) -> MotionReport:
        """Moves to the home position, first vertically."""
        here, aside = self.pose(), np.array(self.settings.home)
        above = np.array([here[0], here[1], max(here[2], aside[2])])
        return self.follow(Waypoints("home", np.stack((above, aside)), self.settings.approach))

    def pose(self) -> NDArray[np.float64]:
        """Returns the tip's last reported position, [3] metres. Raises RobotDisconnected if the report is too old."""
        self._interlock.require_ready("pose")
        try:
            return self._place("pose")
        except RobotError as error:
            raise self._interlock.fault(error) from None

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Sends the waypoints with their times; returns when the arm reports success.

        Raises MotionFailed, RobotDisconnected, RobotError, or RobotStopped if it was stopped here or at the arm.
        The arm is then told to stop.
        """
        self._interlock.require_ready(waypoints.label)
        self._interlock.require_path(waypoints)
        started = time.monotonic()
        try:
            here = self._place(waypoints.label)
            path = np.concatenate([here[None], waypoints.position])
            steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
            seconds = np.cumsum(steps / np.r_[self.settings.approach, np.full(len(steps) - 1, waypoints.speed)])
            self._send(waypoints, seconds)
            self._await_end(waypoints.label, started + motion_timeout(float(seconds[-1]), 1.0))
            reached = self._place_after(waypoints.label, time.monotonic())
        except FridaError as error:
            self._interlock.fault(error)
            self._halt()
            raise
        return MotionReport(waypoints.label, started, time.monotonic(), reached)

    def stop(self) -> None:
        """Tells the arm to stop, over the connection for stops. A `follow` in progress ends."""
        self._interlock.stop()
        self._halt()
        with self._news:
            self._news.notify_all()

    def close(self) -> None:
        """Closes both connections."""
        self._interlock.mark_disconnected()
        for connection in (self._connection, self._stopper):
            with suppress(RobotError):  # A connection that does not close in time is abandoned.
                connection.close()

    def _topic(self, of: tuple[str, str]) -> str:
        return f"{self.settings.namespace.rstrip('/')}/{of[0]}"

    def _await_arm(self) -> None:
        until = time.monotonic() + PATIENCE
        while self._tip is None or not self._is_heard():
            if time.monotonic() > until:
                missing = (
                    f"says on {self._topic(POSE)} where it is" if self._tip is None
                    else f"listens to {self._topic(FOLLOW)} and {self._topic(STOP)}"
                )  # fmt: skip
                raise RobotDisconnected(
                    f"There is ROS, but no arm in it {missing} (waited {PATIENCE:.0f} s); start the arm's node, or "
                    "correct the namespace."
                )
            time.sleep(_POLL)

    def _is_heard(self) -> bool:
        return self._connection.is_heard(self._topic(FOLLOW)) and self._stopper.is_heard(self._topic(STOP))

    def _send(self, waypoints: Waypoints, seconds: NDArray[np.float64]) -> None:
        now = time.time_ns()
        with self._news:
            self._goal, self._status = (now // 10**9, now % 10**9), None
        points = [
            {
                "transforms": [{"translation": dict(zip("xyz", place, strict=True)), "rotation": _UPRIGHT}],
                "velocities": [],
                "accelerations": [],
                "time_from_start": self._time(int(1e9 * at) // 10**9, int(1e9 * at) % 10**9),
            }
            for place, at in zip(waypoints.position.tolist(), seconds.tolist(), strict=True)
        ]
        header = {"stamp": self._time(*self._goal), "frame_id": self.settings.frame}
        if self._interlock.stopped:
            raise self._stop_here(waypoints.label)
        self._connection.publish(self._topic(FOLLOW), {"header": header, "joint_names": [TIP], "points": points})

    def _time(self, seconds: int, nanoseconds: int) -> dict[str, int]:
        names = ("secs", "nsecs") if self.settings.ros == 1 else ("sec", "nanosec")
        return dict(zip(names, (seconds, nanoseconds), strict=True))

    def _await_end(self, label: str, until: float) -> None:
        """Returns when the arm reports that the motion is done."""
        taken = time.monotonic() + PATIENCE
        while True:
            with self._news:
                self._news.wait(_POLL)
                status = self._status
            self._place(label)
            if self._interlock.stopped:
                raise self._stop_here(label)
            if status is None:
                if time.monotonic() > taken:
                    raise RobotDisconnected(
                        f"{label}: {self._interlock.name} did not say on {self._topic(STATUS)} that it took the "
                        "motion, and is told to stop; look at its node."
                    )
                continue
            code, text = status
            if code == _SUCCEEDED:
                return
            if code == _PREEMPTED:
                raise RobotStopped(f"{label}: {self._interlock.name} was stopped there ({text}); look at it.")
            if code in (_ABORTED, _REJECTED):
                how = "gave up" if code == _ABORTED else "refused the motion"
                raise MotionFailed(f"{label}: {self._interlock.name} {how} ({text}); look at it.", text or code)
            if code != _ACTIVE:
                raise RobotError(f"{label}: {self._interlock.name} has the status {code}, which means nothing here.")
            if time.monotonic() > until:
                raise MotionFailed(f"{label}: {self._interlock.name} did not arrive in time, and is told to stop.")

    def _place(self, label: str) -> NDArray[np.float64]:
        with self._news:
            tip, age, nonsense = self._tip, time.monotonic() - self._heard_at, self._nonsense
        if nonsense:
            raise RobotError(
                f"{label}: {self._interlock.name} said {nonsense}, which cannot be understood; look at its node."
            )
        if tip is None or not age < _SILENCE:
            raise RobotDisconnected(
                f"{label}: {self._interlock.name} has not said for {min(age, 999):.0f} s where it is; look at it and "
                "at its network."
            )
        return tip.copy()

    def _place_after(self, label: str, moment: float) -> NDArray[np.float64]:
        """Returns the tip's position from a message that came after `moment`."""
        until = moment + _SILENCE
        while time.monotonic() < until:
            with self._news:
                if self._heard_at > moment:
                    break
                self._news.wait(_POLL)
        return self._place(label)

    def _hear_pose(self, message: Message) -> None:
        try:
            place = message["pose"]["position"]
            tip = np.array([float(place[axis]) for axis in "xyz"])
            if not np.isfinite(tip).all():
                raise ValueError
        except (KeyError, TypeError, ValueError):
            self._misunderstood(message)
            return
        with self._news:
            self._tip, self._heard_at = tip, time.monotonic()
            self._news.notify_all()

    def _hear_status(self, message: Message) -> None:
        try:
            stamp = message["goal_id"]["stamp"]
            goal = tuple(int(stamp[name]) for name in self._time(0, 0))
            status = (int(message["status"]), str(message.get("text", ""))[:200])
        except (KeyError, TypeError, ValueError, AttributeError):
            self._misunderstood(message)
            return
        with self._news:
            if goal == self._goal:
                self._status = status
            self._news.notify_all()

    def _misunderstood(self, message: object) -> None:
        with self._news:
            self._nonsense = repr(message)[:80]
            self._news.notify_all()

    def _stop_here(self, label: str) -> RobotStopped:
        return RobotStopped(f"{label}: {self._interlock.name} was stopped; look at it before it is connected anew.")

    def _halt(self) -> None:
        """Sends a stop over one connection; if that fails, over the other."""
        for connection in (self._stopper, self._connection):
            try:
                connection.publish(self._topic(STOP), {})
                return
            except RobotError:
                continue


def behind(name: MachineName, workspace: Workspace, connection: Callable[[], RosConnection]) -> RosRobot:
    """Returns the robot of that name, over connections of one kind. Raises ConfigError if the name is invalid."""
    told = {part: name.options[part] for part in ("namespace", "frame") if part in name.options}
    home, version = require_home(name, workspace), name.choose("ros", int, 1)
    return RosRobot(RosSettings(home, workspace.travel_speed, ros=version, **told), connection(), connection())
