"""Pace of planning and painting in this studio, measured on its last paintings."""

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from frida_painter.errors import StorageError
from frida_painter.event_log import LogReader
from frida_painter.session.events import (
    Answered,
    Asked,
    Failed,
    Finishing,
    LookShown,
    Mixing,
    PaintingStarted,
    Paused,
    PlanMade,
    PlanRequested,
    RestReplanned,
    Rests,
    Stopped,
    StrokeLeftOut,
    StrokePainted,
    TakenUp,
    WentOn,
    Written,
    events_of,
    time_of,
)
from frida_painter.session.time_left import Pace
from frida_painter.web.store import PaintingStore

_LAST = 6  # number of paintings in the measurement
_GOOD_FOR = 10.0  # seconds
_LOADING = 4.0  # seconds before a plan begins to grow
_OPENING = 15.0  # seconds before the first stroke
_FEWEST = 10  # fewest strokes for a measurement
_REPLANNING = 0.25  # time of a replan per stroke, as a share of the planning time per stroke

Told = tuple[Written, datetime]


@dataclass
class WorkPace:
    """Pace of a studio, in seconds.

    loading: loading a planner.
    planning: planning a stroke, at effort 1.
    opening: opening the easel, until the first stroke.
    painting: painting a stroke, without looks.
    replanning: replanning a stroke at one look, at effort 1.
    known: True if it was measured here, False for a guess.
    """

    loading: float
    planning: float
    opening: float
    painting: float
    replanning: float
    known: bool = False


class PaceMemory:
    """Cache of a studio's pace; feeds are read again only after a change, and not more often than every 10 s."""

    def __init__(self) -> None:
        self._mark: object = None
        self._at = -math.inf
        self._pace: WorkPace | None = None

    def pace(self, store: PaintingStore, *, real_time: bool) -> WorkPace:
        """Returns the pace, at most some seconds old."""
        if self._pace is None or time.monotonic() - self._at > _GOOD_FOR:
            mark = [_modification_mark(entry.folder.feed) for entry in store.all()[:_LAST]]
            self._at = time.monotonic()
            if self._pace is None or mark != self._mark:
                self._mark, self._pace = mark, pace(store, real_time=real_time)
        return self._pace


def _modification_mark(feed: Path) -> tuple[str, int, int]:
    try:
        found = feed.stat()
    except OSError:
        return str(feed), 0, 0
    return str(feed), found.st_mtime_ns, found.st_size


def pace(store: PaintingStore, *, real_time: bool) -> WorkPace:
    """Returns the expected pace: the median over the last paintings.

    real_time: True if the robot moves in real time, False if it is simulated at the computer's speed.
    Pauses, questions and the time between a stop and its resuming do not count. An interrupted painting counts as
    much as an uninterrupted one.
    """
    planning: list[float] = []
    opening: list[float] = []
    strokes: list[float] = []
    replanning: list[float] = []
    for entry in store.all()[:_LAST]:
        try:
            told = [(event, time_of(line)) for line in LogReader(entry.folder.feed).read() for event in events_of(line)]
            planning += _planning(event for event, _ in told)
            opening += _opening(told)
            strokes += _strokes(told)
            replanning += _replanning(told)
        except (KeyError, TypeError, ValueError, StorageError):
            continue  # another program or version wrote it
    per_stroke = Pace.of_earlier_work(planning, 0.1).seconds
    return WorkPace(
        loading=_LOADING,
        planning=per_stroke,
        opening=Pace.of_earlier_work(opening, _OPENING).seconds,
        painting=Pace.of_earlier_work(strokes, 6.0 if real_time else 0.4).seconds,
        replanning=Pace.of_earlier_work(replanning, _REPLANNING * per_stroke).seconds,
        known=bool(strokes),
    )


def _planning(told: Iterable[Written]) -> list[float]:
    efforts: dict[int, float] = {}
    took = []
    for event in told:
        if isinstance(event, PlanRequested):
            efforts[event.plan] = event.wish["effort"]
        elif isinstance(event, PlanMade) and event.strokes >= _FEWEST:
            took.append(max(0.0, event.seconds - _LOADING) / (event.strokes * efforts[event.plan]))
    return took


def _opening(told: Sequence[Told]) -> list[float]:
    """Returns the seconds until the first stroke, if there was no pause or question before it."""
    begun: datetime | None = None
    for event, at in told:
        if isinstance(event, PaintingStarted):
            begun = at
        elif isinstance(event, StrokePainted) and begun is not None:
            return [(at - begun).total_seconds()]
        elif isinstance(event, _PAUSES):
            begun = None
    return []


def _strokes(told: Sequence[Told]) -> list[float]:
    """Returns the seconds per stroke, measured between strokes with no other event between them."""
    took: list[float] = []
    last: datetime | None = None
    for event, at in told:
        if isinstance(event, StrokePainted | StrokeLeftOut):
            if last is not None:
                took.append((at - last).total_seconds())
            last = at
        elif isinstance(event, _BREAKS):
            last = None
    return [sum(took) / len(took)] if len(took) >= _FEWEST - 1 else []


def _replanning(told: Sequence[Told]) -> list[float]:
    """Returns the seconds per replanned stroke after each look, at effort 1."""
    took = []
    effort, last = 1.0, None
    for event, at in told:
        if isinstance(event, PlanRequested):
            effort = event.wish["effort"]
        elif isinstance(event, LookShown):
            last = at
        elif isinstance(event, RestReplanned) and last is not None and event.strokes >= _FEWEST:
            took.append((at - last).total_seconds() / (event.strokes * effort))
        elif isinstance(event, _PAUSES):
            last = None
    return took


_PAUSES = (Paused, WentOn, Asked, Answered, Stopped, Failed, Rests, TakenUp, PaintingStarted)
_BREAKS = (*_PAUSES, Mixing, LookShown, RestReplanned, Finishing)
