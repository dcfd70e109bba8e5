import json
from typing import Any, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.session.events import (
    Advanced,
    Asked,
    Began,
    Dipped,
    Drying,
    Event,
    Finished,
    Looked,
    PaintingBegun,
    PaintsWanted,
    Paused,
    Planned,
    PlanningStep,
    Remark,
    ResultFound,
    SessionResumed,
    Stopped,
    StrokePainted,
    TimelapseFrame,
    events_of,
)
from frida_painter_studio.painting_state import PaintingPage, Stage, Truth

AT_WORK, AT_REST = Truth(working=True), Truth(working=False)
LOOK = {"seen": "a.jpg", "expected": "b.jpg", "difference": "c.jpg"}
MADE = {"prefix": "", "frames": [0, 2, 4], "strokes": 4, "palette": [], "nearer": 0.8, "seconds": 6.0}
PLANNED: list[Event] = [
    Began("plan", plan=1, detail={"strokes": 4}), Advanced("", 0.5, 3.0), Advanced(picture="growing-0000.jpg"),
    ResultFound("plan", plan=1, detail=MADE),
]  # fmt: skip
PAINT, AGAIN = Began("paint", plan=1), Began("plan", plan=2)
RESUME = Began("resume", plan=1, detail={"sittings": 1})
PAINTED: list[Event] = [
    PaintingBegun({}, {}), PaintsWanted(("#ffffff",)), Dipped(2), StrokePainted(1, 4),
    TimelapseFrame(1, 4, (0.0, 0.0, 0.0), "sketchbook/glimpse-000001.jpg"), Looked(2, LOOK),
    PlanningStep("replan", 1, 4, 0.5, "growing-0001.jpg"),
    Planned(2, 2, 0.4, 0.3, None, "d.jpg", {**MADE, "prefix": "plan-2-"}), StrokePainted(3, 4),
]  # fmt: skip
KEPT = ResultFound("results", detail={"film": True, "arm": False})
STOPPED, FAILED = Stopped(), Stopped("The robot is gone.")
REFUSED = ResultFound("refused", "It paints already.")  # a terminal has taken it up


def told(*feed: Event, journal: list[Event] | tuple[Event, ...] = ()) -> PaintingPage:
    page = PaintingPage()
    for event in feed:
        page.hear(event)
    for event in journal:
        page.hear_painting(event)
    return page


def test_a_plan_grows_until_it_is_ready() -> None:
    growing = told(*PLANNED[:3]).to_plain(AT_WORK)["plans"][0]
    assert (growing["status"], growing["share"], growing["growing"]) == ("planning", 0.5, "growing-0000.jpg")
    ready = told(*PLANNED).to_plain(AT_REST)
    assert ready["plans"][0]["status"] == "ready" and ready["plans"][0]["made"]["frames"] == [0, 2, 4]
    assert (ready["plans"][0]["made"]["nearer"], ready["trouble"], ready["painting"]) == (0.8, "", None)


def test_variants_grow_one_after_the_other_and_a_stop_keeps_those_that_are_made() -> None:
    ordered = [Began("plan", "beside" * (plan > 1), plan, {}) for plan in (1, 2, 3)]
    shown = told(*ordered, *PLANNED[1:], Advanced("", 0.25, 9.0)).to_plain(AT_WORK)
    assert [plan["status"] for plan in shown["plans"]] == ["ready", "planning", "planning"]
    assert [plan["share"] for plan in shown["plans"]] == [1.0, 0.25, 0.0]
    assert [plan["beside"] for plan in shown["plans"]] == [False, True, True] and shown["stage"] == "planning"
    stopped = told(*ordered, *PLANNED[1:], STOPPED).to_plain(AT_REST)
    assert [plan["status"] for plan in stopped["plans"]] == ["ready", "stopped", "stopped"]
    assert (stopped["stage"], stopped["trouble"]) == ("planned", "")


def test_waits_are_told_in_words() -> None:
    said = Advanced("A first picture is coloured for the words, in about 30 s.")
    (waits,) = told(PLANNED[0], said).to_plain(AT_WORK)["plans"]
    assert waits["said"] == said.words and waits["share"] == 0
    assert told(PLANNED[0], said, PLANNED[1]).to_plain(AT_WORK)["plans"][0]["said"] == ""
    later = told(*PLANNED, PAINT, said).to_plain(AT_WORK)
    assert later["painting"]["said"] == said.words and later["plans"][0]["said"] == ""


