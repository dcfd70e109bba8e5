from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from frida_painter.system.event_log import FEED, EventLog
from frida_painter_studio.pace import find_pace
from frida_painter_studio.painting_state import PaintingPage
from frida_painter_studio.state import FeedStates
from frida_painter_studio.store import PaintingStore

PLANNED: list[dict[str, Any]] = [
    {"kind": "began", "at": 0.0, "what": "plan", "plan": 1, "detail": {"effort": 0.5}},
    {"kind": "result_found", "at": 0.0, "what": "plan", "plan": 1, "detail": {"strokes": 20, "seconds": 34.0}},
]


@pytest.fixture
def store(tmp_path: Path) -> PaintingStore:
    return PaintingStore(tmp_path)


OF_FEED = ("began", "result_found", "asked")


def write(store: PaintingStore, *lines: dict[str, Any]) -> None:
    folder = store.begin("A").folder
    folder.painting.mkdir()
    for path, ours in ((folder.feed, True), (folder.painting / "journal", False)):
        with EventLog(path, FEED) as log:
            for line in lines:
                at = line["at"]
                if (line["kind"] in OF_FEED) == ours:
                    when = at if isinstance(at, str) else datetime.fromtimestamp(at, UTC).isoformat()
                    log.append({**line, "at": when})


def pace(store: PaintingStore, *, real_time: bool) -> dict[str, float]:
    states = FeedStates(lambda folder: None)
    times = [states.view(entry.folder, PaintingPage, lambda page, truth: page.times) for entry in store.all()]
    return find_pace(times, real_time=real_time)


def strokes(first: int, last: int, since: float, each: float) -> list[dict[str, Any]]:
    """Strokes `first` to `last` of 20, the first one `each` seconds after `since`."""
    return [
        {"kind": "stroke_painted", "at": since + each * (done - first + 1), "done": done, "of": 20}
        for done in range(first, last + 1)
    ]


def look(at: float, done: int, until: float) -> list[dict[str, Any]]:
    """A look after `done` strokes, and the rest replanned until then."""
    planned = {"kind": "planned", "at": until, "done": done, "strokes": 20 - done, "loss_before": 1, "loss_after": 0.9}
    return [{"kind": "looked", "at": at, "done": done}, planned]


def test_the_pace_is_that_of_the_last_painting(store: PaintingStore) -> None:
    guessed = pace(store, real_time=False)
    assert pace(store, real_time=True)["painting"] > guessed["painting"] and not guessed["known"]
    begun = {"kind": "began", "at": 100.0, "what": "paint", "plan": 1}
    write(store, *PLANNED, begun, *strokes(1, 10, 107.0, 2.0), *look(130.0, 10, 140.0), *strokes(11, 20, 140.0, 2.0))
    found = pace(store, real_time=False)
    assert found == {"loading": 4.0, "planning": 3.0, "opening": 9.0, "painting": 2.0, "replanning": 2.0, "known": True}
    write(store, {"kind": "result_found", "what": "plan", "at": "yesterday"})
    assert pace(store, real_time=False) == found


def test_pauses_and_stops_are_not_counted_and_what_was_painted_around_them_is(store: PaintingStore) -> None:
    begun = {"kind": "began", "at": 100.0, "what": "paint", "plan": 1}
    paused = [{"kind": "paused", "at": 117.0, "reason": "You asked for a pause."}, {"kind": "went_on", "at": 900.0}]
    stopped = [{"kind": "stopped", "at": 913.0, "done": 12}, {"kind": "session_resumed", "at": 5000.0, "done": 12}]
    parts = strokes(1, 6, 104.0, 2.0), paused, strokes(7, 12, 900.0, 2.0), stopped, strokes(13, 20, 5030.0, 2.0)
    write(store, *PLANNED, begun, *(line for part in parts for line in part))
    found = pace(store, real_time=False)
    assert (found["opening"], found["painting"], found["known"]) == (6.0, 2.0, True)


def test_a_break_before_the_first_stroke_is_no_opening(store: PaintingStore) -> None:
    begun = {"kind": "began", "at": 100.0, "what": "paint", "plan": 1}
    resumed = {"kind": "session_resumed", "at": 90_000.0, "done": 0}
    write(store, *PLANNED, begun, resumed, *strokes(1, 20, 90_007.0, 2.0))
    assert pace(store, real_time=False)["opening"] == 15.0


@pytest.mark.parametrize(("asked", "opening"), [(102.0, 15.0), (120.0, 6.0)])
def test_a_start_in_which_a_person_was_asked_tells_nothing_of_the_easel(
    store: PaintingStore, asked: float, opening: float
) -> None:
    begun = {"kind": "began", "at": 100.0, "what": "paint", "plan": 1}
    write(store, *PLANNED, begun, {"kind": "asked", "at": asked, "question": {}}, *strokes(1, 6, 104.0, 2.0))
    assert pace(store, real_time=False)["opening"] == opening


def test_one_slow_painting_does_not_change_what_is_expected_of_the_next(store: PaintingStore) -> None:
    for each in (1.0, 1.2, 60.0):
        write(
            store,
            *PLANNED,
            {"kind": "began", "at": 100.0, "what": "paint", "plan": 1},
            *strokes(1, 20, 100.0, each),
        )
    assert pace(store, real_time=False)["painting"] == pytest.approx(1.2)
