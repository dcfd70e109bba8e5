"""States of paintings and jobs kept in memory, and their streams to browsers."""

import asyncio
import json
from collections import OrderedDict
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from threading import Lock
from typing import Any, TypeVar

from starlette.requests import ClientDisconnect
from starlette.responses import StreamingResponse
from starlette.types import Message, Receive, Scope, Send

from frida_painter.easel.kinds import JOURNAL
from frida_painter.system.event_log import LogReader
from frida_painter_studio.jobs import JobState
from frida_painter_studio.painting_state import PaintingPage, Truth
from frida_painter_studio.studio_folder import PaintingFolder, QueuedJob, read_events
from frida_painter_together.commands import Role

# Cache of states, so that a feed is not read again for each request.

_MAX_KEPT = 500  # states
_MAX_READS = 5


Shown = PaintingPage | JobState
Seen = TypeVar("Seen")


class FeedStates:
    """States of paintings and jobs; each one is computed from its files once, then updated.

    waits: returns the job for which a painting waits in the studio's queue.
    """

    def __init__(self, waits: Callable[[PaintingFolder], QueuedJob | None]) -> None:
        self._waits = waits
        self._kept: OrderedDict[str, tuple[Callable[[], int], Any, Lock]] = OrderedDict()
        self._turn = Lock()

    def knows(self, folder: PaintingFolder) -> bool:
        """Returns True if the state of that folder was read before, so that only its new events must be."""
        return str(folder.path) in self._kept

    def current(self, folder: PaintingFolder, fresh: Callable[[], Shown]) -> dict[str, Any]:
        """Returns the current state as plain values; `fresh` makes an empty one."""
        return self.view(folder, fresh, lambda state, truth: state.to_plain(truth))

    def view(self, folder: PaintingFolder, fresh: Callable[[], Any], look: Callable[[Any, Truth], Seen]) -> Seen:
        """Returns the result of `look` for the current state and the facts of the same moment."""
        name = str(folder.path)
        with self._turn:
            if name not in self._kept:
                state = fresh()
                self._kept[name] = (_follower(folder, state), state, Lock())
            follow, state, turn = self._kept[name]
            self._kept.move_to_end(name)
            if len(self._kept) > _MAX_KEPT:
                self._kept.popitem(last=False)
        with turn:
            follow()
            # A worker takes its lock before its first event, and releases it after the last one. So state and truth
            # agree if no event came while the truth was found.
            for _ in range(_MAX_READS):
                truth = Truth.of(folder, self._waits(folder))
                if not follow():
                    break
            return look(state, truth)


def _follower(folder: PaintingFolder, state: Any) -> Callable[[], int]:
    """Returns a function that tells the state its new events, of the feed and of the journal, and returns how many."""
    readers = [(LogReader(folder.feed), state.hear)]
    if isinstance(state, PaintingPage):
        state.place = str(folder.path)
        readers.append((LogReader(folder.painting / JOURNAL), state.hear_painting))

    def follow() -> int:
        count = 0
        for reader, hear in readers:
            for event, at in read_events(reader):
                hear(event, at)
                count += 1
        return count

    return follow


# Server-sent events to browsers: always the newest state, never a queue of old ones.
#
# A browser has one stream for all that its pages show.

MAX_WATCHERS = {Role.watch: 40, Role.plan: 20, Role.operate: 20}
"""Largest number of streams of each role; so watchers leave streams for other roles."""
MAX_TOPICS = 16
_BETWEEN_TELLINGS = 0.1  # seconds
_QUIET = 4.0  # seconds after which a keep-alive is sent
_PATIENCE = 20.0  # seconds within which a browser must accept a message


@dataclass(frozen=True)
class Topic:
    """State that pages follow.

    name: its name in requests.
    mark: returns a value that changes with the state.
    read: returns the state.
    every: seconds between two checks.
    """

    name: str
    mark: Callable[[], object]
    read: Callable[[], Any]
    every: float = 0.06


@dataclass
class _Watched:
    """Topic with watchers: its state as JSON, its number of changes, and the events that wake the watchers."""

    topic: Topic
    text: str = ""
    revision: int = 0
    watchers: set[asyncio.Event] = field(default_factory=set)
    task: asyncio.Task[None] | None = None

    def wake(self) -> None:
        for watcher in self.watchers:
            watcher.set()


class StateStreams:
    """Streams to browsers; each topic is read once for all of them."""

    def __init__(self) -> None:
        self._watched: dict[str, _Watched] = {}
        self._seats = dict.fromkeys(Role, 0)
        self._over = False

    def take_seat(self, role: Role) -> bool:
        """Takes a seat for a stream of that role; returns True if one was free."""
        free = self._seats[role] < MAX_WATCHERS[role]
        self._seats[role] += free
        return free

    def leave_seat(self, role: Role) -> None:
        """Releases a seat."""
        self._seats[role] -= 1

    async def tell(self, topics: Sequence[Topic]) -> AsyncGenerator[str, None]:
        """Yields messages with the current states of topics, then with changed ones; slow readers miss some.

        It yields a comment if nothing has changed for a while.
        """
        wake, told = asyncio.Event(), dict.fromkeys((topic.name for topic in topics), 0)
        watched = [self._watched.setdefault(topic.name, _Watched(topic)) for topic in topics]
        for each in watched:
            each.watchers.add(wake)
            each.task = each.task or asyncio.create_task(self._follow(each))
        try:
            while not self._over:
                wake.clear()
                for each in watched:
                    if each.revision > told[each.topic.name]:
                        told[each.topic.name] = each.revision
                        yield f"event: {each.topic.name}\ndata: {each.text}\n\n"
                try:
                    await asyncio.wait_for(wake.wait(), _QUIET)
                    await asyncio.sleep(_BETWEEN_TELLINGS)
                except TimeoutError:
                    yield ": still here\n\n"
        finally:
            for each in watched:
                each.watchers.discard(wake)
                if not each.watchers and each.task is not None:
                    each.task.cancel()
                    del self._watched[each.topic.name]

    async def _follow(self, watched: _Watched) -> None:
        mark: object = None
        while True:
            now = await asyncio.to_thread(watched.topic.mark)
            if now != mark:
                mark = now
                text = json.dumps(await asyncio.to_thread(watched.topic.read))
                if text != watched.text:
                    watched.text, watched.revision = text, watched.revision + 1
                    watched.wake()
            await asyncio.sleep(watched.topic.every)

    def end(self) -> None:
        """Ends all streams, because the studio closes."""
        self._over = True
        for watched in self._watched.values():
            watched.wake()


class EventStream(StreamingResponse):
    """Answer that streams the states of topics while the browser listens; its seat is taken already."""

    media_type = "text/event-stream"

    def __init__(self, streams: StateStreams, role: Role, topics: Sequence[Topic]) -> None:
        self._streams, self._role, self._messages = streams, role, streams.tell(topics)
        super().__init__(self._messages, headers={"cache-control": "no-store"})

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Streams until the browser disconnects, or does not accept a message in time."""

        async def send_in_time(message: Message) -> None:
            await asyncio.wait_for(send(message), _PATIENCE)

        try:
            with suppress(OSError, ClientDisconnect):  # a TimeoutError is one too
                await super().__call__(scope, receive, send_in_time)
        finally:
            self._streams.leave_seat(self._role)
            await self._messages.aclose()
