"""Serving the studio: on which address, with which tokens, and what is printed about it."""

import contextlib
import socket
import sys
import threading
from collections.abc import Callable

import uvicorn

from frida_painter.errors import ConfigError
from frida_painter.web.access import Keys, Role
from frida_painter.web.app import application, guarded
from frida_painter.web.painting_store import PaintingStore
from frida_painter.web.presence import Presence
from frida_painter.web.state_stream import StateStreams
from frida_painter.web.studio_easel import LOCAL, StudioEasel

_BACKLOG = 256


class _Server(uvicorn.Server):
    """Lets those go who watch before it waits for all requests to end."""

    def __init__(self, config: uvicorn.Config, streams: StateStreams) -> None:
        super().__init__(config)
        self._streams = streams

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Ends the server."""
        self._streams.end()
        await super().shutdown(sockets)


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


def hosts(address: str, port: int, names: tuple[str, ...] = ()) -> frozenset[str]:
    """The names by which browsers may call a studio on that address."""
    known = {f"[{address}]" if ":" in address else address, *names}
    if address in (LOCAL, "::1"):
        known.add("localhost")
    return frozenset(f"{name}:{port}" for name in known)


def serve(
    store: PaintingStore,
    easel: StudioEasel,
    listening: socket.socket,
    names: tuple[str, ...],
    tell: Callable[[dict[Role, str]], None],
) -> None:
    """Serves the studio until it is interrupted; `tell` hears the address for each role once it can be opened.

    What is typed into the standard input meanwhile says that somebody stands at the machine.
    """
    address, port = listening.getsockname()[:2]
    known = hosts(address, port, names)
    keys, presence = Keys(), Presence()
    first = f"{names[0]}:{port}" if names else sorted(known)[0]
    app = application(store, easel, presence)
    config = uvicorn.Config(
        guarded(app, keys, known, f"studio-{port}"),
        log_level="warning",
        access_log=False,
        server_header=False,
        timeout_keep_alive=10,
        timeout_graceful_shutdown=2,
        http="h11",  # what access.py knows of
        ws="none",
        h11_max_incomplete_event_size=32 * 1024,
    )
    with contextlib.suppress(OSError, ValueError):  # there may be no standard input at all
        presence.listen(sys.stdin.fileno())
    threading.Thread(target=app.state.queue.run, daemon=True, name="queue").start()
    server = _Server(config, app.state.streams)
    tell({role: f"http://{first}/?token={token}" for role, token in keys.tokens.items()})
    server.run(sockets=[listening])
