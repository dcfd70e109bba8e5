"""Serving the studio: on which address, with which tokens, and what is printed about it."""

import asyncio
import contextlib
import socket
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from frida_painter.errors import ConfigError
from frida_painter.web.access import Keys
from frida_painter.web.app import application, guarded
from frida_painter.web.certificate import Certificate
from frida_painter.web.connections import Connections, most_connections
from frida_painter.web.painting_store import PaintingStore
from frida_painter.web.presence import Presence
from frida_painter.web.roles import Role
from frida_painter.web.state_stream import StateStreams
from frida_painter.web.stop_process import StopProcess
from frida_painter.web.studio_easel import LOCAL, StudioEasel
from frida_painter.web.studio_lock import StudioLock

_BACKLOG = 1024
_MOST_HEAD = 16 * 1024
_PATIENCE = 10.0  # seconds for the head of a request


class _Protocol(H11Protocol):
    """Tells since when it waits for a whole request, so that those who only wait can be cut."""

    waiting_since: float | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """From now on a request is waited for."""
        self.waiting_since = self.loop.time()
        super().connection_made(transport)

    def handle_events(self) -> None:
        """Reads on."""
        super().handle_events()
        if self.cycle is not None and not self.cycle.response_complete:
            self.waiting_since = None

    def on_response_complete(self) -> None:
        """The next request is waited for."""
        self.waiting_since = self.loop.time()
        super().on_response_complete()


class _Server(uvicorn.Server):
    """Takes in connections within limits, and lets those go who watch before it waits for all requests to end."""

    def __init__(
        self,
        config: uvicorn.Config,
        streams: StateStreams,
        listening: socket.socket,
        stop: StopProcess,
        certificate: Certificate | None,
    ) -> None:
        super().__init__(config)
        self._streams, self._listening, self._stop = streams, listening, stop
        self._tls = None if certificate is None else certificate.context()
        self._tasks: list[asyncio.Task[None]] = []

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begins to serve."""
        await super().startup(sockets=[])  # connections.py takes them in

        def make() -> asyncio.Protocol:
            return _Protocol(self.config, self.server_state, self.lifespan.state, asyncio.get_running_loop())

        connections = Connections(self._listening, make, most=most_connections(), patience=_PATIENCE, tls=self._tls)
        self._tasks = [asyncio.create_task(work) for work in (connections.accept(), self._stop.keep())]

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Ends the server."""
        for task in self._tasks:
            task.cancel()
        self._streams.end()
        await super().shutdown([self._listening])


def listen(address: str, port: int) -> socket.socket:
    """A socket on that address; port 0 takes a free one. Raises ConfigError where that cannot be had."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((address, port))
        listening.listen(_BACKLOG)  # from now on browsers wait rather than being refused
    except OSError as error:
        listening.close()
        raise ConfigError(
            f"--address {address} --port {port} cannot be used ({error.strerror}); give another one; "
            "port 0 takes one that is free."
        ) from error
    return listening


def names_of(address: str, names: tuple[str, ...] = ()) -> frozenset[str]:
    """What browsers may call this machine, where the studio listens on that address."""
    return frozenset({address, *names, *(("localhost",) if address in (LOCAL, "::1") else ())})


def hosts(address: str, port: int, names: tuple[str, ...] = ()) -> frozenset[str]:
    """The names, with the port, by which browsers may call a studio on that address."""
    return frozenset(f"[{name}]:{port}" if ":" in name else f"{name}:{port}" for name in names_of(address, names))


@dataclass(frozen=True)
class Links:
    """The addresses that open the studio: one for each role, as long as it is open; once: to operate, once, at once."""

    roles: dict[Role, str]
    once: str


def serve(
    store: PaintingStore,
    easel: StudioEasel,
    listening: socket.socket,
    names: tuple[str, ...],
    tell: Callable[[Links], None],
    stop_port: int = 0,
    certificate: Certificate | None = None,
) -> None:
    """Serves the studio until it is interrupted; `tell` hears how it is opened once it can be.

    What is typed into the standard input meanwhile says that somebody stands at the machine. stop_port: where stops are
    listened to, by default the port after that of the page. Raises ConfigError and StorageError.
    """
    address, port = listening.getsockname()[:2]
    StudioLock(store.root).share()
    called = names_of(address, names)
    stop = StopProcess(
        store.root, lambda wanted: listen(address, wanted), called, stop_port or min(port + 1, 65535), certificate
    )
    stop.start()
    known = hosts(address, port, names)
    keys, presence = Keys(), Presence()
    app = application(store, easel, presence)
    app.state.stop_process = stop
    config = uvicorn.Config(
        guarded(app, keys, known, f"studio-{port}", stop_hosts=hosts(address, stop.port, names)),
        log_level="warning",
        access_log=False,
        server_header=False,
        timeout_keep_alive=10,
        timeout_graceful_shutdown=2,
        ws="none",
        h11_max_incomplete_event_size=_MOST_HEAD,
    )
    with contextlib.suppress(OSError, ValueError):  # there may be no standard input at all
        presence.listen(sys.stdin.fileno())
    threading.Thread(target=app.state.queue.run, daemon=True, name="queue").start()
    server = _Server(config, app.state.streams, listening, stop, certificate)
    first = f"{names[0]}:{port}" if names else sorted(known)[0]
    studio = f"{'http' if certificate is None else 'https'}://{first}/?token="
    tell(Links({role: f"{studio}{token}" for role, token in keys.tokens.items()}, studio + keys.code(Role.operate)))
    server.run()
