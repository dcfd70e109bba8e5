"""Connections to ROS: through a rosbridge server (roslibpy) for ROS 2 and 1, and through rospy for ROS 1."""

import importlib
import os
import socket
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from frida_painter import registry
from frida_painter.errors import ConfigError, RobotDisconnected, RobotError
from frida_painter.hardware.deadline import one_line, within
from frida_painter.hardware.drivers.interlock import PATIENCE
from frida_painter.hardware.drivers.ros import Message, RosRobot, behind
from frida_painter.hardware.kinds import MachineName, Needed, RobotKind, at_host
from frida_painter.hardware.robot import Workspace

_ROSBRIDGE_NEEDED = Needed(module="roslibpy", extra="ros")


class RosbridgeConnection:
    """Connection through its own websocket to rosbridge at `host`:`port`. Implements drivers.ros.RosConnection."""

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

    def is_heard(self, topic: str) -> bool:
        """Returns True for each known topic: rosbridge does not tell who listens."""
        return topic in self._topics

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
            f"No rosbridge answers at {self.host}:{self.port} ({why}); start it "
            "(ros2 launch rosbridge_server rosbridge_websocket_launch.xml) and look at the address."
        )


def _open_rosbridge(name: MachineName, workspace: Workspace) -> RosRobot:
    name.require("namespace", "frame", "ros")
    host, port = _place(name)
    return behind(name, workspace, lambda: RosbridgeConnection(host, port), ros=2)


def _place(name: MachineName) -> tuple[str, int]:
    """Returns host and port. Raises ConfigError if the port is invalid."""
    host, _, port = name.where.partition(":")
    if port and not (port.isascii() and port.isdigit() and len(port) < 6 and 1 <= int(port) <= 65535):
        raise ConfigError(f"{port[:20]!r} is no port, which is from 1 to 65535; write {name.form}.")
    return host, int(port or 9090)


ROSBRIDGE = RobotKind(
    "rosbridge",
    "rosbridge:HOST[:PORT][,ros=1][,namespace=/NAME][,frame=NAME]",
    "any arm behind rosbridge, ROS 2 or 1",
    open=_open_rosbridge,
    needed=_ROSBRIDGE_NEEDED,
    identify=lambda name: at_host(*_place(name)),
)


# Connection to a ROS 1 master through rospy, which Debian and Ubuntu install outside of virtual environments.

_ROSPY_NEEDED = Needed("apt install python3-rospy python3-trajectory-msgs python3-actionlib-msgs")
_PACKAGES = ("/usr/lib/python3/dist-packages", "/opt/ros/noetic/lib/python3/dist-packages")
_NODE = "frida_painter"


class RospyConnection:
    """Connection to a ROS 1 master over the topics of one node. Implements drivers.ros.RosConnection.

    master: address such as http://localhost:11311; by default that of ROS_MASTER_URI

    A process has one node. A second connection of the same process uses the same node, over separate sockets.
    """

    def __init__(self, master: str | None = None) -> None:
        self.master = master or os.environ.get("ROS_MASTER_URI", "http://localhost:11311")
        self._rospy: Any = None
        self._publishers: dict[str, Any] = {}
        self._subscribers: list[Any] = []

    def open(self) -> None:
        """Registers a node with the master. Raises RobotError without rospy, RobotDisconnected without a master."""
        rospy = _rospy()
        address = urlsplit(self.master)
        try:
            socket.create_connection((address.hostname or "", address.port or 11311), timeout=PATIENCE).close()
        except (OSError, ValueError) as cause:
            raise RobotDisconnected(
                f"No ROS master answers at {self.master} ({getattr(cause, 'strerror', None) or cause}); start it "
                "(roscore), or set ROS_MASTER_URI."
            ) from cause
        if not rospy.core.is_initialized():
            arguments = [_NODE, f"__master:={self.master}"]
            try:
                within(2 * PATIENCE, "init_node", lambda: rospy.init_node(_NODE, arguments, True, disable_signals=True))
            except Exception as cause:
                raise RobotDisconnected(
                    f"The ROS master at {self.master} did not take the node ({one_line(cause)})."
                ) from cause
        self._rospy = rospy

    def hear(self, topic: str, kind: str, tell: Callable[[Message], None]) -> None:
        """Calls `tell` with every message of a topic, in rospy's thread."""
        told = self._rospy.Subscriber(topic, _kind(kind), lambda message: tell(_as_mapping(message)), tcp_nodelay=True)
        self._subscribers.append(told)

    def announce(self, topic: str, kind: str) -> None:
        """Announces that messages will be published on a topic."""
        self._publishers[topic] = self._rospy.Publisher(topic, _kind(kind), queue_size=1, tcp_nodelay=True)

    def is_heard(self, topic: str) -> bool:
        """Returns True if a node is connected to the topic."""
        return topic in self._publishers and self._publishers[topic].get_num_connections() > 0

    def publish(self, topic: str, message: Message) -> None:
        """Sends a message to the listeners. Raises RobotDisconnected if there are none or ROS does not take it."""
        if not self.is_heard(topic):
            raise RobotDisconnected(f"Nobody listens to {topic} any more; look at the arm's node.")
        publisher = self._publishers[topic]
        made = publisher.data_class()
        try:
            importlib.import_module("genpy.message").fill_message_args(made, [message] if message else [])
            publisher.publish(made)
        except Exception as cause:
            raise RobotDisconnected(f"ROS did not take a message on {topic} ({one_line(cause)}).") from cause

    def complaint(self) -> str:
        """Returns "": rospy raises its errors."""
        return ""

    def close(self) -> None:
        """Unregisters publishers and subscribers; the node lives as long as the process."""
        for spoken in (*self._publishers.values(), *self._subscribers):
            spoken.unregister()
        self._publishers, self._subscribers = {}, []


def _rospy() -> Any:
    """Returns the module rospy, also from the system's packages if a virtual environment hides them."""
    for folder in _PACKAGES:
        if Path(folder, "rospy").is_dir() and folder not in sys.path:
            sys.path.append(folder)  # at the end, so that packages of the environment have priority
    try:
        return importlib.import_module("rospy")
    except ImportError as missing:
        raise RobotError(
            f"ROS 1 needs rospy ({missing}); install it with: {_ROSPY_NEEDED.install}, or speak with any ROS "
            "through rosbridge."
        ) from missing


def _kind(name: str) -> Any:
    """Returns the class of a message from its name, such as "std_msgs/Empty"."""
    package, _, kind = name.partition("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), kind)
    except ImportError as missing:
        raise RobotError(f"ROS messages of {package} are missing; install them with: apt install "
                         f"python3-{package.replace('_', '-')}") from missing  # fmt: skip


def _as_mapping(message: Any) -> Any:
    """Converts a rospy message to nested mappings."""
    if hasattr(message, "secs"):
        return {"secs": message.secs, "nsecs": message.nsecs}
    if hasattr(message, "__slots__") and hasattr(message, "_type"):
        return {name: _as_mapping(getattr(message, name)) for name in message.__slots__}
    if isinstance(message, Mapping | str | int | float | bytes):
        return message
    return [_as_mapping(part) for part in message] if isinstance(message, list | tuple) else message


def _open_rospy(name: MachineName, workspace: Workspace) -> RosRobot:
    name.require("namespace", "frame", where=False)
    return behind(name, workspace, lambda: RospyConnection(name.where or None), ros=1)


ROSPY = RobotKind(
    "ros",
    "ros[:MASTER][,namespace=/NAME][,frame=NAME]",
    "any arm behind a ROS 1 master",
    open=_open_rospy,
    needed=_ROSPY_NEEDED,
)
