"""How long planning and painting take in this studio, from what the last paintings really took."""

from dataclasses import dataclass
from datetime import datetime

from frida_painter.event_log import LogReader
from frida_painter.session.events import (
    Paused,
    Stopped,
    StrokeLeftOut,
    StrokePainted,
    Written,
    events_of,
    time_of,
)
from frida_painter.session.page_events import Asked, PaintingKept, PaintingStarted, PlanMade, PlanRequested, TakenUp
from frida_painter.web.painting_store import PaintingStore

_LAST = 6  # paintings that are looked at
_LOADING = 4.0  # seconds before a plan begins to grow
_FEWEST = 10  # strokes that tell something


@dataclass
class StudioPace:
    """Seconds for loading, and per stroke for planning at effort 1 and for painting with all looks."""

    loading: float
    planning: float
    painting: float


def pace(store: PaintingStore, *, real_time: bool) -> StudioPace:
    """The pace to expect. real_time: whether the robot takes its time, rather than the computer's."""
    found = StudioPace(_LOADING, 0.1, 6.0 if real_time else 0.2)
    for entry in reversed(store.all()[:_LAST]):
        try:
            told = [(event, time_of(line)) for line in LogReader(entry.folder.feed).read() for event in events_of(line)]
            found.planning = _planning([event for event, _ in told]) or found.planning
            found.painting = _painting(told) or found.painting
        except (KeyError, TypeError, ValueError):
            continue  # another program wrote it
    return found


def _planning(told: list[Written]) -> float | None:
    requests = {event.plan: event.wish for event in told if isinstance(event, PlanRequested)}
    took = [
        max(0.0, event.seconds - _LOADING) / (event.strokes * requests[event.plan]["effort"])
        for event in told
        if isinstance(event, PlanMade) and event.strokes >= _FEWEST
    ]
    return took[-1] if took else None


def _painting(told: list[tuple[Written, datetime]]) -> float | None:
    """None where it was not painted in one go."""
    events = [event for event, _ in told]
    whole = any(isinstance(event, PaintingKept) for event in events)
    if not whole or any(isinstance(event, Paused | Stopped | TakenUp | Asked) for event in events):
        return None
    begun = next(at for event, at in told if isinstance(event, PaintingStarted))
    strokes = [at for event, at in told if isinstance(event, StrokePainted | StrokeLeftOut)]
    return (strokes[-1] - begun).total_seconds() / len(strokes) if len(strokes) >= _FEWEST else None
