"""The one language of events, and the one fold of them."""

import json
import subprocess
import sys
from dataclasses import fields
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, get_type_hints

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.event_log import EventLog
from frida_painter.session import events
from frida_painter.session.events import KINDS, Durable, Event, Timetable, events_of, record, time_of
from frida_painter.session.fold import FORMAT, VERSION, PaintingState
from frida_painter.session.journal import Journal

AT = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
COLOR = (0.1, 0.2, 0.3)
LOOK = {"seen": "a.jpg", "expected": "b.jpg", "difference": "c.jpg"}
TOLD: list[Event] = [
    events.WorkExpected(6, (2, 4), 10, 3),
    events.PlanningStep("plan", 1, 2, 0.5),
    events.PlanAdopted("f", 0, "photographs/look-0000.png", COLOR, ((1.0, 0.0),)),
    events.Planned(0, 6, 0.5, 0.25, (20.0, 19.0, 21.0)),
    events.Scheduled(Timetable(strokes=6.0, after=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0)), 0),
    events.PaintsWanted(("#ffffff",)),
    events.LayerBegun(0, 1, "fine", 2),
    events.Dipped(1, cleaned=True),
    events.MotionBegan(("stroke 1",), 1, "f"),
    events.StrokePainted(1, 6, COLOR),
    events.TimelapseFrame(1, 6, COLOR, "sketchbook/glimpse-000001.jpg"),
    events.Photographed("photographs/look-0001.png", 1.0, 2, [[0.0]], "abc"),
    events.Looked(1, LOOK),
    events.TouchCorrected("fine", 0.0008, 1),
    events.PlanningStep("replan", 1, 3, 0.4),
    events.Planned(1, 5, 0.5, 0.4, None, "d.jpg"),
    events.Drying(1, 60.0, 30.0),
    events.Paused("You asked.", 1, "person"),
    events.RequestTaken({"kind": "propose", "words": "a sea"}),
    events.PicturesMade("a sea", "maker", [{"picture": "p.jpg", "file": "f", "seed": 1}], 0, "first", []),
    events.RegionProtected("regions/1.png", only=True, picture="region.png"),
    events.GoalChanged("changes/1", {"terms": []}, 1, ("words",)),
    events.PersonStrokeBegan(1, 1, {}, COLOR),
    events.PersonStrokePainted(1, 1),
    events.Turns(3, 0.0, "continue", "protect"),
    events.WentOn(),
    events.StrokeLeftOut(2, 6),
    events.BrushInHand(None),
    events.Remark("No."),
    events.MotionBegan(("stroke 3",), 3, "f"),
    events.Failed("The robot is gone."),
    events.SessionResumed(2, 3, "skip"),
    events.Resumed(3),
    events.CanvasPicture("photographs/seen-0002.png", 3, seen=True, content="abc"),
    events.StrokePainted(6, 6),
    events.Finished(6, 4.5),
    events.Finishing(),
    events.ResultFound("results", detail={"film": True, "arm": False}),
]
VALUES: dict[Any, Any] = {int: 3, float: 0.25, str: "turn", bool: True}


def begun() -> dict[str, Any]:
    return {"format": FORMAT, "version": VERSION, **record(events.PaintingBegun({"strokes": 6}, {}, "a", 1, "0"))}


@pytest.mark.parametrize("told", TOLD, ids=lambda event: type(event).__name__)
def test_every_event_is_read_as_it_was_written(told: Event) -> None:
    written = record(told)
    assert time_of(written).tzinfo is not None
    assert events_of(json.loads(json.dumps(written, allow_nan=False))) == [told]


def test_the_sample_has_nearly_every_kind_and_fields_of_pixels_are_not_written() -> None:
    untold = {kind for kind in KINDS.values() if kind not in {type(event) for event in TOLD}}
    for kind in untold:
        hints = get_type_hints(kind)
        given = {each.name: VALUES.get(hints[each.name], ()) for each in fields(kind) if hints[each.name] is not Any}
        assert record(kind(**given))["kind"] in KINDS
    looked = events.Looked(1, LOOK, torch.zeros(3, 2, 2), torch.zeros(3, 2, 2))
    assert events_of(record(looked)) == [events.Looked(1, LOOK)] and "photograph" not in record(looked)


