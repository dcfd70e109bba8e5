"""A connection to any ROS, 1 or 2, behind a rosbridge server (roslibpy)."""

import socket
from collections.abc import Callable
from typing import Any

from frida_painter.errors import ConfigError, RobotDisconnected, RobotError
from frida_painter.hardware.deadline import one_line
from frida_painter.hardware.drivers.interlock import PATIENCE
from frida_painter.hardware.drivers.ros import Message, RosRobot, behind
from frida_painter.hardware.kinds import Needed, RobotKind
from frida_painter.hardware.machine_identity import at_host
from frida_painter.hardware.machine_name import MachineName
from frida_painter.hardware.workspace import Workspace

_NEEDED = Needed("pip install 'frida-painter[ros]'", "roslibpy")


class RosbridgeConnection:
    """Implements drivers.ros.RosConnection over a websocket of its own to `host`:`port`."""

    def __init__(self, host: str, port: int = 9090) -> None:
        self.host, self.port = host, port
        self._library: Any = None
        self._ros: Any = None
        self._topics: dict[str, Any] = {}

    def open(self) -> None:
        """Connects. A lost connection is never taken up again, for what was lost must not move an arm later."""
        try:
            import roslibpy
        except ImportError as missing:
            raise RobotError(
                f"Arms behind rosbridge need the package roslibpy; install it with: {_NEEDED.install}"
            ) from missing
        try:
            socket.create_connection((self.host, self.port), timeout=PATIENCE).close()
        except OSError as cause:
            raise self._nobody(cause.strerror or str(cause)) from cause
        self._library = roslibpy
        ros = roslibpy.Ros(self.host, self.port, transport="asyncio")
        ros.factory.maxRetries = 0
        try:
            ros.run(timeout=PATIENCE)
        except Exception as cause:
            raise self._nobody(one_line(cause)) from cause
        self._ros = ros

    def hear(self, topic: str, kind: str, tell: Callable[[Message], None]) -> None:
        """Calls `tell` with every message on a topic, in roslibpy's thread."""
        listener = self._library.Topic(self._ros, topic, kind)
        listener.subscribe(tell)
        self._topics[topic] = listener

    def announce(self, topic: str, kind: str) -> None:
        """Says that messages will be published on a topic."""
        self._topics[topic] = self._library.Topic(self._ros, topic, kind)
        self._topics[topic].advertise()

    def is_heard(self, topic: str) -> bool:
        """True: rosbridge does not tell who listens."""
        return topic in self._topics

    def publish(self, topic: str, message: Message) -> None:
        """Sends a message; on a lost connection it is not kept for later."""
        if self._ros is None or not self._ros.is_connected or topic not in self._topics:
            raise RobotDisconnected(
                f"The connection to rosbridge at {self.host}:{self.port} is lost; look at its network."
            )
        self._topics[topic].publish(self._library.Message(dict(message)))

    def close(self) -> None:
        """Disconnects."""
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
            "(roslaunch rosbridge_server rosbridge_websocket.launch) and look at the address."
        )


def _open(name: MachineName, workspace: Workspace) -> RosRobot:
    name.require("namespace", "frame", "ros")
    host, port = _place(name)
    return behind(name, workspace, lambda: RosbridgeConnection(host, port))


def _place(name: MachineName) -> tuple[str, int]:
    """Host and port. Raises ConfigError."""
    host, _, port = name.where.partition(":")
    if port and not (port.isascii() and port.isdigit() and len(port) < 6 and 1 <= int(port) <= 65535):
        raise ConfigError(f"{port[:20]!r} is no port, which is from 1 to 65535; write {name.form}.")
    return host, int(port or 9090)


KIND = RobotKind(
    "rosbridge",
    "rosbridge:HOST[:PORT][,ros=2][,namespace=/NAME][,frame=NAME]",
    "any arm behind rosbridge, ROS 1 or 2",
    open=_open,
    needed=_NEEDED,
    identify=lambda name: at_host(*_place(name)),
)
