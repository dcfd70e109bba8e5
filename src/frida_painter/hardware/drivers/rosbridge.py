"""Connection to ROS 2 through a rosbridge server (roslibpy)."""

import socket
from collections.abc import Callable
from typing import Any

from frida_painter import registry
from frida_painter.errors import ConfigError, RobotDisconnected, RobotError
from frida_painter.hardware.deadline import one_line
from frida_painter.hardware.drivers.ros import Message, RosRobot, RosSettings
from frida_painter.hardware.interlock import PATIENCE
from frida_painter.hardware.kinds import MachineName, Needed, RobotKind, at_host, require_home
from frida_painter.hardware.robot import Workspace


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


def _open(name: MachineName, workspace: Workspace) -> RosRobot:
    name.require("namespace", "frame")
    host, port = _place(name)
    settings = RosSettings(require_home(name, workspace), workspace.travel_speed, **name.options)
    return RosRobot(settings, RosbridgeConnection(host, port), RosbridgeConnection(host, port))


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
