"""The robot kind `rosbridge`: arms behind ROS 2 that follow Cartesian trajectories of the brush's tip.

They are reached through a rosbridge server (roslibpy), over five topics of stock messages. docs/how-to/ros.md specifies
the arm's node.
"""

import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frida_painter import registry
from frida_painter.errors import ConfigError, MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.deadline import one_line, steady
from frida_painter.hardware.interlock import PATIENCE, motion_timeout
from frida_painter.hardware.kinds import MachineName, Needed, RobotKind, at_host, require_home
from frida_painter.hardware.robot import MachineFact, Point, Waypoints, Weight, Workspace
from frida_painter_drivers.driver import Driver

Message = Mapping[str, Any]
"""ROS message as nested mappings from field names to values."""

TIP = "brush_tip"


_TYPES = {
    "follow": "trajectory_msgs/msg/MultiDOFJointTrajectory",
    "status": "action_msgs/msg/GoalStatus",
    "pose": "geometry_msgs/msg/PoseStamped",
    "stop": "std_msgs/msg/Empty",
    "alive": "std_msgs/msg/Empty",
}
"""Type of the messages of each topic."""

_ACTIVE, _STOPPED, _DONE, _GAVE_UP = "active", "stopped", "done", "gave up"
_STATUSES = {1: _ACTIVE, 2: _ACTIVE, 3: _ACTIVE, 4: _DONE, 5: _STOPPED, 6: _GAVE_UP}
"""Meaning of each code of action_msgs/GoalStatus."""

_UPRIGHT = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
_SILENCE = 2.0
_POLL = 0.02
_BEAT = 0.2  # seconds between two signs of life; the arm's node stops after a second without
_MOVED = 1e-4  # metres
_LISTENING, _RARELY = 0.5, 5.0  # seconds for which `doctor` counts poses; it warns of fewer poses a second


class RosbridgeConnection:
    """Connection through its own websocket to rosbridge at `host`:`port`."""

    def __init__(self, host: str, port: int = 9090) -> None:
        self.host, self.port = host, port
        self._library: Any = None
        self._ros: Any = None
        self._topics: dict[str, Any] = {}
        self._complaint = ""

    def open(self) -> None:
        """Connects. A lost connection is never restored, because a late message must not move the arm.

        Raises RobotError if roslibpy is missing, RobotDisconnected if no rosbridge answers.
        """
        with registry.importing("ros", "An arm behind rosbridge", RobotError):
            import roslibpy
        try:
            socket.create_connection((self.host, self.port), timeout=PATIENCE).close()
        except OSError as cause:
            raise self._nobody(cause.strerror or str(cause)) from cause
        self._library, self._complaint = roslibpy, ""
        ros = roslibpy.Ros(self.host, self.port, transport="asyncio")
        ros.factory.maxRetries = 0
        ros.factory.on_ready(self._hear_complaints)
        try:
            ros.run(timeout=PATIENCE)
        except Exception as cause:
            raise self._nobody(one_line(cause)) from cause
        self._ros = ros

    def hear(self, topic: str, kind: str, tell: Callable[[Message], None]) -> None:
        """Calls `tell` with every message of a topic, in roslibpy's thread."""
        listener = self._library.Topic(self._ros, topic, kind)
        listener.subscribe(tell)
        self._topics[topic] = listener

    def announce(self, topic: str, kind: str) -> None:
        """Announces that messages will be published on a topic."""
        self._topics[topic] = self._library.Topic(self._ros, topic, kind)
        self._topics[topic].advertise()

    def publish(self, topic: str, message: Message) -> None:
        """Sends a message. Raises RobotDisconnected if the connection is lost; the message is not kept for later."""
        if self._ros is None or not self._ros.is_connected or topic not in self._topics:
            raise RobotDisconnected(
                f"The connection to rosbridge at {self.host}:{self.port} is lost; look at its network."
            )
        self._topics[topic].publish(self._library.Message(dict(message)))

    def complaint(self) -> str:
        """Returns the last error that rosbridge reported, such as an unknown message; "" for none."""
        return self._complaint

    def _hear_complaints(self, protocol: Any) -> None:
        """Listens for rosbridge's reports of errors, for which roslibpy has no handler."""

        def tell(message: Message) -> None:
            if message.get("level", "error") == "error":
                self._complaint = " ".join(str(message.get("msg", "")).split()) or "an error without a text"

        protocol._message_handlers["status"] = tell

    def close(self) -> None:
        """Disconnects. Raises RobotDisconnected if that fails."""
        ros, self._ros = self._ros, None
        self._topics = {}
        if ros is not None and ros.is_connected:
            try:
                ros.close(timeout=PATIENCE)
            except Exception as cause:
                raise self._nobody(one_line(cause)) from cause

    def _nobody(self, why: str) -> RobotDisconnected:
        return RobotDisconnected(
            f"No rosbridge answers at {self.host}:{self.port} ({why}); start it (ros2 launch rosbridge_server "
            "rosbridge_websocket_launch.xml) and look at the address."
        )


