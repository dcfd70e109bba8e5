"""Listener for stops: a process with its own port and secret, without sessions, thread pools, databases or disks.

`StopProcess` starts it, or uses a running one: `python -m frida_painter_studio.stop_listener FOLDER PORT LINE LOCK
CONFIG`. FOLDER is the studio's folder. PORT and LINE are inherited listening sockets, for pages and for workers. LOCK
is the inherited lock file of the listener. CONFIG holds names and certificate as JSON.

The process lives as long as a studio is open or a worker works, also after the studio was closed or has crashed.
"""

import asyncio
import contextlib
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import uvicorn
from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import Receive, Scope, Send
from uvicorn.server import ServerState

from frida_painter.errors import ConfigError, StorageError
from frida_painter.system import locks, operating_system, python_process, storage
from frida_painter_studio.at_page import call, find_listener
from frida_painter_studio.network import (
    STUDIO_LOCK,
    Certificate,
    Connections,
    WaitingProtocol,
    most_connections,
    read_body,
    share_lock,
)
from frida_painter_studio.stop import END, StopKey, Stops, listen_locally
from frida_painter_studio.studio_folder import find_work
from frida_painter_together.commands import Role

_PATIENCE = 3.0  # seconds for a whole request
_MAX_BYTES = 8192
_BETWEEN_LOOKS = 1.0
_HEADERS = {"Connection": "close", "Cache-Control": "no-store", "X-Content-Type-Options": "nosniff", "Vary": "Origin"}


