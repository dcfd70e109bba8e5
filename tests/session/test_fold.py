"""The one language of events, and the one fold of them."""

import json
import re
import subprocess
import sys
from copy import deepcopy
from dataclasses import fields
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, get_type_hints

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.errors import StorageError
from frida_painter.session import events
from frida_painter.session.events import KINDS, Durable, Event, events_of, record, time_of
from frida_painter.session.fold import FORMAT, VERSION, PaintingState
from frida_painter.session.journal import Journal
from frida_painter.system.event_log import EventLog

AT = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
COLOR = (0.1, 0.2, 0.3)
LOOK = {"seen": "a.jpg", "expected": "b.jpg", "difference": "c.jpg"}
TOLD: list[Event] = [
    events.Scheduled(0, 6, (2, 4), 3, 10),
    events.PlanningStep("plan", 1, 2, 0.5),
    events.PlanAdopted("f", 0, "photographs/look-0000.png", COLOR, ((1.0, 0.0),)),
    events.Planned(0, 6, 0.5, 0.25, (20.0, 19.0, 21.0)),
    events.Scheduled(0, 6, (2, 4), 3, seconds=6.0, after=((1, 1.0, 0.0), (6, 6.0, 0.0))),
    events.PaintsWanted(("#ffffff",)),
    events.LayerBegun(1, "fine", 2),
    events.Dipped(1, cleaned=True),
    events.MotionBegan(("stroke 1",), 1),
    events.StrokePainted(1, 6, COLOR),
    events.TimelapseFrame(1, 6, COLOR, "sketchbook/glimpse-000001.jpg"),
    events.CanvasPicture("photographs/look-0001.png", 1, "camera", "abc", [[0.0]]),
    events.Looked(1, LOOK),
    events.Remark("0.8 mm lower", "touch", "fine"),
    events.PlanningStep("replan", 1, 3, 0.4),
    events.Planned(1, 5, 0.5, 0.4, None, "d.jpg"),
    events.Drying(1, 30.0),
    events.Paused("You asked.", 1, "person"),
    events.CommandTaken({"kind": "propose", "words": "a sea"}),
    events.CommandDone(
        events.MadePictures("a sea", "maker", [{"picture": "p.jpg", "file": "f", "seed": 1}], 0, "first", [])
    ),
    events.CommandDone(events.DrawnRegion("1.png", only=True)),
    events.CommandDone(events.NewGoal("changes/1", {"terms": []}, 1, ("words",))),
    events.StrokeOfPerson(1, {}, COLOR),
    events.StrokeOfPerson(1, {}, COLOR, painted=True),
    events.CommandDone(events.Turns(3, 0.0, "continue", "protect")),
    events.WentOn(),
    events.StrokeLeftOut(2, 6),
    events.BrushInHand(None),
    events.Remark("No."),
    events.MotionBegan(("stroke 3",), 3),
    events.Stopped("The robot is gone."),
    events.SessionResumed(2, 3, "skip"),
    events.ResultFound("found", "found.jpg"),
    events.CanvasPicture("photographs/seen-0002.png", 3, "person", "abc"),
    events.StrokePainted(6, 6),
    events.Finished(6, 4.5),
    events.Began("results"),
    events.ResultFound("results", detail={"film": True, "arm": False}),
]
VALUES: dict[Any, Any] = {int: 3, float: 0.25, str: "turn", bool: True}


def begun() -> dict[str, Any]:
    return {"format": FORMAT, "version": VERSION, **record(events.PaintingBegun({"strokes": 6}, {}, "a", 1, "0"))}


@pytest.mark.parametrize("told", TOLD, ids=lambda event: type(event).__name__)
def test_every_event_is_read_as_it_was_written(told: Event) -> None:
    written = record(told)
    assert time_of(written) is not None
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
def test_what_lacks_something_is_refused_if_resuming_needs_it_else_skipped(kind: str, facts: dict[str, str]) -> None:
    try:
        found = events_of({"kind": kind, "at": "2026-01-02T03:04:05.678+00:00", **facts})
    except ValueError:
        assert issubclass(KINDS[kind], Durable)
        return
    kinds = [type(event) for event in found]
    assert kinds[-1:] == [KINDS[kind]] or (kinds == [events.Unknown] and not issubclass(KINDS[kind], Durable))


