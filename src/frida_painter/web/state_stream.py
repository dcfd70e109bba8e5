"""Telling browsers what happens, as server-sent events: always the newest state, never a queue of old ones.

A browser has one stream for all that its pages show.
"""

import asyncio
import json
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import aclosing
from dataclasses import dataclass, field
from typing import Any

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from frida_painter.web.roles import Role

MOST_WATCHERS = {Role.watch: 40, Role.plan: 20, Role.operate: 20}
"""Streams at once, by role: those who watch leave the others theirs."""
MOST_TOPICS = 16
_BETWEEN_TELLINGS = 0.1  # seconds
_QUIET = 4.0  # seconds after which a sign of life is sent
_PATIENCE = 20.0  # seconds that a browser may take to accept a message


@dataclass(frozen=True)
class Topic:
    """Something that pages follow.

    name: as they ask for it; mark: changes whenever `read` gives something new; every: seconds between two looks.
    """

    name: str
    mark: Callable[[], object]
    read: Callable[[], Any]
    every: float = 0.06


@dataclass
class _Watched:
    """One topic that somebody watches: how it is as text, and those who want to hear of a change."""

    topic: Topic
    text: str = ""
    watchers: set[asyncio.Event] = field(default_factory=set)
    task: asyncio.Task[None] | None = None

    async def follow(self) -> None:
        mark: object = None
        while True:
            now = await asyncio.to_thread(self.topic.mark)
            if now != mark:
                mark = now
                text = json.dumps(await asyncio.to_thread(self.topic.read))
                if text != self.text:
                    self.text = text
                    for each in self.watchers:
                        each.set()
            await asyncio.sleep(self.topic.every)


class StateStreams:
    """The streams that browsers listen to; each topic is read once, however many listen."""

    def __init__(self) -> None:
        self._watched: dict[str, _Watched] = {}
        self._seats = dict.fromkeys(Role, 0)
        self._over = False

    def take_seat(self, role: Role) -> bool:
        """Whether there was a seat for one more stream of that role, which is taken then."""
        free = self._seats[role] < MOST_WATCHERS[role]
        self._seats[role] += free
        return free

    def leave_seat(self, role: Role) -> None:
        """Makes room for another."""
        self._seats[role] -= 1

    async def states(self, topics: Sequence[Topic]) -> AsyncGenerator[tuple[str, str], None]:
        """Topics by name with their states as text, from the present ones on; some are left out for whoever is slow.

        Two empty texts where nothing has happened for a while.
        """
        wake = asyncio.Event()
        watched = [self._watch(topic, wake) for topic in topics]
        told: dict[str, str] = {}
        try:
            while not self._over:
                wake.clear()
                for each in watched:
                    if each.text and each.text != told.get(each.topic.name):
                        told[each.topic.name] = each.text
                        yield each.topic.name, each.text
                try:
                    await asyncio.wait_for(wake.wait(), _QUIET)
                    await asyncio.sleep(_BETWEEN_TELLINGS)
                except TimeoutError:
                    yield "", ""
        finally:
            for each in watched:
                self._leave(each, wake)

    def _watch(self, topic: Topic, wake: asyncio.Event) -> _Watched:
        watched = self._watched.setdefault(topic.name, _Watched(topic))
        watched.watchers.add(wake)
        if watched.task is None:
            watched.task = asyncio.create_task(watched.follow())
        return watched

    def _leave(self, watched: _Watched, wake: asyncio.Event) -> None:
        watched.watchers.discard(wake)
        if not watched.watchers and watched.task is not None:
            watched.task.cancel()
            watched.task = None
            self._watched.pop(watched.topic.name, None)

    def end(self) -> None:
        """Lets all of them go: the studio is closed."""
        self._over = True
        for watched in self._watched.values():
            for each in watched.watchers:
                each.set()


class EventStream(Response):
    """The answer that tells the states of some topics for as long as the browser listens; it has a seat already."""

    media_type = "text/event-stream"

    def __init__(self, streams: StateStreams, role: Role, topics: Sequence[Topic]) -> None:
        super().__init__()
        self._streams, self._role, self._topics = streams, role, topics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Sends until the browser is gone, or does not take what is sent."""
        gone = telling = None
        try:
            headers = [(b"content-type", b"text/event-stream"), (b"cache-control", b"no-store")]
            await send({"type": "http.response.start", "status": 200, "headers": headers})
            gone = asyncio.create_task(_gone(receive))
            telling = asyncio.create_task(self._tell(send))
            await asyncio.wait((gone, telling), return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._streams.leave_seat(self._role)
            tasks = [task for task in (gone, telling) if task is not None]
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _tell(self, send: Send) -> None:
        async with aclosing(self._streams.states(self._topics)) as states:
            async for name, text in states:
                body = f"event: {name}\ndata: {text}\n\n" if name else ": still here\n\n"
                message = {"type": "http.response.body", "body": body.encode(), "more_body": True}
                await asyncio.wait_for(send(message), _PATIENCE)
        await send({"type": "http.response.body", "body": b"", "more_body": False})


async def _gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