@dataclass(frozen=True)
class StopReceiver:
    """ASGI application for pages: `POST /stop` with the secret as its body, or `GET /` to check the listener.

    A plain POST needs no CORS preflight, so a stop takes one round trip.
    """

    stops: Stops
    key: StopKey
    names: frozenset[str]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers 200, 403, 404 or 413; `Connections` cuts what is late."""
        headers, way = Headers(scope=scope), (scope["method"], scope["path"])
        origin, body = headers.get("origin", ""), await read_body(receive, _MAX_BYTES)
        told: dict[str, Any]
        known = _hostname(f"//{headers.get('host', '')}") in self.names
        if not known or (origin and _hostname(origin) not in self.names):
            status, origin, told = 403, "", {"sentence": "Another page asked for this."}
        elif scope["method"] == "GET":
            status, told = 200, {"listening": True}
        elif way != ("POST", "/stop"):
            status, told = 404, {"sentence": "Here is only POST /stop."}
        elif body is None:
            status, told = 413, {"sentence": "This is no secret for stops."}
        elif (role := self.key.role(body.decode("utf-8", "replace").strip())) is None:
            status, told = 403, {"sentence": "This page is too old to stop; use the robot's emergency stop."}
        else:
            status, told = 200, await self.stops.press(role.name)
        shared = {"Access-Control-Allow-Origin": origin} if origin else {}
        await JSONResponse(told, status, {**_HEADERS, **shared})(scope, receive, send)


def _hostname(address: str) -> str | None:
    with contextlib.suppress(ValueError):
        return urlsplit(address).hostname
    return None


async def serve(root: Path, port: socket.socket, line: socket.socket, config: dict[str, list[str]]) -> None:
    """Receives stops until no studio is open and no worker works."""
    stops, files = Stops(root, find_listener(root)[1]), config["certificate"]
    receiver = StopReceiver(stops, StopKey.of(root), frozenset(config["names"]))
    http = uvicorn.Config(
        receiver, log_config=None, log_level="error", access_log=False, server_header=False, date_header=False,
        ws="none", lifespan="off", proxy_headers=False, h11_max_incomplete_event_size=_MAX_BYTES,
    )  # fmt: skip
    state = ServerState()
    listening = Connections(
        port,
        lambda: WaitingProtocol(http, state, {}, asyncio.get_running_loop(), for_body=True),
        most=most_connections(),
        patience=_PATIENCE,
        tls=Certificate(*map(Path, files)).context() if files else None,
    )
    local = await asyncio.start_server(stops.answer, sock=line)
    accepting = asyncio.create_task(listening.accept())
    studios = locks.open_lock(root / STUDIO_LOCK)
    try:
        while not accepting.done():
            await asyncio.sleep(_BETWEEN_LOOKS)
            if await asyncio.to_thread(_is_alone, root, studios):
                return
    finally:
        local.close()  # without a wait for its lines, which may stay open


def _is_alone(root: Path, studios: int) -> bool:
    """Returns True if no studio is open and no worker works; no studio can then open before this process ends."""
    try:
        return not find_work(root) and locks.take(studios)
    except OSError:  # the folder is away for a moment, and somebody may work in it
        return False


# Keeper of the listener, in the studio's process.

_FILE = ".stop.json"
_LOCK = ".stop-lock"
_ENDING = 3.0  # seconds


@dataclass
class StopProcess:
    """Listener for stops of the studio in `root`.

    listen: returns a listening socket on a port, 0 for a free one; raises ConfigError.
    names: host names of this machine in browsers.
    wanted: preferred port.
    certificate: None without encryption.
    port: port of the started listener.
    """

    root: Path
    listen: Callable[[int], socket.socket]
    names: frozenset[str]
    wanted: int
    certificate: Certificate | None = None
    port: int = field(default=0, init=False)
    _shared: int = field(default=-1, init=False)
    _stop_key: StopKey | None = field(default=None, init=False)
    _process: "subprocess.Popen[bytes] | None" = field(default=None, init=False)

    def start(self) -> None:
        """Starts a listener, unless a running one has the same settings. Raises ConfigError, StorageError."""
        files = self.certificate and [str(self.certificate.certificate), str(self.certificate.key)]
        config: dict[str, Any] = {"names": sorted(self.names), "certificate": files}
        try:
            lock = locks.open_lock(self.root / _LOCK)
        except OSError as error:
            raise _cannot_start(error) from error
        try:
            before: dict[str, Any] = {}
            with contextlib.suppress(StorageError):  # there was no listener
                before = storage.read_json(self.root / _FILE, "where stops are listened to")
            port = int(before.get("port", 0))
            if not locks.take(lock):
                if port and before == config | {"port": port}:
                    self.port = port
                    return
                self._end_other(lock)
            self._launch(lock, config, self.port or port or self.wanted)
        except OSError as error:
            raise _cannot_start(error) from error
        finally:
            os.close(lock)

    def secret(self, role: Role) -> str:
        """Returns the secret for stops of a page of that role. Raises StorageError."""
        if self._stop_key is None:
            self._stop_key = StopKey.of(self.root)
        return self._stop_key.secret(role)

    async def keep(self) -> None:
        """Restarts the listener whenever it has ended, also in a folder that was deleted and made again."""
        while True:
            await asyncio.sleep(_BETWEEN_LOOKS)
            if self._process is not None:
                self._process.poll()
            with contextlib.suppress(ConfigError, StorageError, OSError):
                await asyncio.to_thread(self._renew)

    def _renew(self) -> None:
        there = (self.root / STUDIO_LOCK).stat() if (self.root / STUDIO_LOCK).exists() else None
        if self._shared < 0 or there is None or not os.path.samestat(os.fstat(self._shared), there):
            self._shared = share_lock(self.root)  # in a new folder each listener would end at once
        self.start()

    def _end_other(self, lock: int) -> None:
        with contextlib.suppress(OSError), call(self.root) as line:
            line.sendall(f"{END}\n".encode())
        until = time.monotonic() + _ENDING
        while not locks.take(lock):
            if time.monotonic() > until:
                raise StorageError("Another studio in this folder listens for stops, and does not give way; close it.")
            time.sleep(0.02)

    def _launch(self, lock: int, config: dict[str, Any], wanted: int) -> None:
        try:
            port = self.listen(wanted)
        except ConfigError:
            port = self.listen(0)
        with port, listen_locally(self.root) as line, (self.root / "stop.log").open("ab") as log:
            self.port = port.getsockname()[1]
            storage.write_json(self.root / _FILE, {**config, "port": self.port})
            files = port, line, locks.Held(lock)
            self._process = python_process.start(
                "-m", "frida_painter_studio.stop_listener", self.root, *map(operating_system.number_of, files),
                json.dumps(config), files=files, stdout=log, stderr=log, **operating_system.APART,
            )  # fmt: skip
            files[2].hand(self._process)


def _cannot_start(error: OSError) -> StorageError:
    return StorageError(f"The listener for stops cannot be started ({error.strerror}).")


def main() -> None:
    """Serves with the inherited sockets."""
    folder, port, line, lock, config = sys.argv[1:]
    sockets = operating_system.inherited_socket(int(port)), operating_system.inherited_socket(int(line))
    os.set_inheritable(operating_system.inherited_file(int(lock)), False)
    with contextlib.suppress(RuntimeError):  # the loop was stopped: another listener takes over
        asyncio.run(serve(Path(folder), *sockets, json.loads(config)))


if __name__ == "__main__":
    main()
