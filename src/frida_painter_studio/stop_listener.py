"""Process that receives stops: its own port and secret, without sessions, thread pools, databases or disks.

Run it with `python -m frida_painter_studio.stop_listener FOLDER PORT LINE LOCK CONFIG`. FOLDER is the studio's folder.
PORT and LINE are inherited listening sockets, for pages and for workers. LOCK is the inherited lock file of the
listener. CONFIG holds names and certificate as JSON.

The process lives as long as a studio is open or a worker works, also after the studio was closed or has crashed.
"""

import asyncio
import contextlib
import json
import os
import socket
import sys
from pathlib import Path
from urllib.parse import urlsplit

import h11

from frida_painter_studio.network import Certificate, Connections, WebAppLock, most_connections
from frida_painter_studio.stop import StopKey, Stops
from frida_painter_studio.studio_folder import find_work

_PATIENCE = 3.0  # seconds for a whole request
_MAX_BYTES = 8192
_BETWEEN_LOOKS = 1.0


class StopRequest(asyncio.Protocol):
    """HTTP request of a page: `POST /stop` with the secret as its body, or `GET /` to check the listener.

    A plain POST needs no CORS preflight, so a stop takes one round trip.
    """

    def __init__(self, stops: Stops, key: StopKey, names: frozenset[str]) -> None:
        self._stops, self._key, self._names = stops, key, names
        self._http = h11.Connection(h11.SERVER, _MAX_BYTES)
        self._body, self._request = b"", h11.Request(method="GET", target="/", headers=[("host", "")])
        self.waiting_since: float | None = None
        self._task: asyncio.Task[None] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Starts to wait for a request."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self.waiting_since = asyncio.get_running_loop().time()

    def data_received(self, data: bytes) -> None:
        """Reads data, and answers a complete request."""
        try:
            self._http.receive_data(data)
            while True:
                event = self._http.next_event()
                if isinstance(event, h11.Request):
                    self._request = event
                elif isinstance(event, h11.Data):
                    self._body += event.data
                    if len(self._body) > _MAX_BYTES:
                        self._transport.abort()
                        return
                elif isinstance(event, h11.EndOfMessage):
                    self.waiting_since = None
                    self._task = asyncio.get_running_loop().create_task(self._answer())
                    return
                else:
                    return
        except h11.RemoteProtocolError:
            self._transport.abort()

    async def _answer(self) -> None:
        headers = {bytes(name): bytes(value).decode("latin-1") for name, value in self._request.headers}
        origin = headers.get(b"origin", "")
        known = urlsplit(f"//{headers.get(b'host', '')}").hostname in self._names
        if not known or (origin and _hostname(origin) not in self._names):
            self._send(403, {"sentence": "Another page asked for this."}, "")
        elif self._request.method == b"GET":
            self._send(200, {"listening": True}, origin)
        elif (self._request.method, self._request.target) != (b"POST", b"/stop"):
            self._send(404, {"sentence": "Here is only POST /stop."}, origin)
        elif (role := self._key.role(self._body.decode("utf-8", "replace").strip())) is None:
            self._send(403, {"sentence": "This page is too old to stop; use the robot's emergency stop."}, origin)
        else:
            self._send(200, dict(await self._stops.press(role.name)), origin)

    def _send(self, status: int, said: dict[str, object], origin: str) -> None:
        body = json.dumps(said).encode()
        headers = [("Content-Type", "application/json"), ("Content-Length", str(len(body))), ("Connection", "close")]
        headers += [("Cache-Control", "no-store"), ("X-Content-Type-Options", "nosniff"), ("Vary", "Origin")]
        if origin:
            headers.append(("Access-Control-Allow-Origin", origin))
        answer = h11.Response(status_code=status, headers=headers, reason=b"")
        content = b"".join(filter(None, map(self._http.send, (answer, h11.Data(data=body), h11.EndOfMessage()))))
        self._transport.write(content)
        self._transport.close()


def _hostname(origin: str) -> str | None:
    try:
        return urlsplit(origin).hostname
    except ValueError:
        return None


async def serve(root: Path, port: socket.socket, line: socket.socket, config: dict[str, list[str]]) -> None:
    """Receives stops until no studio is open and no worker works."""
    stops, key = Stops(root), StopKey.of(root)
    names, files = frozenset(config["names"]), config["certificate"]
    tls = Certificate(*map(Path, files)).context() if files else None
    listening = Connections(
        port, lambda: StopRequest(stops, key, names), most=most_connections(), patience=_PATIENCE, tls=tls
    )
    local = await asyncio.start_unix_server(stops.answer, sock=line)
    accepting = asyncio.create_task(listening.accept())
    async with local:
        while not accepting.done():
            await asyncio.sleep(_BETWEEN_LOOKS)
            if await asyncio.to_thread(_alone, root):
                return


def _alone(root: Path) -> bool:
    """Returns True if no studio is open and no worker works; no studio can then open before this process ends."""
    if find_work(root):
        return False
    return WebAppLock(root).take_alone()


def main() -> None:
    """Serves with the inherited sockets."""
    folder, port, line, lock, config = sys.argv[1:]
    os.set_inheritable(int(lock), False)
    with contextlib.suppress(RuntimeError):  # the loop was stopped: another listener takes over
        asyncio.run(
            serve(Path(folder), socket.socket(fileno=int(port)), socket.socket(fileno=int(line)), json.loads(config))
        )


if __name__ == "__main__":
    main()
