"""States of paintings and of the calibration for the page, computed from their feeds alone, and their streams."""

import asyncio
import json
from collections import OrderedDict
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import aclosing
from dataclasses import asdict, dataclass, field
from threading import Lock
from typing import Any, Protocol, TypeVar

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from frida_painter.session.events import (
    Answered,
    Asked,
    BrushInHand,
    CalibrationStarted,
    CalibrationStatus,
    Considering,
    Dequeued,
    Dipped,
    Drying,
    Failed,
    Finishing,
    GoalChanged,
    LastLookDoubted,
    LayerBegun,
    LookShown,
    Mixing,
    PaintingKept,
    PaintingStarted,
    Paused,
    PhotographShown,
    PlanMade,
    PlanningProgress,
    PlanPreview,
    PlanRequested,
    ProcedureBegan,
    ProcedureFound,
    ProcedureProgress,
    Queued,
    RegionProtected,
    Remark,
    RestReplanned,
    Stopped,
    StrokeLeftOut,
    StrokePainted,
    TakenUp,
    TimeLeft,
    TouchCorrected,
    Turns,
    WentOn,
    Written,
)
from frida_painter.web.commands import Role
from frida_painter.web.studio_folder import PROCEDURES, FeedReader, PaintingFolder, working

# State of the calibration, computed from its feed.


@dataclass
class ProcedureState:
    """State of one procedure in this or the last calibration.

    status: "", "waiting", "busy", "done", "failed" or "stopped".
    sentence, picture: its result.
    dated: date of its entry in the record, None if there is none.
    fault: reason to repeat it.
    old: True if it is old.
    """

    name: str
    status: str = ""
    sentence: str = ""
    picture: str | None = None
    dated: str | None = None
    fault: str = ""
    old: bool = False


@dataclass
class CalibrationState:
    """State of all procedures of an easel.

    question: open question, in the form of web/painter.py.
    progress: progress in words.
    """

    easel: str = ""
    procedures: dict[str, ProcedureState] = field(
        default_factory=lambda: {name: ProcedureState(name) for name in PROCEDURES}
    )
    question: dict[str, Any] | None = None
    progress: str = ""
    trouble: str = ""
    stopped: bool = False
    version: int = 0

    def hear(self, event: Written) -> None:
        """Updates the state by an event; other events change nothing."""
        self.version += 1
        try:
            self._hear(event)
        except (KeyError, TypeError):  # of a procedure that no longer exists
            return

    def to_plain(self, working: bool) -> dict[str, Any]:
        """Returns the state as plain values."""
        unfinished = any(each.status in ("waiting", "busy") for each in self.procedures.values())
        vanished = "The calibration ended in the middle of its work, without saying why; is the disk full?"
        return {
            "version": self.version,
            "working": working,
            "easel": self.easel,
            "procedures": [asdict(each) for each in self.procedures.values()],
            "question": self.question if working else None,
            "progress": self.progress if working else "",
            "stopped": self.stopped,
            "trouble": self.trouble or (vanished if unfinished and not working and not self.stopped else ""),
        }

    def _hear(self, event: Written) -> None:
        match event:
            case CalibrationStarted(what):
                self.trouble, self.stopped, self.question, self.progress = "", False, None, ""
                for name, each in self.procedures.items():
                    each.status = "waiting" if name in what else ""
            case CalibrationStatus(easel, procedures):
                self.easel = easel
                for stands in procedures:
                    each = self.procedures[stands["name"]]
                    each.dated, each.fault, each.old = stands["dated"], stands["fault"], stands["old"]
            case ProcedureBegan(name):
                self.procedures[name].status, self.progress = "busy", ""
            case ProcedureProgress(words):
                self.progress = words
            case Asked(question):
                self.question = question
            case Answered():
                self.question = None
            case ProcedureFound(name, sentence, picture):
                each = self.procedures[name]
                each.sentence, each.picture, each.status = sentence, picture, "done"
            case Failed(reason):
                self.trouble = reason
                self._end("failed")
            case Stopped():
                self.stopped = True
                self._end("stopped")
            case _:
                pass

    def _end(self, how: str) -> None:
        self.question = None
        for each in self.procedures.values():
            if each.status in ("waiting", "busy"):
                each.status = how if each.status == "busy" else ""