def fold(*told: Event) -> PaintingState:
    state = PaintingState()
    for number, event in enumerate(told):
        state.hear(event, AT + timedelta(seconds=number))
    return state


def shown(state: PaintingState) -> dict[str, Any]:
    known = {name: dict(vars(record)) for name, record in vars(deepcopy(state)).items()}
    known["planning"]["time"] = vars(known["planning"]["time"])
    return known


FOREIGN: dict[str, tuple[dict[str, Any], bool | None]] = {  # a record, and True if its known part counts; None: refused
    "a kind that nobody knows": ({"kind": "wiped", "done": 3}, False),
    "no kind at all": ({"done": 3}, False),
    "a kind that is none": ({"kind": ["stroke_painted"], "done": 3}, False),
    "one field more": ({"kind": "stroke_painted", "done": 3, "pressure": 0.4}, True),
    "one field more of what is shown": ({"kind": "remark", "sentence": "No.", "tone": "calm"}, True),
    "a field less of what is shown": ({"kind": "planning_step", "phase": "plan", "of": 4}, False),
    "a wrong type in what is shown": ({"kind": "looked", "done": "all"}, False),
    "a field less of what resuming needs": ({"kind": "stroke_painted", "of": 3}, None),
    "a wrong type in what resuming needs": ({"kind": "motion_began", "what": ["home"], "stroke": "third"}, None),
}


@given(st.sampled_from(sorted(FOREIGN)), st.lists(st.sampled_from(TOLD), max_size=20), st.data())
def test_what_a_newer_program_wrote_is_skipped_and_told_at_any_place(
    name: str, told: list[Event], data: st.DataObject
) -> None:
    record_of_newer, counts = FOREIGN[name]
    records = [begun(), *map(record, told)]
    at = data.draw(st.integers(1, len(records)))
    known = {key: value for key, value in record_of_newer.items() if key not in ("pressure", "tone")}
    written = {"at": records[at - 1]["at"], **record_of_newer}
    if counts is None:
        with pytest.raises(StorageError, match="undamaged copy"):
            PaintingState.of_journal([*records[:at], written], Path())
        return
    state = PaintingState.of_journal([*records[:at], written, *records[at:]], Path())
    plain = [{"at": written["at"], **known}] if counts else []
    same = PaintingState.of_journal([*records[:at], *plain, *records[at:]], Path())
    assert state.sittings.unknown == 1 and "in 1 place of this journal" in state.sittings.unknown_sentence
    for each in (state, same):
        each.sittings.unknown = each.sittings.version = 0
    assert shown(state) == shown(same)


@given(st.permutations(TOLD))
def test_every_prefix_of_a_journal_folds_to_what_was_shown_then(tmp_path_factory: Any, told: list[Event]) -> None:
    folder = tmp_path_factory.mktemp("told")
    journal = Journal.begin(folder, {}, {})
    live = []
    for event in told[:12]:
        journal.tell(event) if isinstance(event, Durable) else journal.show(event)
        live.append(shown(journal.state))
    journal.close()
    records = EventLog.read(folder / "journal")
    for count, then in enumerate(live, 1):
        assert shown(PaintingState.of_journal(records[: count + 1], folder)) == then


def test_a_painting_is_folded_for_those_who_resume_it() -> None:
    state = fold(events.PaintingBegun({"strokes": 6}, {}), *TOLD)
    assert (state.progress.painted, state.progress.of, state.progress.given_up, state.progress.in_doubt) == (
        6,
        6,
        [2, 3],
        None,
    )
    assert (state.brush.dips, state.brush.cleanings, state.sittings.count, state.pictures.count) == ({3: 1}, 1, 2, 2)
    assert state.wishes.region is not None and (state.wishes.region.drawing, state.wishes.goal) == (
        "1.png",
        "changes/1",
    )
    assert (state.end.finished, state.end.robot_seconds, state.progress.doing) == (True, 4.5, "finished")
    assert (state.people.painted, state.people.seen, state.wishes.turns.strokes) == (1, 0, 3)
    assert state.planning.adopted == [TOLD[2]] and state.is_pictured is False
    assert state.pictures.last == "photographs/seen-0002.png" and state.pictures.light == [[0.0]]


