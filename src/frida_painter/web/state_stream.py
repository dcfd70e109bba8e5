"""Telling browsers what happens, as server-sent events: always the newest state, never a queue of old ones."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

from fastapi import HTTPException
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from frida_painter.session.events import Written
from frida_painter.web.feed import FeedReader
from frida_painter.web.folder import PaintingFolder, working

MOST_WATCHERS = 40
_BETWEEN_READS = 0.06  # seconds
_BETWEEN_TELLINGS = 0.1
_QUIET = 15.0  # seconds after which a sign of life is sent
_PATIENCE = 20.0  # seconds that a browser may take to accept a message


class Shown(Protocol):
    """A state that is folded from a feed."""

    def hear(self, event: Written) -> None:
        """Takes note of an event."""

    def shown(self, working: bool) -> dict[str, Any]:
        """All of it as plain values."""


def current(folder: PaintingFolder, fresh: Callable[[], Shown]) -> dict[str, Any]:
    """The state of a painting or a calibration now, read from its folder; `fresh` gives one that heard nothing yet."""
    state = fresh()
    for event in FeedReader(folder.feed).read():
        state.hear(event)
    return state.shown(working(folder))


@dataclass
class _Watched:
    """One painting that somebody watches: its state as text, and how many look."""

    folder: PaintingFolder
    state: Shown
    text: str = ""
    watchers: int = 0
    changed: asyncio.Event = field(default_factory=asyncio.Event)
    task: asyncio.Task[None] | None = None
    over: bool = False

    async def follow(self) -> None:
        reader = FeedReader(self.folder.feed)
        while True:
            for event in await asyncio.to_thread(reader.read):
                self.state.hear(event)
            text = json.dumps(self.state.shown(working(self.folder)))
            if text != self.text:
                self.text = text
                self.changed.set()
                self.changed = asyncio.Event()
            await asyncio.sleep(_BETWEEN_READS)


class StateStreams:
    """The states that browsers listen to; each feed is read once, however many listen."""

    def __init__(self) -> None:
        self._watched: dict[str, _Watched] = {}
        self.watchers = 0

    @asynccontextmanager
    async def states(
        self, identifier: str, folder: PaintingFolder, fresh: Callable[[], Shown]
    ) -> AsyncIterator[AsyncIterator[str]]:
        """The states of a painting as text, from the present one on; some are left out for whoever is slow."""
        watched = self._watched.setdefault(identifier, _Watched(folder, fresh()))
        watched.watchers += 1
        self.watchers += 1
        if watched.task is None:
            watched.task = asyncio.create_task(watched.follow())
        try:
            yield _following(watched)
        finally:
            self.watchers -= 1
            watched.watchers -= 1
            if watched.watchers == 0:
                watched.task.cancel()
                del self._watched[identifier]

    def end(self) -> None:
        """Lets all of them go: the studio is closed."""
        for watched in self._watched.values():
            watched.over = True
            watched.changed.set()


def require_room(streams: StateStreams) -> None:
    """Answers 503 where too many watch already."""
    if streams.watchers >= MOST_WATCHERS:
        raise HTTPException(503, "Too many are watching already; close another page first.")


async def _following(watched: _Watched) -> AsyncIterator[str]:
    last = ""
    while not watched.over:
        changed = watched.changed
        if watched.text != last:
            last = watched.text
            yield last
            await asyncio.sleep(_BETWEEN_TELLINGS)
        else:
            try:
                await asyncio.wait_for(changed.wait(), _QUIET)
            except TimeoutError:
                yield ""


class EventStream(Response):
    """The answer that tells states of one painting for as long as the browser listens."""

    media_type = "text/event-stream"

    def __init__(
        self, streams: StateStreams, identifier: str, folder: PaintingFolder, fresh: Callable[[], Shown]
    ) -> None:
        super().__init__()
        self._streams, self._identifier, self._folder, self._fresh = streams, identifier, folder, fresh

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Sends until the browser is gone, or does not take what is sent."""
        headers = [(b"content-type", b"text/event-stream"), (b"cache-control", b"no-store")]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        gone = asyncio.create_task(_gone(receive))
        telling = asyncio.create_task(self._tell(send))
        try:
            await asyncio.wait((gone, telling), return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (gone, telling):
                task.cancel()
            await asyncio.gather(gone, telling, return_exceptions=True)

    async def _tell(self, send: Send) -> None:
        async with self._streams.states(self._identifier, self._folder, self._fresh) as states:
            async for text in states:
                body = f"data: {text}\n\n" if text else ": still here\n\n"
                message = {"type": "http.response.body", "body": body.encode(), "more_body": True}
                await asyncio.wait_for(send(message), _PATIENCE)
        await send({"type": "http.response.body", "body": b"", "more_body": False})


async def _gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
