"""Limits of the web server: connections, locks, requests, and the certificate.

Clients that open connections and send nothing cannot block others. If there are too many connections, those that
have waited longest for a request are cut.
"""

import asyncio
import contextlib
import socket
import ssl
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from frida_painter.errors import ConfigError, StorageError
from frida_painter.system import locks, operating_system
from frida_painter_studio.security import Session, refuse
from frida_painter_together.commands import Role

_BETWEEN_SWEEPS = 0.5  # seconds
_MAX = 400


class WaitingProtocol(H11Protocol):
    """HTTP protocol that knows since when it waits for a request, so that idle connections can be cut.

    waiting_since: None while a request is served.
    for_body: True to wait for the whole body too; otherwise the application limits its time.
    """

    waiting_since: float | None = None

    def __init__(self, *given: Any, for_body: bool = False) -> None:
        super().__init__(*given)
        self._for_body = for_body

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Starts to wait for a request."""
        self.waiting_since = self.loop.time()
        super().connection_made(transport)

    def handle_events(self) -> None:
        """Handles events; stops waiting when a request is there."""
        super().handle_events()
        cycle = self.cycle
        if cycle is not None and not cycle.response_complete and not (self._for_body and cycle.more_body):
            self.waiting_since = None

    def on_response_complete(self) -> None:
        """Starts to wait for the next request."""
        self.waiting_since = self.loop.time()
        super().on_response_complete()


@dataclass(eq=False)
class _Connection:
    """One connection; the transport is None until the TLS handshake is done."""

    socket: socket.socket
    since: float
    task: asyncio.Task[None] | None = None
    transport: asyncio.Transport | None = None
    protocol: WaitingProtocol | None = None
    closing_since: float | None = None

    @property
    def waiting_since(self) -> float | None:
        return self.since if self.protocol is None else self.protocol.waiting_since

    def cut(self) -> None:
        if self.transport is not None:
            self.transport.abort()
        elif self.task is not None:
            self.task.cancel()
        # Shut down at once, because a cancelled connection keeps its file until the loop handles it.
        with contextlib.suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)


class Connections:
    """Accepts the connections of one listening socket, until the task of `accept` is cancelled.

    make: returns a new protocol for each connection.
    most: largest number of connections.
    patience: seconds within which a whole request must arrive, from the connection or from the last answer on.
    tls: encryption, if any.
    """

    def __init__(
        self,
        listening: socket.socket,
        make: Callable[[], WaitingProtocol],
        *,
        most: int,
        patience: float,
        tls: ssl.SSLContext | None = None,
    ) -> None:
        self._listening, self._make, self._most, self._patience, self._tls = listening, make, most, patience, tls
        self._open: list[_Connection] = []

    async def accept(self) -> None:
        """Accepts connections until it is cancelled."""
        loop = asyncio.get_running_loop()
        self._listening.setblocking(False)
        sweeping = loop.create_task(self._sweep())
        try:
            while True:
                try:
                    taken, _ = await loop.sock_accept(self._listening)
                except OSError:  # no file descriptor is left, or the client is gone
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
        patience = {} if self._tls is None else {"ssl_handshake_timeout": self._patience}
        try:
            connection.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.transport, connection.protocol = await asyncio.get_running_loop().connect_accepted_socket(
                self._make, connection.socket, ssl=self._tls, **patience
            )
        except (OSError, asyncio.CancelledError):
            connection.socket.close()

    def _make_room(self, most: int) -> bool:
        """Cuts the longest waiting connections until at most `most` are left; returns True if that was possible."""
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
        """Cuts connections that have waited too long."""
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(_BETWEEN_SWEEPS)
            self._open = [each for each in self._open if each.socket.fileno() >= 0]
            now = loop.time()
            for each in self._open:
                if each.closing_since is None and each.transport is not None and each.transport.is_closing():
                    each.closing_since = now  # the client may never read the rest
                waits = [since for since in (each.waiting_since, each.closing_since) if since is not None]
                if waits and now - min(waits) > self._patience:
                    each.cut()


def most_connections() -> int:
    """Returns the largest number of connections of a server; at least half of its file descriptors stay free."""
    return max(16, operating_system.allow_files(2 * _MAX) // 2)


STUDIO_LOCK = ".studio"
"""Lock file in a studio's folder that all open studios share; a listener for stops takes it alone before it ends."""
_ENDS_WITHIN = 5.0  # seconds


def share_lock(folder: Path) -> int:
    """Takes the lock of the open studios of a folder, once a listener that has it alone has ended; returns its file.

    Raises StorageError.
    """
    lock = locks.open_lock(folder / STUDIO_LOCK)
    if not locks.take(lock, _ENDS_WITHIN, shared=True):
        raise StorageError(
            f"{folder / STUDIO_LOCK} is locked by another process, which does not let go; end that process, or choose "
            "another folder with --folder."
        )
    return lock


# Limits of requests: bytes, time and rate, so that heavy use does not disturb the easel.

