import json
from typing import Any, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.session.events import TouchCorrected, Written, events_of
from frida_painter_studio.painting_state import PaintingState, Stage, Truth, tell_status

AT_WORK, AT_REST = Truth(working=True), Truth(working=False)

MADE = {"prefix": "", "frames": [0, 2, 4], "strokes": 4, "palette": []}
PLANNED: list[dict[str, Any]] = [
    {"kind": "plan_requested", "plan": 1, "wish": {"strokes": 4}},
    {"kind": "planning_progress", "plan": 1, "share": 0.5, "left": 3.0},
    {"kind": "plan_preview", "plan": 1, "picture": "growing-0000.jpg"},
    {"kind": "plan_made", "plan": 1, "nearer": 0.8, "seconds": 6.0, "mixtures": [], **MADE},
]
PAINTED: list[dict[str, Any]] = [
    {"kind": "painting_started", "plan": 1, "of": 4},
    {"kind": "mixing"},
    {"kind": "dipped", "paint": 2},
    {"kind": "stroke_painted", "done": 1, "of": 4},
    {"kind": "photograph_shown", "picture": "photograph-00000.jpg", "done": 1},
    {"kind": "look_shown", "done": 2, "seen": "a.jpg", "expected": "b.jpg", "difference": "c.jpg"},
    {"kind": "planning_progress", "share": 0.1, "left": 8.0},
    {"kind": "rest_replanned", "done": 2, "gain": 0.25, **MADE, "prefix": "plan-2-"},
    {"kind": "stroke_painted", "done": 3, "of": 4},
]


def told(*lines: dict[str, Any]) -> PaintingState:
    state = PaintingState()
    for line in lines:
        for event in understood(line):
            state.hear(event)
    return state


def understood(line: dict[str, Any]) -> list[Written]:
    try:
        return events_of(line)
    except ValueError:
        return []


def test_a_plan_grows_until_it_is_ready() -> None:
    growing = told(*PLANNED[:3]).to_plain(AT_WORK)["plans"][0]
    assert (growing["status"], growing["share"], growing["growing"]) == ("planning", 0.5, "growing-0000.jpg")
    ready = told(*PLANNED).to_plain(AT_REST)
    assert ready["plans"][0]["status"] == "ready" and ready["plans"][0]["made"]["frames"] == [0, 2, 4]
    assert ready["trouble"] == "" and ready["painting"] is None


def test_waits_before_the_first_picture_are_told_in_words() -> None:
    said = {"kind": "procedure_progress", "words": "A first picture is coloured for the words, in about 30 s."}
    (waits,) = told(PLANNED[0], said).to_plain(AT_WORK)["plans"]
    assert waits["said"] == said["words"] and waits["share"] == 0
    assert told(PLANNED[0], said, PLANNED[1]).to_plain(AT_WORK)["plans"][0]["said"] == ""
    later = told(*PLANNED, PAINTED[0], said).to_plain(AT_WORK)
    assert later["painting"]["said"] == said["words"] and later["plans"][0]["said"] == ""


def test_a_painting_is_followed_stroke_by_stroke() -> None:
    painting = told(*PLANNED, *PAINTED).to_plain(AT_WORK)["painting"]
    assert (painting["status"], painting["done"], painting["of"], painting["paint"]) == ("painting", 3, 4, 2)
    assert painting["looks"] == [
        {
            "done": 2, "seen": "a.jpg", "expected": "b.jpg", "difference": "c.jpg", "why": "", "gain": 0.25,
            "plan": "plan-2-plan.jpg",
        }
    ]  # fmt: skip
    assert painting["replanned"]["prefix"] == "plan-2-"


def test_how_long_the_paint_still_dries_is_shown() -> None:
    drying = {"kind": "drying", "done": 3, "seconds": 1200.0, "left": 660.0}
    painting = told(*PLANNED, *PAINTED, drying).to_plain(AT_WORK)["painting"]
    assert (painting["status"], painting["dries"]) == ("drying", 660.0)


def test_a_pause_holds_while_it_does_what_was_asked_for_in_it() -> None:
    paused = {"kind": "paused", "reason": "You asked for a pause.", "cause": "person"}
    asked = [*PLANNED, *PAINTED, paused, {"kind": "considering"}, PAINTED[5], PAINTED[7]]
    assert told(*PLANNED, *PAINTED).to_plain(AT_WORK)["painting"]["held"] is False
    for lines in ([*PLANNED, *PAINTED, paused], asked, [*asked, paused]):
        assert told(*lines).to_plain(AT_WORK)["painting"]["held"] is True
    assert told(*asked, {"kind": "went_on"}).to_plain(AT_WORK)["painting"]["held"] is False


