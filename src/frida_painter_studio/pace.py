"""Pace of planning and painting in this studio, measured on its last paintings."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime
from statistics import median

from frida_painter.session import events
from frida_painter.session.events import Event
from frida_painter.session.time_left import measure_step

LAST = 6
"""Number of paintings in the measurement."""
_LOADING = 4.0  # seconds before a plan begins to grow
_OPENING = 15.0  # seconds before the first stroke
_FEWEST = 10  # fewest strokes for a measurement
_REPLANNING = 0.25  # time of a replan per stroke, as a share of the planning time per stroke
_BREAKS = (
    events.SessionResumed, events.Paused, events.WentOn, events.Stopped, events.PaintsWanted,
    events.Looked, events.Planned, events.Began,
)  # fmt: skip


@dataclass
class WorkTimes:
    """Measured seconds of one painting, computed from its events.

    Pauses, questions and the time between a stop and its resuming do not count.

    planning: of a planned stroke at effort 1, of each plan.
    strokes: between two strokes with no other event between them.
    replanning: of a replanned stroke at effort 1, of each look.
    """

    planning: list[float] = field(default_factory=list, init=False)
    strokes: list[float] = field(default_factory=list, init=False)
    replanning: list[float] = field(default_factory=list, init=False)
    _efforts: dict[int, float] = field(default_factory=dict, init=False)  # by plan
    _effort: float = field(default=1.0, init=False)
    _started: datetime | None = field(default=None, init=False)
    _first: datetime | None = field(default=None, init=False)
    _waits: list[datetime] = field(default_factory=list, init=False)  # of pauses, questions and resuming
    _stroke: datetime | None = field(default=None, init=False)
    _look: datetime | None = field(default=None, init=False)

    @property
    def opening(self) -> list[float]:
        """Seconds from the start to the first stroke, if there was no pause, question or break in between."""
        started, first = self._started, self._first
        if started is None or first is None or any(started <= wait <= first for wait in self._waits):
            return []
        return [_between(started, first)]

    def hear(self, event: Event, at: datetime) -> None:
        """Measures what an event of the feed or of the journal tells."""
        if isinstance(event, _BREAKS):
            self._stroke = None
        match event:
            case events.Began("plan", plan=plan, detail=wish):
                effort = wish.get("effort")
                self._effort = effort if isinstance(effort, float | int) and effort > 0 else 1.0
                self._efforts[plan] = self._effort
            case events.ResultFound("plan", plan=plan, detail={"strokes": int(strokes), "seconds": float(seconds)}):
                if strokes >= _FEWEST:
                    work = strokes * self._efforts.get(plan, 1.0)
                    self.planning.append(max(0.0, seconds - _LOADING) / work)
            case events.Began("paint"):
                self._started = at
            case events.Asked() | events.Paused() | events.SessionResumed():
                self._waits.append(at)
                self._look = None
            case events.StrokePainted() | events.StrokeLeftOut():
                if self._stroke is not None:
                    self.strokes.append(_between(self._stroke, at))
                self._first = self._first or at
                self._stroke = at
            case events.Looked():
                self._look = at
            case events.Planned() if self._look is not None and event.done and event.strokes >= _FEWEST:
                self.replanning.append(_between(self._look, at) / (event.strokes * self._effort))


def find_pace(last: Iterable[WorkTimes], *, real_time: bool) -> dict[str, float | bool]:
    """Returns the expected pace in seconds, for the page: the medians over the last paintings, or guesses.

    real_time: True if the robot moves in real time, False if it is simulated at the computer's speed.

    loading: of a planner. planning, replanning: of a stroke at effort 1, replanning at one look. opening: of the
    easel, until the first stroke. painting: of a stroke, without looks. known: True if it was measured here.
    An interrupted painting counts as much as an uninterrupted one.
    """
    paintings = list(last)
    strokes = [sum(each.strokes) / len(each.strokes) for each in paintings if len(each.strokes) >= _FEWEST - 1]
    planning = _median((one for each in paintings for one in each.planning), 0.1)
    return {
        "loading": _LOADING,
        "planning": planning,
        "opening": _median((one for each in paintings for one in each.opening), _OPENING),
        "painting": _median(strokes, 6.0 if real_time else 0.4),
        "replanning": _median((one for each in paintings for one in each.replanning), _REPLANNING * planning),
        "known": bool(strokes),
    }


def _between(before: datetime, after: datetime) -> float:
    return measure_step(before.timestamp(), after.timestamp())


def _median(measured: Iterable[float], guess: float) -> float:
    known = list(measured)
    return median(known) if known else guess
