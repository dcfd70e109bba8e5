"""How long planning and painting take in this studio, from what the last paintings really took."""

from dataclasses import dataclass
from typing import Any

from frida_painter.event_log import LogReader
from frida_painter.web.painting_store import PaintingStore

_LAST = 6  # paintings that are looked at
_LOADING = 4.0  # seconds before a plan begins to grow
_FEWEST = 10  # strokes that tell something


@dataclass
class Pace:
    """Seconds: loading, and for every stroke: planning at effort 1, painting with all looks."""

    loading: float
    planning: float
    painting: float


def pace(store: PaintingStore, *, real_time: bool) -> Pace:
    """The pace to expect. real_time: whether the robot takes its time, rather than the computer's."""
    found = Pace(_LOADING, 0.1, 6.0 if real_time else 0.2)
    for entry in reversed(store.all()[:_LAST]):
        lines = LogReader(entry.folder.feed).read()
        try:
            found.planning = _planning(lines) or found.planning
            found.painting = _painting(lines) or found.painting
        except (KeyError, TypeError):
            continue  # another program wrote it
    return found


def _planning(lines: list[dict[str, Any]]) -> float | None:
    wishes = {line["plan"]: line["wish"] for line in lines if line["kind"] == "wished"}
    took = [
        max(0.0, line["seconds"] - _LOADING) / (line["strokes"] * wishes[line["plan"]]["effort"])
        for line in lines
        if line["kind"] == "planned" and line["strokes"] >= _FEWEST
    ]
    return took[-1] if took else None


def _painting(lines: list[dict[str, Any]]) -> float | None:
    """None where it was not painted in one go."""
    kinds = {line["kind"] for line in lines}
    if "finished" not in kinds or kinds & {"paused", "stopped", "taken up", "asked"}:
        return None
    begun = next(line for line in lines if line["kind"] == "begun")
    strokes = [line for line in lines if line["kind"] == "stroke"]
    return (strokes[-1]["at"] - begun["at"]) / len(strokes) if len(strokes) >= _FEWEST else None