# Cache of states, so that a feed is not read again for each request.

_MAX_KEPT = 500  # states


class Shown(Protocol):
    """State that is computed from a feed.

    version: number that grows with every event.
    """

    version: int

    def hear(self, event: Written) -> None:
        """Updates the state by an event."""

    def to_plain(self, working: bool) -> dict[str, Any]:
        """Returns the state as plain values."""


Seen = TypeVar("Seen")


class FeedStates:
    """States of paintings and of the calibration; each one is computed from its feed once, then updated."""

    def __init__(self) -> None:
        self._kept: OrderedDict[str, tuple[FeedReader, Any, Lock]] = OrderedDict()
        self._turn = Lock()

    def current(self, folder: PaintingFolder, fresh: Callable[[], Shown]) -> dict[str, Any]:
        """Returns the current state as plain values; `fresh` makes an empty one."""
        return self.view(folder, fresh, lambda state: state.to_plain(working(folder)))

    def view(self, folder: PaintingFolder, fresh: Callable[[], Any], look: Callable[[Any], Seen]) -> Seen:
        """Returns the result of `look` for the current state."""
        name = str(folder.path)
        with self._turn:
            if name not in self._kept:
                self._kept[name] = (FeedReader(folder.feed), fresh(), Lock())
            reader, state, turn = self._kept[name]
            self._kept.move_to_end(name)
            if len(self._kept) > _MAX_KEPT:
                self._kept.popitem(last=False)
        with turn:
            for event in reader.read():
                state.hear(event)
            return look(state)


_MAX_LOOKS = 200


@dataclass
class PlanState:
    """State of one plan.

    status: "waiting", "planning", "ready", "failed" or "stopped". The other fields: as the worker reports them.
    """

    number: int
    wish: dict[str, Any]
    status: str = "planning"
    share: float = 0.0
    left: float | None = None
    growing: str | None = None
    nearer: float = 0.0
    made: dict[str, Any] | None = None


@dataclass
class PaintState:
    """State of the painting process.

    status: "preparing", "mixing", "painting", "drying", "planning", "paused", "finishing", "finished", "stopped" or
    "failed".
    dries: seconds that the paint still dries, 0 if nothing waits for it.
    plan: number of its plan.
    held: True in a pause, also while a command is performed there.
    turn: True if it is the person's turn.
    turns: strokes of the robot's turn, 0 without turns.

    region: protected region.
    remark: reason why a command could not be done as asked.
    wish: request of a changed goal.
    brush: brush in the hand, "" for none.
    first_paint: palette number, from 0, of the paint in the first well.
    paint: palette number of the paint on the brush, from 0.
    dips: number of dips into each paint.
    since_dip: strokes since the last dip.

    looks: looks in order: seen, expected and replanned. Each has a reason `why`: "region", "only", "freed", "goal"
    or "asked" for a person's command, else "".
    film, arm, kept: True if there is a film, a film of a simulated arm, and all other results.
    """

    plan: int
    of: int
    status: str = "preparing"
    done: int = 0
    left: float | None = None
    dries: float = 0.0
    share: float = 0.0
    photograph: str | None = None
    growing: str | None = None
    brush: str = ""
    first_paint: int = 0
    paint: int | None = None
    dips: dict[int, int] = field(default_factory=dict)
    since_dip: int = 0
    reason: str = ""
    looks: list[dict[str, Any]] = field(default_factory=list)
    replanned: dict[str, Any] | None = None
    held: bool = False
    turn: bool = False
    turns: int = 0
    region: dict[str, Any] | None = None
    remark: str = ""
    wish: dict[str, Any] | None = None
    why: str = ""  # reason of the next look
    film: bool = False
    arm: bool = False
    kept: bool = False