MAX_UPLOAD = 32 * 2**20
MAX_BODY = 256 * 2**10
_PATIENCE = 30.0  # seconds for the whole body of a request, and for each part of an answer
_MAX_AT_ONCE = {Role.watch: 12, Role.plan: 10, Role.operate: 16}  # together fewer than the threads of the pool
_MAX_UPLOADS = 4  # bodies in memory


class _NotRead(Exception):
    """Signal that a client does not read its answer."""


@dataclass
class Bucket:
    """Token bucket of requests: `rate` more a second, at most `most`."""

    rate: float
    most: float
    clock: Callable[[], float] = time.monotonic
    _left: dict[str, tuple[float, float]] = field(default_factory=dict)

    def take(self, who: str) -> bool:
        """Takes one request; returns True if one was left."""
        now = self.clock()
        left, at = self._left.get(who, (self.most, now))
        left = min(self.most, left + (now - at) * self.rate)
        if len(self._left) > 1000:
            self._left.clear()
        self._left[who] = (max(0.0, left - 1), now)
        return left >= 1


class Limits:
    """ASGI application that limits the requests to another one, and hands on whole bodies. Stops are not limited.

    upload: path for bodies of up to `MAX_UPLOAD` bytes; other paths allow `MAX_BODY`.
    Each session has a quota, and so has each role as a whole. Many sessions of a role together get no more, and
    watchers leave a share for other roles.
    """

    def __init__(self, app: ASGIApp, upload: str) -> None:
        self._app, self._upload = app, upload
        # A page is about 55 files, so ten pages may open at once, as when a browser comes back with all of its tabs.
        self._each, self._all = Bucket(rate=40, most=600), Bucket(rate=160, most=800)
        self._busy, self._uploading = dict.fromkeys(Role, 0), 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers 408, 413, 429 or 503, or hands the request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        session: Session = scope["state"]["session"]
        path, role = scope["path"], session.role
        uploads = path == self._upload
        free = path in ("/api/stop", "/api/events")  # of events, the seats are limited instead
        if path != "/api/stop" and not (self._each.take(session.id) and self._all.take(role.name)):
            await refuse(429, "That was too much at once; wait a moment.")(scope, receive, send)
        elif not free and (self._busy[role] >= _MAX_AT_ONCE[role] or (uploads and self._uploading >= _MAX_UPLOADS)):
            await refuse(503, "The studio answers many others at the moment; try again.")(scope, receive, send)
        else:
            self._busy[role] += not free
            self._uploading += uploads
            try:
                await self._hand_on(scope, receive, send, MAX_UPLOAD if uploads else MAX_BODY)
            finally:
                self._busy[role] -= not free
                self._uploading -= uploads

    async def _hand_on(self, scope: Scope, receive: Receive, send: Send, most: int) -> None:
        try:
            async with asyncio.timeout(_PATIENCE):
                body = await read_body(receive, most)
        except TimeoutError:
            await refuse(408, "That took too long to arrive.")(scope, receive, send)
            return
        if body is None:
            given = f"{most // 2**20} MB" if most >= 2**20 else f"{most // 2**10} KB"
            await refuse(413, f"That is too large: at most {given} may be sent here.")(scope, receive, send)
            return
        whole: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

        async def replay() -> Message:
            return whole.pop() if whole else await receive()  # then comes the disconnect

        async def send_soon(message: Message) -> None:
            """Sends a message, unless the client does not read it in time."""
            try:
                async with asyncio.timeout(_PATIENCE):
                    await send(message)
            except TimeoutError:
                raise _NotRead from None

        with contextlib.suppress(_NotRead):
            await self._app(scope, replay, send_soon)


async def read_body(receive: Receive, most: int) -> bytes | None:
    """Returns the whole body of a request; None if it is too large."""
    body = bytearray()
    while True:
        message = await receive()
        body += message.get("body", b"")
        if len(body) > most:
            return None
        if message["type"] != "http.request" or not message.get("more_body", False):
            return bytes(body)


# Certificate of a studio that is used over a network.


@dataclass(frozen=True)
class Certificate:
    """Certificate (with its chain) and its private key without a passphrase, both PEM files."""

    certificate: Path
    key: Path

    @classmethod
    def from_files(cls, certificate: Path | None, key: Path | None) -> Self | None:
        """Returns the certificate of the options, checked; None if both are missing. Raises ConfigError."""
        if certificate is None and key is None:
            return None
        if certificate is None or key is None:
            raise ConfigError("--certificate and --key belong together; give both, or neither.")
        for path in (certificate, key):
            if not path.is_file():
                raise ConfigError(f"{path} is no file; --certificate and --key are PEM files.")
        found = cls(certificate.absolute(), key.absolute())
        found.context()
        return found

    def context(self) -> ssl.SSLContext:
        """Returns the TLS context. Raises ConfigError if the files do not fit."""
        context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        try:
            context.load_cert_chain(self.certificate, self.key, password=lambda: b"")
        except (OSError, ssl.SSLError) as error:
            raise ConfigError(
                f"--certificate {self.certificate} and --key {self.key} cannot be used "
                f"({getattr(error, 'reason', None) or error.strerror or error}); "
                "give a PEM certificate and its own key, without a passphrase."
            ) from error
        return context