def test_a_painting_is_followed_stroke_by_stroke() -> None:
    page = told(*PLANNED, PAINT, journal=PAINTED)
    painting = page.to_plain(AT_WORK)["painting"]
    progress, brush, pictures = painting["progress"], painting["brush"], painting["pictures"]
    assert (painting["status"], progress["painted"], progress["of"], brush["paint"]) == ("painting", 3, 4, 2)
    (look,) = pictures["looks"]
    assert (look["done"], look["pictures"], look["why"], look["planned"]["look"]) == (2, LOOK, "", "d.jpg")
    assert (look["planned"]["loss_before"], look["planned"]["loss_after"], look["planned"]["shown"]) == (0.4, 0.3, {})
    replanned = painting["planning"]["replanned"]
    assert replanned["shown"]["prefix"] == "plan-2-" and replanned["done"] == 2
    assert (painting["plan"], brush["dips"], pictures["photograph"]) == (1, {2: 1}, "a.jpg")
    assert painting["end"]["results"] is None
    planning = told(*PLANNED, PAINT, journal=PAINTED[:7]).to_plain(AT_WORK)["painting"]
    assert (planning["status"], planning["planning"]["growing"]) == ("planning", "growing-0001.jpg")
    page.hear_painting(Drying(3, 660.0))
    page.hear_painting(Remark("0.8 mm lower", "touch", "fine"))
    page.hear_painting(ResultFound("found", "found.jpg"))
    drying = page.to_plain(AT_WORK)["painting"]
    assert (drying["status"], drying["progress"]["drying"]["left"]) == ("drying", 660.0)
    look = drying["pictures"]["looks"][-1]
    assert look["found"] == "found.jpg" and "0.8 mm lower" in look["touch"][0]
    page.hear_painting(KEPT)
    kept = page.to_plain(AT_REST)["painting"]
    assert (kept["status"], kept["end"]["results"], kept["left"]) == ("finished", ["film"], 0.0)


def test_a_question_is_open_until_it_is_answered_or_nobody_asks_any_more() -> None:
    asked = Asked({"id": "a", "kind": "confirm"})
    assert told(*PLANNED, PAINT, journal=[*PAINTED, asked]).to_plain(AT_WORK)["question"] == asked.question
    assert told(*PLANNED, PAINT, journal=[*PAINTED, asked]).to_plain(AT_REST)["question"] is None
    for over in (Asked(None), SessionResumed(3)):
        assert told(*PLANNED, PAINT, journal=[*PAINTED, asked, over]).to_plain(AT_WORK)["question"] is None


def test_no_path_is_shown() -> None:
    page = told(PAINT)
    page.place = "/studio/cup"
    sentences = "Look at /studio/cup/painting.", "Look at its folder/painting."
    for event in (PAINTED[0], Paused(sentences[0]), Remark(sentences[0]), Stopped(sentences[0])):
        page.hear_painting(event)
    shown = page.to_plain(AT_WORK)
    painting = shown["painting"]
    said = shown["trouble"], painting["wishes"]["pause"]["reason"], painting["people"]["remark"]
    assert set(said) == {sentences[1]} and page.place not in json.dumps(shown)