@given(st.sampled_from(sorted(KINDS)), st.dictionaries(st.sampled_from(["done", "plan", "what", "stroke"]), st.text()))
def test_what_lacks_something_is_refused_and_never_half_understood(kind: str, facts: dict[str, str]) -> None:
    try:
        found = events_of({"kind": kind, "at": "2026-01-02T03:04:05.678+00:00", **facts})
    except ValueError:
        return
    assert [type(event) for event in found] == [KINDS[kind]]


def fold(*told: Event) -> PaintingState:
    state = PaintingState()
    for number, event in enumerate(told):
        state.hear(event, AT + timedelta(seconds=number))
    return state


def shown(state: PaintingState) -> dict[str, Any]:
    known = dict(vars(state))
    return {**known, "time": vars(known["time"])}


@given(st.lists(st.sampled_from(TOLD), max_size=30), st.data())
def test_any_events_fold_and_unknown_ones_of_another_version_change_nothing(told: list[Event], data: Any) -> None:
    records = [begun(), *map(record, told)]
    known = shown(PaintingState.of_journal(records, Path()))
    at = data.draw(st.integers(1, len(records)))
    unknown = {"kind": "what nobody knows", "at": records[0]["at"]}
    assert shown(PaintingState.of_journal([*records[:at], unknown, *records[at:]], Path())) == known


@given(st.permutations(TOLD))
def test_every_prefix_of_a_journal_folds_to_what_was_shown_then(tmp_path_factory: Any, told: list[Event]) -> None:
    folder = tmp_path_factory.mktemp("told")
    journal = Journal.begin(folder, {}, {})
    live = []
    for event in told[:12]:
        journal.tell(event) if isinstance(event, Durable) else journal.show(event)
        live.append(shown(journal.state) | {"looks": list(journal.state.looks), "version": journal.state.version})
    journal.close()
    records = EventLog.read(folder / "journal")
    assert shown(PaintingState.of_journal(records, folder)) == shown(journal.state)
    for count, then in enumerate(live, 1):
        again = PaintingState.of_journal(records[: count + 1], folder)
        assert (again.version, again.looks, again.doing) == (then["version"], then["looks"], then["doing"])


def test_a_painting_is_folded_for_those_who_resume_it() -> None:
    state = fold(events.PaintingBegun({"strokes": 6}, {}), *TOLD)
    assert (state.painted, state.of, state.given_up, state.in_doubt) == (6, 6, [2, 3], None)
    assert (state.dips, state.cleanings, state.runs, state.photographed) == (1, 1, 2, 2)
    assert state.region is not None and (state.region.region, state.goal) == ("regions/1.png", "changes/1")
    assert (state.finished, state.robot_seconds, state.doing) == (True, 4.5, "finished")
    assert (state.person_painted, state.person_seen, state.turns.strokes) == (1, 0, 3)
    assert state.plannings == [TOLD[2]] and state.is_pictured is False
    assert state.last_photograph == "photographs/seen-0002.png" and state.light == [[0.0]]


def test_a_painting_is_folded_for_those_who_watch_it() -> None:
    state = fold(*TOLD[:15])
    assert (state.doing, state.share, state.paint, state.dips_of) == ("planning", 1 / 3, 3, {3: 1})
    assert state.looks[-1].planned is None and "0.8 mm lower" in state.looks[-1].touch[0]
    assert state.phases == [("plan for 6 strokes", [(1, 0.5)])] and state.forecasts == [(0, (20.0, 19.0, 21.0))]
    assert state.expected_seconds == 6.0 and state.photograph == "a.jpg"
    state = fold(*TOLD[:16])
    planned = state.looks[-1].planned
    assert planned is not None and (planned.look, round(planned.gain, 3)) == ("d.jpg", 0.2)
    assert fold(*TOLD[:17]).doing == "drying"
    assert fold(events.Scheduled(Timetable(), 0, 0.0), TOLD[16]).doing != "drying", "nobody waits"
    paused = fold(*TOLD[:18])
    assert (paused.doing, paused.paused, paused.is_making) == ("paused", True, None)
    asked = fold(*TOLD[:19])
    assert (asked.doing, asked.paused, asked.is_making) == ("planning", True, "a sea")
    made = fold(*TOLD[:20])
    assert made.proposed is TOLD[19] and made.is_making is None
    refused = fold(*TOLD[:19], events.RequestTaken({}))
    assert (refused.doing, refused.proposed) == ("paused", None)
    assert fold(*TOLD[:26]).paused is False and fold(*TOLD[:26]).proposed is None
    assert fold(*TOLD[:31]).trouble == "The robot is gone." and fold(*TOLD[:32]).trouble == ""


