"""Pace of planning and painting in this studio, measured on its last paintings."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime

from frida_painter.session import events
from frida_painter.session.events import Written
from frida_painter.session.time_left import Pace

LAST = 6
"""Number of paintings in the measurement."""
_LOADING = 4.0  # seconds before a plan begins to grow
_OPENING = 15.0  # seconds before the first stroke
_FEWEST = 10  # fewest strokes for a measurement
_REPLANNING = 0.25  # time of a replan per stroke, as a share of the planning time per stroke
_PAUSES = (
    events.Paused, events.WentOn, events.Asked, events.Answered, events.Stopped, events.Failed, events.Rests,
    events.TakenUp, events.PaintingStarted,
)  # fmt: skip
_BREAKS = (*_PAUSES, events.Mixing, events.LookShown, events.RestReplanned, events.Finishing)


@dataclass
class WorkTimes:
    """Measured seconds of one painting, computed from its events.

    Pauses, questions and the time between a stop and its resuming do not count.

    planning: of a planned stroke at effort 1, of each plan.
    opening: from the start to the first stroke, if there was no pause or question before it.
    strokes: between two strokes with no other event between them.
    replanning: of a replanned stroke at effort 1, of each look.
    """

    planning: list[float] = field(default_factory=list)
    opening: list[float] = field(default_factory=list)
    strokes: list[float] = field(default_factory=list)
    replanning: list[float] = field(default_factory=list)
    _efforts: dict[int, float] = field(default_factory=dict)  # by plan
    _effort: float = 1.0
    _started: datetime | None = None
    _stroke: datetime | None = None
    _look: datetime | None = None

    def hear(self, event: Written, at: datetime) -> None:
        """Measures what an event tells."""
        if isinstance(event, _BREAKS):
            self._stroke = None
        if isinstance(event, _PAUSES):
            self._started = self._look = None
        match event:
            case events.PlanRequested(plan, wish):
                effort = wish.get("effort")
                self._effort = effort if isinstance(effort, float | int) and effort > 0 else 1.0
                self._efforts[plan] = self._effort
            case events.PlanMade() if event.strokes >= _FEWEST:
                work = event.strokes * self._efforts.get(event.plan, 1.0)
                self.planning.append(max(0.0, event.seconds - _LOADING) / work)
            case events.PaintingStarted():
                self._started = at
            case events.StrokePainted() | events.StrokeLeftOut():
                if self._stroke is not None:
                    self.strokes.append((at - self._stroke).total_seconds())
                if self._started is not None and not self.opening and isinstance(event, events.StrokePainted):
                    self.opening.append((at - self._started).total_seconds())
                self._stroke = at
            case events.LookShown():
                self._look = at
            case events.RestReplanned() if self._look is not None and event.strokes >= _FEWEST:
                seconds = (at - self._look).total_seconds()
                self.replanning.append(seconds / (event.strokes * self._effort))


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


def _median(measured: Iterable[float], guess: float) -> float:
    return Pace.of_earlier_work(measured, guess).seconds