class RosRobot(Driver):
    """Robot behind ROS. Stops use a separate connection.

    namespace: of the topics, begins with "/"
    frame: coordinate frame of the waypoints

    Nobody tells the arm if this program or its network dies. Therefore the driver sends a sign of life all the time
    that a motion takes, and the arm's node stops without it.
    """

    def __init__(
        self,
        resting: Point,
        connection: RosbridgeConnection,
        stopper: RosbridgeConnection,
        approach: float = 0.1,
        namespace: str = "/brush",
        frame: str = "base",
    ) -> None:
        super().__init__(f"the arm behind ROS at {namespace}", resting, approach)
        if not namespace.startswith("/"):
            raise ConfigError(
                f"A ROS arm was given the namespace {namespace!r}; write a name that begins with a slash."
            )
        self.namespace, self._frame = namespace.rstrip("/"), frame
        self._connection, self._stopper = connection, stopper
        self._news = threading.Condition()
        self._forget()

    def _forget(self) -> None:
        self._tip: NDArray[np.float64] | None = None
        self._heard_at, self._poses, self._nonsense = float("-inf"), 0, ""
        self._goal: tuple[int, ...] = (0, 0)
        self._status: int | None = None
        self._ours: set[tuple[int, ...]] = set()
        self._other: tuple[int, ...] | None = None  # motion under way that this program did not send

    def _open(self, *, examines: bool) -> None:
        """Opens both connections and waits until the arm reports its pose. Moves nothing."""
        self._forget()
        for connection in (self._stopper, self._connection):
            connection.open()
        self._stopper.announce(*self._topic_and_type("stop"))
        for topic in ("follow", "alive"):
            self._connection.announce(*self._topic_and_type(topic))
        self._connection.hear(*self._topic_and_type("status"), self._hear_status)
        # Last: a pose comes after all complaints about the messages before.
        self._connection.hear(*self._topic_and_type("pose"), self._hear_pose)
        until = time.monotonic() + PATIENCE
        while self._tip is None:
            self._require_no_complaint()
            if time.monotonic() > until:
                raise RobotDisconnected(
                    f"There is ROS, but no arm in it says on {self._topic('pose')} where it is (waited {PATIENCE:.0f} "
                    "s); start the arm's node, or correct the namespace."
                )
            time.sleep(_POLL)
        self._require_no_complaint()

    def pose(self) -> NDArray[np.float64]:
        """Returns the tip's last reported position, [3] metres. Raises RobotDisconnected if the report is too old."""
        self._interlock.require_ready("pose")
        with self._interlock.blocking():
            return self._place("pose")

    def _go(self, waypoints: Waypoints) -> NDArray[np.float64]:
        """Sends the waypoints with their times; returns when the arm reports success."""
        started, here = time.monotonic(), self._place(waypoints.label)
        self._require_alone(waypoints.label)
        path = np.concatenate([here[None], waypoints.position])
        steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
        seconds = np.cumsum(steps / np.r_[self.approach, np.full(len(steps) - 1, waypoints.speed)])
        self._send(waypoints, seconds)
        self._await_end(waypoints.label, started + motion_timeout(float(seconds[-1]), 1.0))
        with self._news:  # a position that was told after the end
            ended = time.monotonic()
            self._news.wait_for(lambda: self._heard_at > ended, _SILENCE)
        return self._place(waypoints.label)

    def stop(self) -> None:
        """Tells the arm to stop, over the connection for stops. A `follow` in progress ends."""
        super().stop()
        with self._news:
            self._news.notify_all()

    def close(self) -> None:
        """Closes both connections."""
        self._interlock.mark_disconnected()
        for connection in (self._connection, self._stopper):
            with suppress(RobotError):  # A connection that does not close in time is abandoned.
                connection.close()

    def timing(self) -> None:
        """Returns None: the arm's node does not tell its limits."""

    def _facts(self) -> Iterator[MachineFact]:
        x, y, z = 1000 * self.pose()
        yield MachineFact(f"An arm under {self.namespace} speaks ROS 2; its tip is at ({x:.0f}, {y:.0f}, {z:.0f}) mm "
                          f"in the frame {self._frame!r}.")  # fmt: skip
        before, began = self._poses, time.monotonic()
        time.sleep(_LISTENING)
        rate = (self._poses - before) / (time.monotonic() - began)
        seldom = (
            "; let its node say it 20 times a second, because a stop and the end of a stroke are noticed as late"
            if rate < _RARELY
            else ""
        )
        weight: Weight = "warning" if seldom else "fact"
        yield MachineFact(f"It says {rate:.0f} times a second where it is{seldom}.", weight)
        yield MachineFact(
            "Neither ROS nor rosbridge tells whether its node stops when this program dies. Try it before you paint: "
            "pull the network cable during a slow motion; the arm must stand after a second without "
            f"{self._topic('alive')}.",
            "warning",
        )

    def _topic(self, name: str) -> str:
        return f"{self.namespace}/{name}"

    def _topic_and_type(self, name: str) -> tuple[str, str]:
        return self._topic(name), _TYPES[name]

    def _require_no_complaint(self) -> None:
        complaint = self._connection.complaint() or self._stopper.complaint()
        if complaint:
            raise RobotError(
                f"{self._interlock.name}: ROS 2 was expected, and it says: {complaint[:200]}. Install that there."
            )

    def _send(self, waypoints: Waypoints, seconds: NDArray[np.float64]) -> None:
        now = time.time_ns()
        with self._news:
            self._goal, self._status = (now // 10**9, now % 10**9), None
            self._ours.add(self._goal)
        points = [
            {
                "transforms": [{"translation": dict(zip("xyz", place, strict=True)), "rotation": _UPRIGHT}],
                "velocities": [],
                "accelerations": [],
                "time_from_start": _time(int(1e9 * at)),
            }
            for place, at in zip(waypoints.position.tolist(), seconds.tolist(), strict=True)
        ]
        header = {"stamp": _time(now), "frame_id": self._frame}
        self._interlock.heed_stop(waypoints.label)
        self._connection.publish(self._topic("follow"), {"header": header, "joint_names": [TIP], "points": points})

    def _await_end(self, label: str, until: float) -> None:
        taken, beat, before = time.monotonic() + PATIENCE, 0.0, self._place(label)
        while True:
            if time.monotonic() > beat:
                self._connection.publish(self._topic("alive"), {})
                beat = time.monotonic() + _BEAT
            with self._news:
                self._news.wait(_POLL)
                status = self._status
            here = self._place(label)
            self._require_no_complaint()
            self._require_alone(label)
            self._interlock.heed_stop(label)
            if status is None:
                if time.monotonic() > taken:
                    said = f"did not say on {self._topic('status')} that it took the motion, and is told to stop"
                    raise self._failure(RobotDisconnected, label, f"{said}; look at its node.")
                continue
            meaning = _STATUSES.get(status)
            if meaning == _DONE:
                return
            if meaning == _STOPPED:
                raise self._failure(RobotStopped, label, "was stopped there; look at it.")
            if meaning == _GAVE_UP:
                raise self._failure(MotionFailed, label, f"{meaning}; look at it.", status)
            if meaning is None:
                raise self._failure(RobotError, label, f"has the status {status}, which means nothing here.")
            if float(np.linalg.norm(here - before)) > _MOVED:  # an arm that moves is alive, however slow it is
                before, until, self._alive = here, max(until, time.monotonic() + PATIENCE), steady()
            if time.monotonic() > until:
                raise self._failure(MotionFailed, label, "did not arrive in time, and is told to stop.")

    def _require_alone(self, label: str) -> None:
        """Raises MotionFailed if the arm follows a motion that this program did not send."""
        if self._other is not None:
            said = (
                "follows a motion that was not sent from here, as by another program or an earlier painting; end that, "
                "look at the arm, then connect anew."
            )
            raise self._failure(MotionFailed, label, said)

    def _place(self, label: str) -> NDArray[np.float64]:
        with self._news:
            tip, age, nonsense = self._tip, time.monotonic() - self._heard_at, self._nonsense
        if nonsense:
            said = f"said {nonsense}, which cannot be understood; look at its node."
            raise self._failure(RobotError, label, said)
        if tip is None or not age < _SILENCE:
            said = f"has not said for {min(age, 999):.0f} s where it is; look at it and at its network."
            raise self._failure(RobotDisconnected, label, said)
        return tip.copy()

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
            self._tip, self._heard_at, self._poses = tip, time.monotonic(), self._poses + 1
            self._news.notify_all()

    def _hear_status(self, message: Message) -> None:
        try:
            stamp = message["goal_info"]["stamp"]
            goal = (int(stamp["sec"]), int(stamp["nanosec"]))
            status = int(message["status"])
        except (KeyError, TypeError, ValueError, AttributeError):
            self._misunderstood(message)
            return
        with self._news:
            if goal == self._goal:
                self._status = status
            elif goal not in self._ours:
                active = _STATUSES.get(status) == _ACTIVE
                self._other = goal if active else None if goal == self._other else self._other
            self._news.notify_all()

    def _misunderstood(self, message: object) -> None:
        with self._news:
            self._nonsense = repr(message)[:80]
            self._news.notify_all()

    def _halt(self) -> None:
        """Sends a stop over one connection; if that fails, over the other."""
        for connection in (self._stopper, self._connection):
            try:
                connection.publish(self._topic("stop"), {})
                return
            except RobotError:
                continue


def _time(nanoseconds: int) -> dict[str, int]:
    """Returns a time as a message of ROS 2."""
    return {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}


def _open(name: MachineName, workspace: Workspace) -> RosRobot:
    name.require("namespace", "frame")
    host, port = _place(name)
    connection, stopper = RosbridgeConnection(host, port), RosbridgeConnection(host, port)
    return RosRobot(require_home(name, workspace), connection, stopper, workspace.travel_speed, **name.options)


def _place(name: MachineName) -> tuple[str, int]:
    """Returns host and port. Raises ConfigError if the port is invalid."""
    host, _, port = name.where.partition(":")
    if port and not (port.isascii() and port.isdigit() and len(port) < 6 and 1 <= int(port) <= 65535):
        raise ConfigError(f"{port[:20]!r} is no port, which is from 1 to 65535; write {name.form}.")
    return host, int(port or 9090)


KIND = RobotKind(
    "rosbridge",
    "rosbridge:HOST[:PORT][,namespace=/NAME][,frame=NAME]",
    "any arm behind ROS 2 and its rosbridge",
    open=_open,
    needed=Needed(module="roslibpy", extra="ros"),
    identify=lambda name: at_host(*_place(name)),
)