@dataclass
class PaintingState:
    """State of a painting from the first request to the last stroke.

    trouble: sentence about the last error, until other work begins.
    stopped: True after a stop.
    queued: "plan" or "paint" if this job waits in the studio's queue, else "".
    question: open question, in the form of web/painter.py.
    version: number that grows with every event.
    """

    plans: dict[int, PlanState] = field(default_factory=dict)
    painting: PaintState | None = None
    trouble: str = ""
    stopped: bool = False
    queued: str = ""
    question: dict[str, Any] | None = None
    version: int = 0

    def hear(self, event: Written) -> None:
        """Updates the state by an event; other events change nothing."""
        self.version += 1
        match event:
            case PlanRequested(number, wish):
                self._forget_trouble()
                self.plans[number] = PlanState(number, wish)
            case PlanningProgress(plan=int(number)) | PlanPreview(plan=int(number)) | PlanMade(plan=number):
                if number in self.plans:
                    _hear_plan(self.plans[number], event)
            case Queued(plan, job):
                self.queued = job
                if job == "plan" and plan in self.plans:
                    self.plans[plan].status = "waiting"
            case Dequeued(plan, begun):
                self.queued = ""
                if plan in self.plans and self.plans[plan].status == "waiting":
                    self.plans[plan].status = "planning" if begun else "stopped"
            case Asked(question):
                self.question = question
            case Answered():
                self.question = None
            case PaintingStarted(plan, of):
                self._forget_trouble()
                self.painting = PaintState(plan, of)
            case Failed(reason):
                self.trouble = reason
                self._end("failed")
            case Stopped():
                self.stopped = True
                self._end("stopped")
            case _ if self.painting is not None:
                if isinstance(event, TakenUp):
                    self._forget_trouble()
                _hear_painting(self.painting, event)
                if isinstance(event, PaintingKept) and self.stopped:
                    self.painting.status = "stopped"
            case _:
                pass

    def to_plain(self, working: bool) -> dict[str, Any]:
        """Returns the state as plain values; a worker that ended without an event is reported as an error."""
        shown = {
            "version": self.version,
            "working": working,
            "stopped": self.stopped,
            "trouble": self.trouble,
            "queued": self.queued,
            "question": self.question if working else None,
            "plans": [asdict(plan) for plan in self.plans.values()],
            "painting": None if self.painting is None else asdict(self.painting),
        }
        if not working and not self.trouble and not self.stopped and self._is_unfinished():
            shown["trouble"] = "The painter stopped in the middle of its work, without saying why; is the disk full?"
        return shown

    @property
    def stage(self) -> str:
        """Stage in one word, for the gallery."""
        if self.painting is not None:
            return self.painting.status
        if self.queued == "plan":
            return "waiting"
        return "planned" if any(plan.status == "ready" for plan in self.plans.values()) else "planning"

    def _is_unfinished(self) -> bool:
        planning = any(plan.status == "planning" for plan in self.plans.values())
        return planning or (self.painting is not None and self.painting.status not in _ENDS)

    def _forget_trouble(self) -> None:
        self.trouble, self.stopped, self.question = "", False, None

    def _end(self, how: str) -> None:
        for plan in self.plans.values():
            if plan.status == "planning":
                plan.status = how
        if self.painting is not None and self.painting.status not in _ENDS:
            self.painting.status = how


def _hear_plan(plan: PlanState, event: PlanningProgress | PlanPreview | PlanMade) -> None:
    match event:
        case PlanningProgress(share, left):
            plan.share, plan.left = share, left
        case PlanPreview(picture):
            plan.growing = picture
        case PlanMade():
            plan.status, plan.share, plan.left, plan.nearer = "ready", 1.0, None, event.nearer
            plan.made = {name: getattr(event, name) for name in _MADE}


