"""Connections to a server: so many at once, and each asks for something soon, or makes room for others.

Whoever opens connections and says nothing (a slow or half-open client, a handshake that never ends) keeps nobody else
out: where there are too many, those that have waited longest for a request are cut.
"""

import asyncio
import contextlib
import fcntl
import os
import resource
import socket
import ssl
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, Self

from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from frida_painter.errors import ConfigError
from frida_painter.web.commands import Role
from frida_painter.web.security import Session

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


# Locks on a studio's folder: held by every studio that is open there, and by the one listener for stops.


class StudioLock:
    """Shared by all studios that are open in a folder; taken alone by a listener for stops that is about to end."""

    def __init__(self, folder: Path, name: str = ".studio") -> None:
        self._file = os.open(folder / name, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)

    def share(self) -> None:
        """Holds it with others; waits for whoever has it alone."""
        fcntl.flock(self._file, fcntl.LOCK_SH)

    def take_alone(self) -> bool:
        """Whether nobody held it; it is held alone from now on."""
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def fileno(self) -> int:
        """What a child process needs to hold it too."""
        return self._file

    def release(self) -> None:
        """Lets others have it, once a child that holds it has ended, too."""
        os.close(self._file)


# How much one may ask of the studio: bytes, patience and requests, so that nobody's haste is felt at the easel.

MOST_UPLOAD = 32 * 2**20
MOST_BODY = 256 * 2**10
_PATIENCE = 30.0  # seconds for the whole body of a request, and for each part of an answer
_MOST_AT_ONCE = {Role.watch: 12, Role.plan: 10, Role.operate: 16}  # together fewer than there are threads for them
_MOST_UPLOADS = 4  # bodies in memory


class _NotRead(Exception):
    """Somebody asked for something, and does not read the answer."""


@dataclass
class Bucket:
    """Requests that somebody has left: `rate` more a second, never more than `most`."""

    rate: float
    most: float
    clock: Callable[[], float] = time.monotonic
    _left: dict[str, tuple[float, float]] = field(default_factory=dict)

    def take(self, who: str) -> bool:
        """Whether there was one left, which is gone then."""
        now = self.clock()
        left, at = self._left.get(who, (self.most, now))
        left = min(self.most, left + (now - at) * self.rate)
        if len(self._left) > 1000:
            self._left.clear()
        self._left[who] = (max(0.0, left - 1), now)
        return left >= 1


class Limits:
    """An ASGI application before another one, to which bodies are handed on whole. A stop is never counted.

    upload: path on which `MOST_UPLOAD` bytes may come; elsewhere `MOST_BODY`. Everybody has a quota, and so has every
    role as a whole: ten sessions may not ask ten times as much, and those who watch leave the others their share.
    """

    def __init__(self, app: ASGIApp, upload: str) -> None:
        self._app, self._upload = app, upload
        self._each, self._all = Bucket(rate=40, most=200), Bucket(rate=160, most=800)
        self._busy, self._uploading = dict.fromkeys(Role, 0), 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers 408, 413, 429 or 503 itself, or hands the request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        session: Session = scope["state"]["session"]
        path, role = scope["path"], session.role
        if path == "/api/stop":
            await self._hand_on(scope, receive, send)
        elif not (self._each.take(session.id) and self._all.take(role.name)):
            await _refused(429, "That was too much at once; wait a moment.")(scope, receive, send)
        elif path == "/api/events":  # has seats of its own
            await self._hand_on(scope, receive, send)
        elif self._busy[role] >= _MOST_AT_ONCE[role] or (path == self._upload and self._uploading >= _MOST_UPLOADS):
            await _refused(503, "The studio answers many others at the moment; try again.")(scope, receive, send)
        else:
            self._busy[role] += 1
            self._uploading += path == self._upload
            try:
                await self._hand_on(scope, receive, send)
            finally:
                self._busy[role] -= 1
                self._uploading -= path == self._upload

    async def _hand_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        most = MOST_UPLOAD if scope["path"] == self._upload else MOST_BODY
        try:
            async with asyncio.timeout(_PATIENCE):
                body = await _read(receive, most)
        except TimeoutError:
            await _refused(408, "That took too long to arrive.")(scope, receive, send)
            return
        if body is None:
            given = f"{most // 2**20} MB" if most >= 2**20 else f"{most // 2**10} KB"
            await _refused(413, f"That is too large: at most {given} may be sent here.")(scope, receive, send)
            return

        async def patient(message: Message) -> None:
            """Nobody is waited for who does not read."""
            try:
                async with asyncio.timeout(_PATIENCE):
                    await send(message)
            except TimeoutError:
                raise _NotRead from None

        with contextlib.suppress(_NotRead):
            await self._app(scope, _replaying(body, receive), patient)


async def _read(receive: Receive, most: int) -> bytes | None:
    """The whole body of a request; None where it is larger than it may be."""
    body = bytearray()
    while True:
        message = await receive()
        body += message.get("body", b"")
        if len(body) > most:
            return None
        if message["type"] != "http.request" or not message.get("more_body", False):
            return bytes(body)


def _replaying(body: bytes, receive: Receive) -> Receive:
    told = False

    async def receiving() -> Message:
        nonlocal told
        if told:  # what comes now is that the browser has gone
            return await receive()
        told = True
        return {"type": "http.request", "body": body, "more_body": False}

    return receiving


def _refused(status: int, sentence: str) -> JSONResponse:
    return JSONResponse({"sentence": sentence}, status)


# The certificate of a studio that is reached over a network.


@dataclass(frozen=True)
class Certificate:
    """A certificate (with the chain above it) and its private key, both PEM files; the key has no passphrase."""

    certificate: Path
    key: Path

    @classmethod
    def given(cls, certificate: Path | None, key: Path | None) -> Self | None:
        """As on a command line, checked; None where neither was given. Raises ConfigError."""
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
        """How connections are encrypted with it. Raises ConfigError where the files do not fit."""
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
