import json
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from frida_painter.session.events import TouchCorrected, Written, events_of
from frida_painter.web.state import PaintingState

MADE = {"prefix": "", "frames": [0, 2, 4], "strokes": 4, "palette": []}
PLANNED: list[dict[str, Any]] = [
    {"kind": "wished", "plan": 1, "wish": {"strokes": 4}},
    {"kind": "planning", "plan": 1, "share": 0.5, "left": 3.0},
    {"kind": "sprouting", "plan": 1, "picture": "growing-0000.jpg"},
    {"kind": "planned", "plan": 1, "nearer": 0.8, "seconds": 6.0, "mixtures": [], **MADE},
]
PAINTED: list[dict[str, Any]] = [
    {"kind": "begun", "plan": 1, "of": 4},
    {"kind": "mixing"},
    {"kind": "dipped", "paint": 2},
    {"kind": "stroke", "done": 1, "of": 4, "left": 9.0},
    {"kind": "photograph", "picture": "photograph-00000.jpg", "done": 1},
    {"kind": "looked", "done": 2, "seen": "a.jpg", "expected": "b.jpg", "difference": "c.jpg"},
    {"kind": "replanning", "share": 0.1, "left": 8.0},
    {"kind": "replanned", "done": 2, "gain": 0.25, **MADE, "prefix": "plan-2-"},
    {"kind": "stroke", "done": 3, "of": 4, "left": 2.0},
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
    growing = told(*PLANNED[:3]).to_plain(working=True)["plans"][0]
    assert (growing["status"], growing["share"], growing["growing"]) == ("planning", 0.5, "growing-0000.jpg")
    ready = told(*PLANNED).to_plain(working=False)
    assert ready["plans"][0]["status"] == "ready" and ready["plans"][0]["made"]["frames"] == [0, 2, 4]
    assert ready["trouble"] == "" and ready["painting"] is None


def test_a_painting_is_followed_stroke_by_stroke() -> None:
    painting = told(*PLANNED, *PAINTED).to_plain(working=True)["painting"]
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
    painting = told(*PLANNED, *PAINTED, drying).to_plain(working=True)["painting"]
    assert (painting["status"], painting["dries"]) == ("drying", 660.0)


def test_while_the_rest_is_planned_again_it_is_said_so() -> None:
    assert told(*PLANNED, *PAINTED[:7]).to_plain(working=True)["painting"]["status"] == "planning"


def test_a_pause_holds_while_it_does_what_was_asked_for_in_it() -> None:
    paused = {"kind": "paused", "reason": "You asked for a pause.", "turn": False}
    asked = [*PLANNED, *PAINTED, paused, {"kind": "considering"}, PAINTED[5], PAINTED[7]]
    assert told(*PLANNED, *PAINTED).to_plain(working=True)["painting"]["held"] is False
    for lines in ([*PLANNED, *PAINTED, paused], asked, [*asked, paused]):
        assert told(*lines).to_plain(working=True)["painting"]["held"] is True
    assert told(*asked, {"kind": "resumed"}).to_plain(working=True)["painting"]["held"] is False


def test_how_a_painting_ends_is_kept() -> None:
    stopped = told(*PLANNED, *PAINTED, {"kind": "stopped", "done": 3}).to_plain(working=False)
    assert stopped["painting"]["status"] == "stopped" and stopped["stopped"] and not stopped["trouble"]
    failed = told(*PLANNED, *PAINTED, {"kind": "failed", "sentence": "The robot is gone."}).to_plain(working=False)
    assert failed["painting"]["status"] == "failed" and failed["trouble"] == "The robot is gone."
    kept = told(*PLANNED, *PAINTED, {"kind": "stopped"}, {"kind": "finishing"}, {"kind": "finished", "film": True})
    assert kept.stage == "stopped" and kept.to_plain(working=False)["painting"]["kept"]
    finished = told(*PLANNED, *PAINTED, {"kind": "finished", "film": True}, {"kind": "stopped"})
    assert finished.stage == "finished"


def test_a_worker_that_vanished_is_noticed() -> None:
    state = told(*PLANNED, *PAINTED)
    assert state.to_plain(working=True)["trouble"] == ""
    assert "without saying why" in state.to_plain(working=False)["trouble"]
    assert "without saying why" in told(*PLANNED[:2]).to_plain(working=False)["trouble"]


def test_trouble_is_forgotten_when_something_else_is_begun() -> None:
    state = told(PLANNED[0], {"kind": "failed", "sentence": "No."}, {"kind": "wished", "plan": 2, "wish": {}})
    shown = state.to_plain(working=True)
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
    assert json.loads(json.dumps(state.to_plain(working=True)))["version"] >= len(PLANNED)
    assert isinstance(state.stage, str)


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
        shown = told(*PLANNED, *PAINTED, *lines, look, went_on, look).to_plain(working=True)["painting"]
        assert [each["why"] for each in shown["looks"][-2:]] == [why, ""], why


def test_a_look_tells_that_a_brush_is_sent_lower_or_higher_from_then_on() -> None:
    look = {"kind": "look_shown", "done": 3, "seen": "a.jpg", "expected": "b.jpg", "difference": "c.jpg"}
    corrected = [{"kind": "touch_corrected", "brush": "fine", "lower": lower, "done": 3} for lower in (0.0008, -0.0011)]
    looks = told(*PLANNED, *PAINTED, look, *corrected, look).to_plain(working=True)["painting"]["looks"]
    assert "touch" not in looks[-1]
    lower, higher = looks[-2]["touch"]
    assert "as it was calibrated again" in TouchCorrected("fine", -0.00001, 3).sentence
    assert "fine brush" in lower and "0.8 mm lower" in lower and "1.1 mm higher" in higher


def test_dips_into_each_well_are_counted_and_strokes_since_the_last() -> None:
    first, third = {"kind": "dipped", "paint": 0}, {"kind": "dipped", "paint": 2}
    strokes = [{"kind": "stroke_painted", "done": done, "of": 9} for done in (1, 2, 3, 4)]
    begun = {"kind": "begun", "plan": 1, "of": 9}
    lines = [begun, first, strokes[0], third, strokes[1], strokes[2], third, strokes[3]]
    painting = told(*PLANNED, *lines).to_plain(working=True)["painting"]
    assert (painting["paint"], painting["dips"], painting["since_dip"]) == (2, {0: 1, 2: 2}, 1)