NO_STROKE = Truth(working=False, begun=False)
ENDED = [*PAINTED, STOPPED]
STATUSES: list[tuple[list[Event], list[Event], Truth, str, bool, str]] = [
    # feed, journal, what is true, stage, can it be continued, a word of its trouble
    ([], [], AT_WORK, "plan failed", False, ""),
    (PLANNED[:2], [], AT_WORK, "planning", False, ""),
    (PLANNED[:2], [], AT_REST, "plan failed", False, "planner's process ended"),
    ([*PLANNED[:2], STOPPED], [], AT_WORK, "plan stopped", False, ""),
    ([*PLANNED[:2], STOPPED], [], AT_REST, "plan stopped", False, ""),
    ([*PLANNED[:2], FAILED], [], AT_REST, "plan failed", False, "robot is gone"),
    ([PLANNED[0]], [], Truth(working=False, queued="plan"), "waiting", False, ""),
    (PLANNED, [], AT_REST, "planned", False, ""),
    (PLANNED, [], Truth(working=False, queued="paint"), "queued", False, ""),
    ([*PLANNED, AGAIN], [], AT_WORK, "planning", False, ""),
    ([*PLANNED, AGAIN], [], AT_REST, "planned", False, "planner's process ended"),
    ([*PLANNED, AGAIN, STOPPED], [], AT_REST, "planned", False, ""),
    ([*PLANNED, PAINT], [], AT_WORK, "preparing", False, ""),
    ([*PLANNED, PAINT], [], NO_STROKE, "failed", False, "Nothing was painted yet"),
    ([*PLANNED, PAINT, STOPPED], [], NO_STROKE, "stopped", False, ""),
    ([*PLANNED, PAINT], PAINTED, AT_WORK, "painting", False, ""),
    ([*PLANNED, PAINT], PAINTED[:7], AT_WORK, "replanning", False, ""),
    ([*PLANNED, PAINT], PAINTED, AT_REST, "failed", True, "painter's process ended"),
    ([*PLANNED, PAINT], PAINTED, Truth(working=False, room=False), "failed", True, "disk is full"),
    ([*PLANNED, PAINT], ENDED, AT_WORK, "stopped", False, ""),
    ([*PLANNED, PAINT], ENDED, AT_REST, "stopped", True, ""),
    ([*PLANNED, PAINT], [*ENDED, Began("results")], AT_WORK, "finishing", False, ""),
    ([*PLANNED, PAINT], [*ENDED, Began("results"), KEPT], AT_REST, "stopped", True, ""),
    ([*PLANNED, PAINT], [*PAINTED, FAILED], AT_REST, "failed", True, "robot is gone"),
    ([*PLANNED, PAINT, FAILED], PAINTED, AT_REST, "failed", True, "robot is gone"),
    ([*PLANNED, PAINT, RESUME], [*PAINTED, FAILED], AT_WORK, "preparing", False, ""),
    ([*PLANNED, PAINT, RESUME], [*PAINTED, FAILED], AT_REST, "failed", True, "painter's process ended"),
    ([*PLANNED, PAINT, RESUME, Stopped("No.")], ENDED, AT_REST, "failed", True, "No."),
    ([*PLANNED, PAINT, RESUME], [*ENDED, SessionResumed(3)], AT_WORK, "preparing", False, ""),
    ([*PLANNED, PAINT, RESUME], [*ENDED, SessionResumed(3), KEPT], AT_REST, "finished", False, ""),
    ([*PLANNED, PAINT], [*PAINTED, KEPT], AT_REST, "finished", False, ""),
    ([*PLANNED, PAINT, RESUME], [*PAINTED, Finished(3)], AT_REST, "failed", True, "painter's process ended"),
    ([*PLANNED, PAINT, RESUME], [*PAINTED, Finished(3), KEPT], AT_REST, "finished", False, ""),  # results made again
    ([*PLANNED, PAINT, STOPPED], [*PAINTED, KEPT], AT_REST, "finished", False, ""),
    ([*PLANNED, PAINT], PAINTED, Truth(working=True, here=False), "lost", False, "press Stop"),
    ([*PLANNED, PAINT], PAINTED, Truth(working=False, here=False), "lost", False, "Nothing of it is left"),
    ([], [], Truth(working=False, here=False), "lost", False, "was deleted"),
    ([], PAINTED, AT_WORK, "painting", False, ""),  # begun at the terminal
    ([], ENDED, AT_REST, "stopped", True, ""),
    ([], ENDED, NO_STROKE, "stopped", False, ""),
    ([*PLANNED, PAINT, STOPPED], [*ENDED, SessionResumed(3), *PAINTED[1:]], AT_WORK, "painting", False, ""),  # there
    ([*PLANNED, PAINT, FAILED], [*ENDED, SessionResumed(3)], AT_WORK, "preparing", False, ""),
    ([*PLANNED, PAINT, FAILED], [*ENDED, SessionResumed(3), STOPPED], AT_REST, "stopped", True, ""),
    ([*PLANNED, PAINT, RESUME, REFUSED], [*ENDED, SessionResumed(3), *PAINTED[1:]], AT_WORK, "painting", False, "It"),
    ([*PLANNED, PAINT, RESUME, REFUSED], [*ENDED, SessionResumed(3), STOPPED], AT_REST, "stopped", True, ""),
    ([*PLANNED, PAINT, RESUME, REFUSED], [*ENDED, SessionResumed(3)], AT_REST, "failed", True, "painter's process"),
    ([*PLANNED, PAINT, RESUME, REFUSED], [*ENDED, SessionResumed(3), KEPT], AT_REST, "finished", False, ""),
]  # fmt: skip


