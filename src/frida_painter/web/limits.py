"""How much one may ask of the studio: bytes, patience and requests, so that nobody's haste is felt at the easel."""

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

MOST_UPLOAD = 32 * 2**20
MOST_BODY = 256 * 2**10
_PATIENCE = 30.0  # seconds for the whole body of a request


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

    upload: path on which `MOST_UPLOAD` bytes may come; elsewhere `MOST_BODY`.
    """

    def __init__(self, app: ASGIApp, upload: str, bucket: Bucket) -> None:
        self._app, self._upload, self._bucket = app, upload, bucket

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers 408, 413 or 429 itself, or hands the request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        who = scope["state"]["session"].id
        if not scope["path"].endswith("/stop") and not self._bucket.take(who):
            await _refused(429, "That was too much at once; wait a moment.")(scope, receive, send)
            return
        most = MOST_UPLOAD if scope["path"] == self._upload else MOST_BODY
        try:
            async with asyncio.timeout(_PATIENCE):
                body = await _read(receive, most)
        except TimeoutError:
            await _refused(408, "That took too long to arrive.")(scope, receive, send)
        else:
            if body is None:
                given = f"{most // 2**20} MB" if most >= 2**20 else f"{most // 2**10} KB"
                await _refused(413, f"That is too large: at most {given} may be sent here.")(scope, receive, send)
            else:
                await self._app(scope, _replaying(body, receive), send)


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
