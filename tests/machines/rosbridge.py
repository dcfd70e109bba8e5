"""A simulated rosbridge with an arm behind it, from ROSBRIDGE_PROTOCOL.md and the server's behaviour.

It loads the package of each message as it is advertised or subscribed to, and reports "status" if it is missing. It
tells nobody that a client is dead: without a close of the connection it keeps it (rosbridge_suite issues 357, 655).
"""

import asyncio
import json
import threading
from typing import Any

from autobahn.asyncio.websocket import WebSocketServerFactory, WebSocketServerProtocol

from machines.ros_arm import RosArm

PACKAGES = {"trajectory_msgs", "geometry_msgs", "std_msgs", "action_msgs"}  # of ROS 2 Rolling


class _Nonsense(asyncio.Protocol):
    """Another device, which says what nobody understands."""

    def connection_made(self, transport: Any) -> None:
        transport.write(bytes(range(128, 250)) * 20)


class Rosbridge:
    """Listens on `port` of this machine while it is entered; every published message reaches the arm."""

    def __init__(self) -> None:
        self.arm = RosArm(self.tell)
        self.port = 0
        self.packages = set(PACKAGES)
        self.dead = self.garbage = False
        self.clients: list[Any] = []
        self.advertised: dict[str, str] = {}
        self.listeners: dict[str, set[Any]] = {}
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "Rosbridge":
        self._thread.start()
        assert self._ready.wait(5)
        self.arm.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.arm.end()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(5)
        self._loop.close()

    def drop(self) -> None:
        """The network breaks."""
        for client in list(self.clients):
            self._loop.call_soon_threadsafe(client.dropConnection, True)

    def leave_network(self) -> None:
        """Unplugs its computer."""
        self._loop.call_soon_threadsafe(self._server.close)
        self.drop()

    def join_network(self) -> None:
        """Plugs it in again."""
        asyncio.run_coroutine_threadsafe(self._listen(), self._loop).result(5)

    async def _listen(self) -> None:
        self._server = await self._loop.create_server(
            lambda: _Nonsense() if self.garbage else self._factory(), "127.0.0.1", self.port
        )
        self.port = self._server.sockets[0].getsockname()[1]

    def freeze(self) -> None:
        """The client's computer or network dies: nothing comes through any more, and nobody closes the connection."""
        self.dead = True

    def tell(self, topic: str, message: dict[str, Any]) -> None:
        if self.dead:
            return
        text = json.dumps({"op": "publish", "topic": topic, "msg": message}).encode()
        for client in list(self.listeners.get(topic, ())):
            self._loop.call_soon_threadsafe(client.say, text)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        bridge = self

        class Client(WebSocketServerProtocol):
            def onOpen(self) -> None:
                bridge.clients.append(self)

            def onMessage(self, payload: bytes, isBinary: bool) -> None:
                said = json.loads(payload)
                if bridge.dead:
                    return
                package = said.get("type", "std_msgs/Empty").split("/")[0]
                if package not in bridge.packages:
                    why = (
                        f"Unable to import {package}.msg from package {package}. Caused by: No module named {package!r}"
                    )
                    told = {"op": "status", "level": "error", "msg": f"{said['op']}: {why}"}
                    self.sendMessage(json.dumps(told).encode())
                elif said["op"] == "advertise":
                    bridge.advertised[said["topic"]] = said["type"]
                elif said["op"] == "subscribe":
                    bridge.listeners.setdefault(said["topic"], set()).add(self)
                elif said["op"] == "publish":
                    assert said["topic"] in bridge.advertised
                    bridge.arm.hear(said["topic"], said["msg"])

            def onClose(self, wasClean: bool, code: int, reason: str) -> None:
                if self in bridge.clients:
                    bridge.clients.remove(self)
                for listening in bridge.listeners.values():
                    listening.discard(self)

            def say(self, text: bytes) -> None:
                if self in bridge.clients:
                    self.sendMessage(text)

        self._factory = WebSocketServerFactory(loop=self._loop)
        self._factory.protocol = Client
        self._loop.run_until_complete(self._listen())
        self._ready.set()
        self._loop.run_forever()
        self._server.close()
        for client in list(self.clients):
            client.dropConnection(True)
        self._loop.run_until_complete(asyncio.sleep(0.05))  # in which those connections are lost, and closed