def test_a_painting_is_folded_for_those_who_watch_it() -> None:
    state = fold(*TOLD[:15])
    assert (state.progress.doing, state.brush.paint, state.brush.dips) == ("planning", 3, {3: 1})
    assert state.pictures.looks[-1].planned is None and "0.8 mm lower" in state.pictures.looks[-1].touch[0]
    assert state.planning.phases == [("plan for 6 strokes", [(1, 0.5)])] and state.planning.forecasts == [
        (0, (20.0, 19.0, 21.0))
    ]
    assert state.planning.expected_seconds == 6.0 and state.pictures.photograph == "a.jpg"
    state = fold(*TOLD[:16])
    planned = state.pictures.looks[-1].planned
    assert planned is not None and (planned.look, round(planned.gain, 3)) == ("d.jpg", 0.2)
    assert fold(*TOLD[:17]).progress.doing == "drying"
    assert fold(events.Scheduled(0, 6, seconds=0.0, pace=0.0), TOLD[16]).progress.doing != "drying", "nobody waits"
    paused = fold(*TOLD[:18])
    assert (paused.progress.doing, paused.wishes.paused, paused.wishes.request) == ("paused", True, {})
    asked = fold(*TOLD[:19])
    assert (asked.progress.doing, asked.wishes.paused, asked.wishes.request["words"]) == ("planning", True, "a sea")
    made = fold(*TOLD[:20])
    assert events.CommandDone(made.wishes.proposed) == TOLD[19] and (made.wishes.request, made.progress.doing) == (
        {},
        "paused",
    )
    refused = fold(*TOLD[:19], events.CommandTaken({}))
    assert (refused.progress.doing, refused.wishes.proposed) == ("paused", None)
    assert fold(*TOLD[:26]).wishes.paused is False and fold(*TOLD[:26]).wishes.proposed is None
    assert fold(*TOLD[:31]).end.trouble == "The robot is gone." and fold(*TOLD[:32]).end.trouble == ""


def test_at_a_terminal_nobody_tells_the_end_of_a_pause_and_a_plan_may_have_been_broken_off() -> None:
    state = fold(events.Paused("A pause file is there."), events.MotionBegan(("home",)))
    assert (state.progress.doing, state.wishes.paused) == ("paused", True)
    state.hear(events.MotionBegan(("stroke 1",), 1), AT)
    assert (state.progress.doing, state.wishes.paused) == ("painting", False)
    step, planned = events.PlanningStep("plan", 1, 2, 0.5), events.Planned(0, 6, 0.5, 0.25)
    assert fold(step, events.SessionResumed(0), step, planned).planning.phases == [("plan for 6 strokes", [(1, 0.5)])]


def test_the_time_of_a_whole_painting_is_that_of_its_first_plan() -> None:
    told = ((6.0, 0), (4.0, 0), (2.0, 3))
    first, again, rest = (events.Scheduled(done, 6, seconds=seconds) for seconds, done in told)
    assert fold(first, again, rest).planning.expected_seconds == 4 and fold(rest).planning.expected_seconds == 2


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        ([events.CommandDone(events.DrawnRegion("r.png"))], "region"),
        ([events.CommandDone(events.DrawnRegion("r.png", only=True))], "only"),
        ([events.CommandDone(events.DrawnRegion(None))], "freed"),
        ([events.CommandDone(events.NewGoal("changes/1", {}))], "goal"),
        ([], "asked"),
    ],
)
def test_a_look_tells_what_a_person_had_asked_for_before_it(asked: list[Event], why: str) -> None:
    look = events.Looked(3, LOOK)
    state = fold(events.Paused("", 3), events.CommandTaken({"kind": "look"}), *asked, look, events.WentOn(), look)
    assert [each.why for each in state.pictures.looks] == [why, ""]


@pytest.mark.parametrize(
    ("told", "doing"),
    [
        ([events.Stopped()], "stopped"),
        ([events.Stopped(), events.Began("results")], "finishing"),
        ([events.Stopped(), events.Began("results"), TOLD[-1]], "stopped"),
        ([events.Stopped("No."), events.Stopped(), events.Began("results"), TOLD[-1]], "failed"),
        ([events.Stopped("No."), events.StrokePainted(3)], "failed"),
        ([events.Stopped("No."), events.SessionResumed(2)], "preparing"),
        ([TOLD[-1], events.Stopped()], "finished"),
    ],
)
def test_how_a_painting_ends(told: list[Event], doing: str) -> None:
    assert fold(events.StrokePainted(2, 6), *told).progress.doing == doing