def _hear_painting(painting: PaintState, event: Written) -> None:
    painting.status = _STATUS.get(type(event), painting.status)
    if isinstance(event, LookShown | WentOn | RestReplanned):
        painting.remark = ""
    if isinstance(event, Paused | WentOn | TakenUp):
        painting.held = isinstance(event, Paused)
    match event:
        case TakenUp(done):
            painting.done, painting.film, painting.kept = done, False, False
        case LayerBegun(brush=brush, first_paint=first):
            painting.brush, painting.first_paint, painting.paint = brush, first, None
        case BrushInHand(brush):
            painting.brush = brush or ""
        case Dipped(well):
            paint = painting.first_paint + well
            painting.paint, painting.since_dip = paint, 0
            painting.dips[paint] = painting.dips.get(paint, 0) + 1
        case Drying(left=seconds):
            painting.dries = seconds
        case StrokePainted(done, of) | StrokeLeftOut(done, of):
            painting.done, painting.of = done, of or painting.of
            painting.since_dip += isinstance(event, StrokePainted)
        case TimeLeft(seconds):
            painting.left = seconds
        case PhotographShown(picture):
            painting.photograph = picture
        case LookShown():
            painting.growing = None
            painting.looks = [*painting.looks[-_MAX_LOOKS:], {**asdict(event), "why": painting.why}]
            painting.why = ""
        case TouchCorrected() | LastLookDoubted() if painting.looks:
            told = [*painting.looks[-1].get("touch", []), event.sentence]
            painting.looks[-1] = {**painting.looks[-1], "touch": told}
        case Considering():
            painting.why = "asked"
        case PlanningProgress(share, left):
            painting.share, painting.left = share, left
        case PlanPreview(picture):
            painting.growing = picture
        case RestReplanned():
            painting.growing, painting.share = None, 0.0
            painting.replanned = {name: getattr(event, name) for name in _REPLANNED}
            if painting.looks and painting.looks[-1]["done"] == event.done and "gain" not in painting.looks[-1]:
                more = {"gain": event.gain, "plan": f"{event.prefix}plan.jpg"}
                painting.looks[-1] = {**painting.looks[-1], **more}
        case Paused(reason=reason, turn=turn):
            painting.reason, painting.turn, painting.why = reason, turn, ""
        case Turns(strokes):
            painting.turns = strokes
        case RegionProtected(only=only, picture=picture):
            painting.region = {"picture": picture, "only": only} if picture else None
            painting.why = ("only" if only else "region") if picture else "freed"
        case GoalChanged(wish=wish):
            painting.wish, painting.why = wish, "goal"
        case Remark(sentence):
            painting.remark = sentence
        case PaintingKept(film, arm):
            painting.film, painting.arm, painting.left, painting.kept = film, arm, 0.0, True
        case _:
            pass


_MADE = ("prefix", "frames", "strokes", "palette", "mixtures", "seconds")
_REPLANNED = ("prefix", "frames", "strokes", "palette", "done")
# Status of a painting after an event; other events do not change it.
_STATUS: dict[type[Written], str] = {
    TakenUp: "preparing",
    Mixing: "mixing",
    Dipped: "painting",
    Drying: "drying",
    StrokePainted: "painting",
    StrokeLeftOut: "painting",
    LookShown: "planning",
    PlanningProgress: "planning",
    RestReplanned: "painting",
    Paused: "paused",
    Considering: "planning",
    WentOn: "painting",
    Finishing: "finishing",
    PaintingKept: "finished",
}
_ENDS = ("finished", "stopped", "failed")


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
    """Topic with watchers: its state as text, and the events that wake the watchers."""

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

    async def states(self, topics: Sequence[Topic]) -> AsyncGenerator[tuple[str, str], None]:
        """Yields (name, state as text) of topics: the current states, then changes; slow readers miss some.

        It yields two empty texts if nothing has changed for a while.
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
        """Ends all streams, because the studio closes."""
        self._over = True
        for watched in self._watched.values():
            for each in watched.watchers:
                each.set()


class EventStream(Response):
    """Answer that streams the states of topics while the browser listens; its seat is taken already."""

    media_type = "text/event-stream"

    def __init__(self, streams: StateStreams, role: Role, topics: Sequence[Topic]) -> None:
        super().__init__()
        self._streams, self._role, self._topics = streams, role, topics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Streams until the browser disconnects, or does not accept a message in time."""
        gone = telling = None
        try:
            headers = [(b"content-type", b"text/event-stream"), (b"cache-control", b"no-store")]
            await send({"type": "http.response.start", "status": 200, "headers": headers})
            gone = asyncio.create_task(_tell_gone(receive))
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


async def _tell_gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
