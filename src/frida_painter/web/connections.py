"""Connections to a server: so many at once, and each asks for something soon, or makes room for others.

Whoever opens connections and says nothing (a slow or half-open client, a handshake that never ends) keeps nobody else
out: where there are too many, those that have waited longest for a request are cut.
"""

import asyncio
import contextlib
import resource
import socket
import ssl
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

_BETWEEN_SWEEPS = 0.5  # seconds
_MOST = 400


class Waiting(Protocol):
    """A protocol (asyncio) that tells since when it waits for a whole request, None while it serves one."""

    waiting_since: float | None


@dataclass(eq=False)
class _Connection:
    """One connection; the transport is None until encryption is agreed upon."""

    socket: socket.socket
    since: float
    task: asyncio.Task[None] | None = None
    transport: asyncio.Transport | None = None
    protocol: Waiting | None = None
    closing_since: float | None = None

    @property
    def waiting_since(self) -> float | None:
        return self.since if self.protocol is None else self.protocol.waiting_since

    def cut(self) -> None:
        if self.transport is not None:
            self.transport.abort()
        elif self.task is not None:
            self.task.cancel()
        # At once: what is only cancelled holds its file until the loop comes round to it.
        with contextlib.suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)


class Connections:
    """Takes in the connections of one listening socket, until the task that runs `accept` is cancelled.

    make: a new protocol for each; most: how many there may be at once; patience: seconds in which a whole request has
    to arrive, counted from the connection or from the end of the answer before; tls: how they are encrypted.
    """

    def __init__(
        self,
        listening: socket.socket,
        make: Callable[[], asyncio.Protocol],
        *,
        most: int,
        patience: float,
        tls: ssl.SSLContext | None = None,
    ) -> None:
        self._listening, self._make, self._most, self._patience, self._tls = listening, make, most, patience, tls
        self._open: list[_Connection] = []

    async def accept(self) -> None:
        """Takes in whoever comes."""
        loop = asyncio.get_running_loop()
        self._listening.setblocking(False)
        sweeping = loop.create_task(self._sweep())
        try:
            while True:
                try:
                    taken, _ = await loop.sock_accept(self._listening)
                except OSError:  # no file is left for it, or it is gone already
                    self._make_room(len(self._open) // 2)
                    await asyncio.sleep(0.02)
                    continue
                if self._make_room(self._most - 1):
                    connection = _Connection(taken, loop.time())
                    self._open.append(connection)
                    connection.task = loop.create_task(self._begin(connection))
                else:
                    taken.close()
        finally:
            sweeping.cancel()

    async def _begin(self, connection: _Connection) -> None:
        loop = asyncio.get_running_loop()
        patience = {} if self._tls is None else {"ssl_handshake_timeout": self._patience}
        try:
            connection.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            transport, protocol = await loop.connect_accepted_socket(
                self._make, connection.socket, ssl=self._tls, **patience
            )
            connection.transport, connection.protocol = transport, protocol  # type: ignore[assignment]
        except (OSError, asyncio.CancelledError):
            connection.socket.close()

    def _make_room(self, most: int) -> bool:
        """Cuts those that have waited longest, until at most so many are left; whether that was possible."""
        if len(self._open) > most:
            self._open = [each for each in self._open if each.socket.fileno() >= 0]
        if (over := len(self._open) - most) <= 0:
            return True
        waiting = [(since, each) for each in self._open if (since := each.waiting_since) is not None]
        gone = {each for _, each in sorted(waiting, key=lambda pair: pair[0])[:over]}
        for each in gone:
            each.cut()
        self._open = [each for each in self._open if each not in gone]
        return len(gone) == over

    async def _sweep(self) -> None:
        """Cuts those that have waited for too long."""
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(_BETWEEN_SWEEPS)
            self._open = [each for each in self._open if each.socket.fileno() >= 0]
            now = loop.time()
            for each in self._open:
                if each.closing_since is None and each.transport is not None and each.transport.is_closing():
                    each.closing_since = now  # what is still to be sent may never be read
                waits = [since for since in (each.waiting_since, each.closing_since) if since is not None]
                if waits and now - min(waits) > self._patience:
                    each.cut()


def most_connections() -> int:
    """How many connections a server may have, so that half of the files that it may open are left for other things."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return _MOST if files == resource.RLIM_INFINITY else max(16, min(_MOST, files // 2))