def test_time_in_a_break_does_not_count_and_paint_dries_meanwhile() -> None:
    state = PaintingState()
    drying = events.Drying(1, 80.0)
    told: list[tuple[Event, float]] = [
        (events.PaintingBegun({}, {}), 0), (events.StrokePainted(1), 10), (drying, 12),
        (events.Scheduled(1, 6), 998), (events.SessionResumed(1), 1000), (events.WentOn(), 1005),
    ]  # fmt: skip
    for event, seconds in told:
        state.hear(event, AT + timedelta(seconds=seconds))
    assert state.sittings.seconds == 17 and state.progress.wet() == 80
    assert state.progress.wet(AT + timedelta(seconds=22)) == 70 and state.progress.wet(AT + timedelta(seconds=200)) == 0
    state.hear(events.StrokePainted(2))
    assert state.progress.wet() is None
    state.hear(events.Finished(2), AT + timedelta(seconds=1010))
    state.hear(events.ResultFound("results"), AT + timedelta(days=9))  # made again
    assert state.sittings.seconds == 22


DAY = 86400.0
CLOCKS = {  # seconds from one event to the next, and those of them that count
    "as it goes": ([1.0, 2.0, 3.0], 6.0),
    "set back by a day": ([1.0, -DAY, 3.0], 4.0),
    "set on by a century": ([1.0, 36525 * DAY, 3.0], 3604.0),
    "set on and back again": ([1.0, 36525 * DAY, -36525 * DAY, 3.0], 3604.0),
    "before 1970": ([-30000 * DAY, 2.0, 3.0], 5.0),
}


@pytest.mark.parametrize("name", CLOCKS)
def test_a_clock_that_is_set_costs_an_hour_at_most_and_no_number_is_below_zero(name: str) -> None:
    steps, counted = CLOCKS[name]
    state, now = PaintingState(), AT
    state.hear(events.PaintingBegun({}, {}), now)
    state.hear(events.Scheduled(0, len(steps) + 2), now)
    for done, step in enumerate(steps, 1):
        now += timedelta(seconds=step)
        state.hear(events.StrokePainted(done), now)
    assert state.sittings.seconds == pytest.approx(counted)
    assert 0 <= state.planning.time.remaining <= 2 * counted / len(steps) + 1e-6
    state.hear(events.Drying(len(steps), 80.0), now)
    for looked in (-DAY, -36525 * DAY, 0.0):
        assert state.progress.wet(now + timedelta(seconds=looked)) == 80, "what is not sure to be dry is wet"
    state.hear(events.SessionResumed(len(steps)), now - timedelta(days=400))
    state.hear(events.StrokePainted(len(steps) + 1), now - timedelta(days=399))
    assert counted < state.sittings.seconds <= counted + 3600 and state.planning.time.remaining >= 0


@pytest.mark.parametrize("at", [None, "yesterday", 7, "2026-01-02T03:04:05", "9999-12-31T23:59:59-12:00", "2026-13-01"])
def test_an_entry_without_a_time_counts_and_takes_none(at: object) -> None:
    records = [begun(), {**record(events.StrokePainted(1, 6)), "at": at}, record(events.StrokePainted(2, 6))]
    state = PaintingState.of_journal(records, Path())
    assert state.progress.painted == 2 and state.sittings.last == time_of(records[2]) and time_of(records[1]) is None


def test_the_page_about_the_journal_names_kinds_and_fields_that_there_are() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "files.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.*) \| (.*) \|$", page.partition("## The journal")[2], re.MULTILINE)
    for kinds, told in rows:
        known = set().union(*(vars(KINDS[kind])["__dataclass_fields__"] for kind in re.findall(r"`(\w+)`", kinds)))
        assert set(re.findall(r"`(\w+)`", told)) <= known | {"format", "version", "seen", "expected", "difference"}
    assert len(rows) >= 9


def test_events_and_states_are_read_without_torch() -> None:
    code = "import frida_painter.session.fold, frida_painter_together.inbox, sys; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