STOPPED, FAILED = {"kind": "stopped"}, {"kind": "failed", "reason": "The robot is gone."}
KEPT = {"kind": "painting_kept", "film": True}
QUEUED = {"kind": "queued", "plan": 1, "job": "plan"}
AGAIN = {"kind": "plan_requested", "plan": 2, "wish": {}}
NO_STROKE = Truth(working=False, begun=False)
STATUSES: list[tuple[list[dict[str, Any]], Truth, str, bool, str]] = [
    # events, what is true, stage, can it be continued, a word of its trouble
    ([], AT_WORK, "plan failed", False, ""),
    (PLANNED[:2], AT_WORK, "planning", False, ""),
    (PLANNED[:2], AT_REST, "plan failed", False, "planner's process ended"),
    ([*PLANNED[:2], STOPPED], AT_WORK, "plan stopped", False, ""),
    ([*PLANNED[:2], STOPPED], AT_REST, "plan stopped", False, ""),
    ([*PLANNED[:2], FAILED], AT_REST, "plan failed", False, "robot is gone"),
    ([PLANNED[0], QUEUED], AT_REST, "waiting", False, ""),
    (PLANNED, AT_REST, "planned", False, ""),
    ([*PLANNED, {**QUEUED, "job": "paint"}], AT_REST, "queued", False, ""),
    ([*PLANNED, AGAIN], AT_WORK, "planning", False, ""),
    ([*PLANNED, AGAIN], AT_REST, "planned", False, "planner's process ended"),
    ([*PLANNED, AGAIN, STOPPED], AT_REST, "planned", False, ""),
    ([*PLANNED, PAINTED[0]], AT_WORK, "preparing", False, ""),
    ([*PLANNED, PAINTED[0]], NO_STROKE, "failed", False, "Nothing was painted yet"),
    ([*PLANNED, *PAINTED], AT_WORK, "painting", False, ""),
    ([*PLANNED, *PAINTED[:7]], AT_WORK, "replanning", False, ""),
    ([*PLANNED, *PAINTED], AT_REST, "failed", True, "painter's process ended"),
    ([*PLANNED, *PAINTED], Truth(working=False, room=False), "failed", True, "disk is full"),
    ([*PLANNED, *PAINTED, STOPPED], AT_WORK, "stopped", False, ""),
    ([*PLANNED, *PAINTED, STOPPED], AT_REST, "stopped", True, ""),
    ([*PLANNED, *PAINTED, STOPPED, {"kind": "finishing"}, KEPT], AT_REST, "stopped", True, ""),
    ([*PLANNED, *PAINTED, FAILED], AT_REST, "failed", True, "robot is gone"),
    ([*PLANNED, *PAINTED, FAILED, {"kind": "taken_up", "done": 3}], AT_WORK, "preparing", False, ""),
    ([*PLANNED, *PAINTED, FAILED, {"kind": "taken_up", "done": 3}], AT_REST, "failed", True, "painter's process"),
    ([*PLANNED, *PAINTED, KEPT], AT_REST, "finished", False, ""),
    ([*PLANNED, *PAINTED, KEPT, STOPPED], AT_REST, "finished", False, ""),
    ([*PLANNED, *PAINTED], Truth(working=True, here=False), "lost", False, "press Stop"),
    ([*PLANNED, *PAINTED], Truth(working=False, here=False), "lost", False, "Nothing of it is left"),
    ([], Truth(working=False, here=False), "lost", False, "was deleted"),
]  # fmt: skip


@pytest.mark.parametrize(("lines", "truth", "stage", "resumable", "says"), STATUSES)
def test_a_status_is_told_from_the_events_and_from_what_is_true(
    lines: list[dict[str, Any]], truth: Truth, stage: str, resumable: bool, says: str
) -> None:
    status = tell_status(told(*lines), truth)
    assert (status.stage, status.resumable, status.working) == (stage, resumable, truth.working)
    assert says in status.trouble if says else status.trouble == ""


def test_every_stage_is_tested() -> None:
    untested = {"mixing", "drying", "paused", "finishing"}  # as the events call them
    assert {stage for _, _, stage, *_ in STATUSES} | untested == set(get_args(Stage))


BUSY = {"planning", "preparing", "mixing", "painting", "drying", "replanning", "paused", "finishing"}