@pytest.mark.parametrize(("feed", "journal", "truth", "stage", "resumable", "says"), STATUSES)
def test_a_status_is_told_from_the_events_and_from_what_is_true(
    feed: list[Event], journal: list[Event], truth: Truth, stage: str, resumable: bool, says: str
) -> None:
    status = told(*feed, journal=journal).status(truth)
    assert (status.stage, status.resumable, status.working) == (stage, resumable, truth.working)
    assert says in status.trouble if says else status.trouble == ""


def test_every_stage_is_tested() -> None:
    untested = {"mixing", "drying", "paused"}  # as the events call them
    assert {stage for _, _, _, stage, *_ in STATUSES} | untested == set(get_args(Stage))


BUSY = {"planning", "preparing", "mixing", "painting", "drying", "replanning", "paused", "finishing"}
OF_FEED = [*PLANNED, PAINT, RESUME, STOPPED, FAILED, AGAIN]


@given(st.lists(st.sampled_from(OF_FEED), max_size=8), st.lists(st.sampled_from([*PAINTED, STOPPED, FAILED, KEPT])))
def test_nothing_is_called_busy_where_nobody_works_and_nothing_is_continued_where_somebody_does(
    feed: list[Event], journal: list[Event]
) -> None:
    page = told(*feed, journal=journal)
    for begun in (True, False):
        rests, works = (page.status(Truth(working, begun=begun)) for working in (False, True))
        assert rests.stage not in BUSY and not works.resumable
        shown = page.to_plain(Truth(working=False, begun=begun))
        statuses = [each["status"] for each in (*shown["plans"], *([shown["painting"]] if shown["painting"] else []))]
        assert not set(statuses) & BUSY
        assert page.status(AT_WORK).stage in get_args(Stage)


def test_trouble_is_forgotten_when_something_else_is_begun() -> None:
    shown = told(PLANNED[0], FAILED, AGAIN).to_plain(AT_WORK)
    assert shown["trouble"] == "" and [plan["status"] for plan in shown["plans"]] == ["failed", "planning"]


def test_a_painting_that_was_begun_at_the_terminal_is_shown_too() -> None:
    settings = {"title": "Cup", "strokes": 4, "colors": 2, "canvas": "120x90mm", "brushes": None}
    shown = told(journal=[PaintingBegun(settings, {}), *PAINTED[1:]]).to_plain(Truth(working=True, begun=False))
    (plan,) = shown["plans"]
    assert (plan["number"], plan["status"], shown["painting"]["plan"]) == (0, "ready", 0)
    assert (plan["wish"]["width"], plan["wish"]["height"], plan["wish"]["brushes"]) == (120, 90, None)
    assert "width" not in told(journal=PAINTED).to_plain(AT_REST)["plans"][0]["wish"]


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
kinds = st.sampled_from(["began", "advanced", "result_found", "stopped", "planned", "?"])
keys = st.sampled_from(["what", "plan", "done", "of", "share", "picture", "detail", "sentence", "strokes", "left"])
whats = st.sampled_from(["plan", "paint", "resume", "results"])


@given(st.lists(st.tuples(kinds, whats, st.dictionaries(keys, json_values, max_size=5)), max_size=8))
def test_whatever_stands_in_the_files_something_can_be_shown(lines: list[tuple[str, str, dict[str, Any]]]) -> None:
    page = told(*PLANNED)
    for kind, what, facts in lines:
        try:
            found = events_of({"what": what, **facts, "kind": kind})
        except ValueError:
            continue
        for event in found:
            page.hear(event)
            page.hear_painting(event)
    assert json.loads(json.dumps(page.to_plain(AT_WORK)))["version"] >= len(PLANNED)
    assert all(page.status(truth).stage in get_args(Stage) for truth in (AT_WORK, AT_REST))
