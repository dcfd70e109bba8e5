import io
import itertools
import math

import pytest
import torch
from rich.console import Console

from frida_painter.cli.terminal import PaintingLine, PlanningLine, _words
from frida_painter.palette import Palette
from frida_painter.planning.optimize import Step
from frida_painter.session.events import (
    Drying,
    Event,
    Finishing,
    Looked,
    PaintsWanted,
    Planned,
    PlanningStep,
    Scheduled,
    StrokePainted,
    Timetable,
)
from frida_painter.session.replan_policy import EvenlySpaced
from frida_painter.session.time_left import Pace, PlanTime, RemainingTime, duration, remaining_seconds, share_of_plan
from support.plans import made_up_plan

STROKES, REPLANS, PLANNING, REPLANNING = 60, 3, 40, 10
PER_ITERATION, PER_STROKE, PER_LOOK = 0.0004, 0.12, 0.3  # seconds: of each stroke planned, painted, of each look
PICTURE = torch.zeros(3, 4, 4)


def evening(strokes: int = STROKES, replans: int = REPLANS) -> list[tuple[float, Event]]:
    """What happens when, in seconds, where everything goes at a constant speed."""
    events: list[tuple[float, Event]] = []
    now = 0.0

    def then(seconds: float, event: Event) -> None:
        nonlocal now
        now += seconds
        events.append((now, event))

    plan = made_up_plan(strokes)
    for iteration in range(1, PLANNING + 1):
        then(PER_ITERATION * strokes, PlanningStep("plan", iteration, PLANNING, 0.1))
    then(0.0, Planned(plan, 0, PICTURE, 1.0, 0.5))
    then(0.0, PaintsWanted(plan.palette))
    done = 0
    for size in EvenlySpaced(replans).batches(strokes):
        for _ in range(size):
            done += 1
            then(PER_STROKE, StrokePainted(done, strokes, (0.0, 0.0, 0.0)))
        then(PER_LOOK, Looked(PICTURE, PICTURE, done))
        if done < strokes:
            for iteration in range(1, REPLANNING + 1):
                then(PER_ITERATION * (strokes - done), PlanningStep("replan", iteration, REPLANNING, 0.1))
            then(0.0, Planned(plan.part(slice(done, None)), done, PICTURE, 1.0, 0.5))
    return events


def time_left(strokes: int = STROKES, replans: int = REPLANS) -> RemainingTime:
    return RemainingTime(strokes, EvenlySpaced(replans), 0.0, planning=PLANNING, replanning=REPLANNING)


@pytest.mark.parametrize("replans", [0, 3, 9])
def test_from_the_middle_on_the_time_left_can_be_believed(replans: int) -> None:
    """To a fifth, or to the one look that comes after the last stroke."""
    events, expecting = evening(replans=replans), time_left(replans=replans)
    end = events[-1][0]
    for now, event in events:
        expecting.hear(event, now)
        left = end - now
        if 0.5 * end < now < 0.95 * end:
            assert expecting.remaining == pytest.approx(left, rel=0.2, abs=1.2 * PER_LOOK), now / end


def test_the_time_left_is_nothing_at_the_end_and_never_negative_or_endless() -> None:
    expecting = time_left()
    assert 0 < expecting.remaining < 3600
    for now, event in evening():
        expecting.hear(event, now)
        assert 0 <= expecting.remaining < 3600
    assert expecting.remaining == pytest.approx(0, abs=1e-6)


def test_strokes_of_unequal_length_are_counted_by_the_timetable() -> None:
    """The first half of the strokes takes a tenth of the time; by strokes alone it would seem half."""
    expecting = RemainingTime(10, EvenlySpaced(0), 0.0, planning=0, replanning=0)
    after = tuple(float(second) for second in (1, 2, 3, 4, 5, 14, 23, 32, 41, 50))
    expecting.hear(Scheduled(Timetable(strokes=50.0, after=after), 0), 0.0)
    for done in range(1, 6):
        expecting.hear(StrokePainted(done, 10, (0.0, 0.0, 0.0)), 2.0 * after[done - 1])
    assert expecting.remaining == pytest.approx(90)
    expecting.hear(Scheduled(Timetable(strokes=20.0, after=(4.0, 8.0, 12.0, 16.0, 20.0)), 5), 10.0)
    assert expecting.remaining == pytest.approx(40)