@given(st.lists(st.sampled_from([*PLANNED, *PAINTED, STOPPED, FAILED, KEPT, QUEUED, AGAIN]), max_size=12))
def test_nothing_is_called_busy_where_nobody_works_and_nothing_is_continued_where_somebody_does(lines: Any) -> None:
    state = told(*lines)
    for begun in (True, False):
        rests, works = (tell_status(state, Truth(working, begun=begun)) for working in (False, True))
        assert rests.stage not in BUSY and not works.resumable
        shown = state.to_plain(Truth(working=False, begun=begun))
        statuses = [each["status"] for each in (*shown["plans"], *([shown["painting"]] if shown["painting"] else []))]
        assert not set(statuses) & BUSY


def test_trouble_is_forgotten_when_something_else_is_begun() -> None:
    state = told(PLANNED[0], {"kind": "failed", "reason": "No."}, {"kind": "plan_requested", "plan": 2, "wish": {}})
    shown = state.to_plain(AT_WORK)
    assert shown["trouble"] == "" and [plan["status"] for plan in shown["plans"]] == ["failed", "planning"]


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
kinds = st.sampled_from(sorted({line["kind"] for line in PLANNED + PAINTED} | {"failed", "stopped", "finished", "?"}))
keys = st.sampled_from(["plan", "done", "of", "share", "picture", "made", "sentence", "wish", "frames", "left"])


@given(st.lists(st.tuples(kinds, st.dictionaries(keys, json_values, max_size=5)), max_size=8))
def test_whatever_stands_in_the_feed_something_can_be_shown(lines: list[tuple[str, dict[str, Any]]]) -> None:
    state = told(*PLANNED, *({"kind": kind, **facts} for kind, facts in lines))
    assert json.loads(json.dumps(state.to_plain(AT_WORK)))["version"] >= len(PLANNED)
    assert all(tell_status(state, truth).stage in get_args(Stage) for truth in (AT_WORK, AT_REST))


def test_a_look_tells_what_a_person_had_asked_for_before_it() -> None:
    look = {"kind": "look_shown", "done": 3, "seen": "a.jpg", "expected": "b.jpg", "difference": "c.jpg"}
    considering, went_on = {"kind": "considering"}, {"kind": "went_on"}
    region = {"kind": "region_protected", "region": "regions/1.png", "picture": "region-1.png"}
    asked: dict[str, list[dict[str, Any]]] = {
        "region": [considering, {**region, "only": False}],
        "only": [considering, {**region, "only": True}],
        "freed": [considering, {"kind": "region_protected", "region": None}],
        "goal": [considering, {"kind": "goal_changed", "goal": "changes/1", "wish": {"terms": []}}],
        "asked": [considering],
    }
    for why, lines in asked.items():
        shown = told(*PLANNED, *PAINTED, *lines, look, went_on, look).to_plain(AT_WORK)["painting"]
        assert [each["why"] for each in shown["looks"][-2:]] == [why, ""], why


def test_a_look_tells_that_a_brush_is_sent_lower_or_higher_from_then_on() -> None:
    look = {"kind": "look_shown", "done": 3, "seen": "a.jpg", "expected": "b.jpg", "difference": "c.jpg"}
    corrected = [{"kind": "touch_corrected", "brush": "fine", "lower": lower, "done": 3} for lower in (0.0008, -0.0011)]
    looks = told(*PLANNED, *PAINTED, look, *corrected, look).to_plain(AT_WORK)["painting"]["looks"]
    assert "touch" not in looks[-1]
    lower, higher = looks[-2]["touch"]
    assert "as it was calibrated again" in TouchCorrected("fine", -0.00001, 3).sentence
    assert "fine brush" in lower and "0.8 mm lower" in lower and "1.1 mm higher" in higher


def test_dips_into_each_well_are_counted_and_strokes_since_the_last() -> None:
    first, third = {"kind": "dipped", "paint": 0}, {"kind": "dipped", "paint": 2}
    strokes = [{"kind": "stroke_painted", "done": done, "of": 9} for done in (1, 2, 3, 4)]
    begun = {"kind": "painting_started", "plan": 1, "of": 9}
    lines = [begun, first, strokes[0], third, strokes[1], strokes[2], third, strokes[3]]
    painting = told(*PLANNED, *lines).to_plain(AT_WORK)["painting"]
    assert (painting["paint"], painting["dips"], painting["since_dip"]) == (2, {0: 1, 2: 2}, 1)
