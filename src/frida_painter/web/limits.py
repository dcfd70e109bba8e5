"""How much one may ask of the studio: bytes, patience and requests, so that nobody's haste is felt at the easel."""

import asyncio
import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from frida_painter.web.access import Session
from frida_painter.web.roles import Role

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