def test_a_slower_machine_takes_longer_as_soon_as_it_is_known() -> None:
    quick, slow = time_left(), time_left()
    for now, event in evening()[: PLANNING // 2]:
        quick.hear(event, now)
        slow.hear(event, 10 * now)
    assert slow.remaining > 1.5 * quick.remaining


def test_a_pace_is_guessed_by_earlier_work_until_it_is_measured() -> None:
    pace = Pace.of_earlier_work([1.0, 60.0, 2.0], guess=5.0)
    assert (pace.seconds, Pace.of_earlier_work([], guess=5.0).seconds) == (2.0, 5.0)
    pace.measure(30.0, 10.0)
    assert pace.time_for(4.0) == 12.0 and pace.time_for(0.0) == 0.0
    assert Pace().time_for(1.0) == math.inf and Pace().time_for(0.0) == 0.0


def test_work_of_known_share_takes_as_long_again_as_its_share_says() -> None:
    assert remaining_seconds(30.0, 0.25) == pytest.approx(90.0)
    assert remaining_seconds(30.0, 1.0) == 0.0 and remaining_seconds(30.0, 0.0) == math.inf
    shares = [share_of_plan(iteration, 8) for iteration in range(1, 9)]
    later = [after - before for before, after in itertools.pairwise([0.0, *shares])]
    assert shares[-1] == 1.0 and later == sorted(later), "later iterations count for more"


@pytest.mark.parametrize(("load", "expected"), [(1.0, 100.0), (3.0, 300.0)])
def test_a_known_time_of_a_plan_is_corrected_by_how_busy_the_machine_is(load: float, expected: float) -> None:
    """100 s of a processor, of which others take their part; the pace alone would tell ten times less."""
    now = [0.0]
    plan = PlanTime(100.0, lambda: load * now[0], lambda: now[0])
    assert plan.find_remaining(0.0) == 100.0, "before it begins nobody knows"
    now[0] = 2.0
    assert plan.find_remaining(0.2) == pytest.approx(0.8 * expected)
    now[0] = 150.0
    assert plan.find_remaining(0.5) == pytest.approx(0.5 * load * 150) and plan.find_remaining(1.0) == 0.0
    assert PlanTime(None, lambda: now[0]).find_remaining(0.0) == math.inf


def test_a_plan_that_takes_longer_per_iteration_as_it_grows_is_foreseen() -> None:
    """The line of a painting reckons like that of a plan alone: half of the iterations are less than half the work."""
    expecting = RemainingTime(STROKES, EvenlySpaced(0), 0.0, planning=PLANNING, replanning=0)
    for iteration in range(1, PLANNING // 2 + 1):
        expecting.hear(PlanningStep("plan", iteration, PLANNING, 0.1), 10 * share_of_plan(iteration, PLANNING))
    left = expecting.remaining - 0.1 * STROKES  # a guess of painting
    assert left == pytest.approx(10 * (1 - 0.5**1.4), rel=0.01)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0, "0 s"),
        (-3, "0 s"),
        (0.4, "0 s"),
        (59.4, "59 s"),
        (59.6, "1 min 00 s"),
        (125, "2 min 05 s"),
        (3599.7, "1 h 00 min"),
        (3 * 3600 + 7 * 60, "3 h 07 min"),
    ],
)
def test_durations_are_said_as_people_say_them(seconds: float, words: str) -> None:
    assert duration(seconds) == words


def shown(*events: Event) -> str:
    out = io.StringIO()
    console = Console(file=out, width=100, force_terminal=False)
    with PaintingLine(console, time_left()) as bar:
        for event in events:
            bar.hear(event)
        bar.hear(Finishing())
    return out.getvalue()


def test_the_line_says_what_is_going_on() -> None:
    out = shown(
        PlanningStep("plan", 10, PLANNING, 0.1),
        PaintsWanted(Palette(torch.ones(2, 3))),
        StrokePainted(3, STROKES, (0.0, 0.0, 0.0)),
    )
    assert "finishing the film" in out and "left" in out


def test_the_time_left_falls_as_the_paint_dries() -> None:
    expecting = RemainingTime(2, EvenlySpaced(0), 0.0, planning=0, replanning=0)
    expecting.hear(Scheduled(Timetable(strokes=20, drying=600, after=(10, 620)), 0), 0.0)
    expecting.hear(StrokePainted(1, 2), 10.0)
    left = []
    for at, dries in ((10, 600.0), (310, 300.0), (610, 0.0)):
        expecting.hear(Drying(1, 600.0, dries), at)
        left.append(expecting.remaining)
    assert left == pytest.approx([610, 310, 10])
    assert _words(Drying(1, 600.0, 300.0)) == "letting the paint dry, 5 min 00 s more"


def test_planning_alone_has_a_line_too() -> None:
    out = io.StringIO()
    with PlanningLine(Console(file=out, width=100, force_terminal=False)) as bar:
        bar.hear(Step(1, 4, 0.5))
        bar.hear(Step(4, 4, 0.1))
    assert "planning 100 %" in out.getvalue()
