"""A small websocket server that plays rosbridge 2.0 with an arm behind it."""

import asyncio
import json
import threading
from typing import Any

from autobahn.asyncio.websocket import WebSocketServerFactory, WebSocketServerProtocol

from machines.fake_ros_arm import FakeArm


class FakeRosbridge:
    """Listens on `port` of this machine while it is entered; every published message reaches the arm."""

    def __init__(self, ros: int = 1) -> None:
        self.arm = FakeArm(self.tell, ros=ros)
        self.port = 0
        self.clients: list[Any] = []
        self.advertised: dict[str, str] = {}
        self.listeners: dict[str, set[Any]] = {}
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "FakeRosbridge":
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

    def tell(self, topic: str, message: dict[str, Any]) -> None:
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
                if said["op"] == "advertise":
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

        factory = WebSocketServerFactory(loop=self._loop)
        factory.protocol = Client
        self._server = self._loop.run_until_complete(self._loop.create_server(factory, "127.0.0.1", 0))
        self.port = self._server.sockets[0].getsockname()[1]
        self._ready.set()
        self._loop.run_forever()
        self._server.close()
        for client in list(self.clients):
            client.dropConnection(True)
        self._loop.run_until_complete(asyncio.sleep(0.05))  # in which those connections are lost, and closed