def test_at_a_terminal_nobody_tells_the_end_of_a_pause_and_a_plan_may_have_been_broken_off() -> None:
    state = fold(events.Paused("A pause file is there."), events.MotionBegan(("home",)))
    assert (state.doing, state.paused) == ("paused", True)
    state.hear(events.MotionBegan(("stroke 1",), 1, "f"), AT)
    assert (state.doing, state.paused) == ("painting", False)
    step, planned = events.PlanningStep("plan", 1, 2, 0.5), events.Planned(0, 6, 0.5, 0.25)
    assert fold(step, events.SessionResumed(0), step, planned).phases == [("plan for 6 strokes", [(1, 0.5)])]


def test_the_time_of_a_whole_painting_is_that_of_its_first_plan() -> None:
    told = ((6.0, 0), (4.0, 0), (2.0, 3))
    first, again, rest = (events.Scheduled(Timetable(strokes=seconds), done) for seconds, done in told)
    assert fold(first, again, rest).expected_seconds == 4 and fold(rest).expected_seconds == 2


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        ([events.RegionProtected("r.png")], "region"),
        ([events.RegionProtected("r.png", only=True)], "only"),
        ([events.RegionProtected(None)], "freed"),
        ([events.GoalChanged("changes/1", {})], "goal"),
        ([], "asked"),
    ],
)
def test_a_look_tells_what_a_person_had_asked_for_before_it(asked: list[Event], why: str) -> None:
    look = events.Looked(3, LOOK)
    state = fold(events.Paused("", 3), events.RequestTaken({"kind": "look"}), *asked, look, events.WentOn(), look)
    assert [each.why for each in state.looks] == [why, ""]


@pytest.mark.parametrize(
    ("told", "doing"),
    [
        ([events.Stopped(2)], "stopped"),
        ([events.Stopped(2), events.Finishing()], "finishing"),
        ([events.Stopped(2), events.Finishing(), TOLD[-1]], "stopped"),
        ([events.Failed("No."), events.Stopped(2), events.Finishing(), TOLD[-1]], "failed"),
        ([events.Failed("No."), events.StrokePainted(3)], "failed"),
        ([events.Failed("No."), events.SessionResumed(2)], "preparing"),
        ([TOLD[-1], events.Stopped(2)], "finished"),
    ],
)
def test_how_a_painting_ends(told: list[Event], doing: str) -> None:
    assert fold(events.StrokePainted(2, 6), *told).doing == doing


def test_time_in_a_break_does_not_count_and_paint_dries_meanwhile() -> None:
    state = PaintingState()
    drying = events.Drying(1, 100.0, 80.0)
    told: list[tuple[Event, float]] = [
        (events.PaintingBegun({}, {}), 0), (events.StrokePainted(1), 10), (drying, 12),
        (events.WorkExpected(6, (), 0, 0), 998), (events.SessionResumed(1), 1000), (events.WentOn(), 1005),
    ]  # fmt: skip
    for event, seconds in told:
        state.hear(event, AT + timedelta(seconds=seconds))
    assert state.seconds == 17 and state.wet() == 80
    assert state.wet(AT + timedelta(seconds=22)) == 70 and state.wet(AT + timedelta(seconds=200)) == 0
    state.hear(events.StrokePainted(2))
    assert state.wet() is None
    state.hear(events.Finished(2), AT + timedelta(seconds=1010))
    state.hear(events.ResultFound("results"), AT + timedelta(days=9))  # made again
    assert state.seconds == 22


def test_events_and_states_are_read_without_torch() -> None:
    code = "import frida_painter.session.fold, frida_painter_studio.commands, sys; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
