import io
import itertools
import json
import math
from dataclasses import replace

import pytest
from rich.console import Console

from frida_painter.planning.optimize import Step
from frida_painter.session.choreography import Timetable
from frida_painter.session.events import (
    Asked,
    Began,
    BrushInHand,
    Dipped,
    Drying,
    Event,
    LayerBegun,
    Looked,
    MotionBegan,
    PaintsWanted,
    Paused,
    Planned,
    PlanningStep,
    Scheduled,
    SessionResumed,
    StrokeOfPerson,
    StrokePainted,
    TimelapseFrame,
    WentOn,
    record,
)
from frida_painter.session.fold import PaintingState
from frida_painter.session.replan_policy import EvenlySpaced, looks_on_the_way
from frida_painter.session.time_left import Pace, PlanTime, RemainingTime, duration, remaining_seconds, share_of_plan
from frida_painter_cli.terminal import PaintingLine, PlanningLine, _words

STROKES, REPLANS, PLANNING, REPLANNING = 60, 3, 40, 10
PER_ITERATION, PER_STROKE, PER_LOOK = 0.0004, 0.12, 0.3  # seconds: of each stroke planned, painted, of each look
PAINTS = PaintsWanted(("#ffffff", "#000000"))


def evening(strokes: int = STROKES, replans: int = REPLANS) -> list[tuple[float, Event]]:
    """What happens when, in seconds, where everything goes at a constant speed."""
    events: list[tuple[float, Event]] = []
    now = 0.0

    def then(seconds: float, event: Event) -> None:
        nonlocal now
        now += seconds
        events.append((now, event))

    for iteration in range(1, PLANNING + 1):
        then(PER_ITERATION * strokes, PlanningStep("plan", iteration, PLANNING, 0.1))
    then(0.0, Planned(0, strokes, 1.0, 0.5))
    then(0.0, PAINTS)
    done = 0
    for size in EvenlySpaced(replans).batches(strokes):
        for _ in range(size):
            done += 1
            then(PER_STROKE, StrokePainted(done, strokes, (0.0, 0.0, 0.0)))
        then(PER_LOOK, Looked(done))
        if done < strokes:
            for iteration in range(1, REPLANNING + 1):
                then(PER_ITERATION * (strokes - done), PlanningStep("replan", iteration, REPLANNING, 0.1))
            then(0.0, Planned(done, strokes - done, 1.0, 0.5))
    return events


def time_left(strokes: int = STROKES, replans: int = REPLANS, work: tuple[int, int] | None = None) -> RemainingTime:
    left = RemainingTime()
    looks = tuple(looks_on_the_way(EvenlySpaced(replans), strokes))
    planning, replanning = work or (PLANNING, REPLANNING)
    left.hear(Scheduled(0, strokes, looks, replanning, planning), 0.0)
    return left


def planned(table: Timetable, of: int, done: int = 0, pace: float = 1.0) -> Scheduled:
    """The rest of a painting without looks, whose robot takes so long."""
    dried = table.dried or (0.0,) * len(table.after)
    return Scheduled(
        done, of, seconds=table.total, drying=table.drying, after=replace(table, dried=dried).milestones, pace=pace
    )


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
    expecting = time_left(10, 0, (0, 0))
    after = tuple(float(second) for second in (1, 2, 3, 4, 5, 14, 23, 32, 41, 50))
    expecting.hear(planned(Timetable(strokes=50.0, after=after), 10), 0.0)
    for done in range(1, 6):
        expecting.hear(StrokePainted(done, 10, (0.0, 0.0, 0.0)), 2.0 * after[done - 1])
    assert expecting.remaining == pytest.approx(90)
    expecting.hear(planned(Timetable(strokes=20.0, after=(4.0, 8.0, 12.0, 16.0, 20.0)), 10, 5), 10.0)
    assert expecting.remaining == pytest.approx(40)


def test_a_long_timetable_is_told_by_some_of_its_strokes_and_the_time_left_is_the_same() -> None:
    """20,000 strokes, a dip before every ninth, and a layer that dries after 12,345."""
    steps = [3.0 + 12.0 * (stroke % 9 == 0) + 600.0 * (stroke == 12_345) for stroke in range(20_000)]
    dried = tuple(600.0 * (stroke >= 12_345) for stroke in range(20_000))
    after = tuple(itertools.accumulate(steps))
    told, expecting = planned(Timetable(after[-1] - 600, drying=600, after=after, dried=dried), 20_000), RemainingTime()
    assert len(json.dumps(record(told))) < 10_000 and {12_345, 12_346} <= {stroke for stroke, _, _ in told.after}
    expecting.hear(told, 0.0)
    for done, now in enumerate(after, 1):
        if done == 12_346:
            for left in (600.0, 0.0):
                expecting.hear(Drying(12_345, left), now - 3.0 - left)
        expecting.hear(StrokePainted(done, 20_000), now)
        assert done < 2000 or expecting.remaining == pytest.approx(after[-1] - now, rel=0.005, abs=20)


def test_a_slower_machine_takes_longer_as_soon_as_it_is_known() -> None:
    quick, slow = time_left(), time_left()
    for now, event in evening()[: PLANNING // 2]:
        quick.hear(event, now)
        slow.hear(event, 10 * now)
    assert slow.remaining > 1.5 * quick.remaining


def test_a_pace_is_guessed_by_earlier_work_until_it_is_measured() -> None:
    pace = Pace(2.0)
    assert pace.seconds == 2.0
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
    expecting = time_left(STROKES, 0, (PLANNING, 0))
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
    console, state = Console(file=out, width=100, force_terminal=False), PaintingState()
    with PaintingLine(console, lambda: state) as bar:
        for event in (*events, Began("results")):
            state.hear(event)
            bar.hear(event)
    return out.getvalue()


def test_the_line_says_what_is_going_on() -> None:
    out = shown(
        PlanningStep("plan", 10, PLANNING, 0.1),
        PaintsWanted(("#ffffff", "#000000")),
        StrokePainted(3, STROKES, (0.0, 0.0, 0.0)),
    )
    assert "finishing the film" in out and "left" in out


def test_the_line_stays_away_while_a_person_is_asked() -> None:
    with PaintingLine(Console(file=io.StringIO(), force_terminal=True), PaintingState) as bar:
        with bar.aside():
            bar.hear(StrokePainted(3, STROKES, (0.0, 0.0, 0.0)))
            assert not bar.live.is_started
        assert bar.live.is_started


def test_the_time_left_falls_as_the_paint_dries() -> None:
    expecting = time_left(2, 0, (0, 0))
    expecting.hear(planned(Timetable(strokes=20, drying=600, after=(10, 620)), 2), 0.0)
    expecting.hear(StrokePainted(1, 2), 10.0)
    left = []
    for at, dries in ((10, 600.0), (310, 300.0), (610, 0.0)):
        expecting.hear(Drying(1, dries), at)
        left.append(expecting.remaining)
    assert left == pytest.approx([610, 310, 10])
    assert _words(Drying(1, 300.0), 1.0) == "letting the paint dry, 5 min 00 s more"
    assert _words(Drying(1, 300.0), 0.0) == ""


@pytest.mark.parametrize("left", [400.0, 0.0])
def test_paint_that_dried_while_nobody_painted_is_not_waited_for_and_strokes_are_measured_again(left: float) -> None:
    clock, table = RemainingTime(), Timetable(strokes=10.0, after=tuple(map(float, range(1, 11))), dried=(0.0,) * 10)
    clock.hear(Scheduled(10, 20), 0.0)
    clock.hear(planned(table, 20, 10), 0.0)
    for now, wet in ((1.0, 1200.0), (61.0, 1140.0)):
        clock.hear(Drying(10, wet), now)
    before = clock.remaining
    clock.hear(Scheduled(10, 20), 8990.0)
    assert clock.remaining == before, "a sitting that looks first goes on with its plan"
    clock.hear(SessionResumed(10), 9000.0)
    clock.hear(planned(table.after_drying(left), 20, 10), 9000.0)
    for wet in dict.fromkeys((left, 0.0)) if left else ():
        clock.hear(Drying(10, wet), 9000.0 + left - wet)
    clock.hear(LayerBegun(2, "fine"), 9000.0 + left)
    clock.hear(MotionBegan(("stroke 11",), 11), 9000.0 + left)
    clock.hear(StrokePainted(11, 20), 9002.0 + left)
    assert clock.remaining == pytest.approx(9 * 2)


def _frame(done: int) -> TimelapseFrame:
    return TimelapseFrame(done, 300, (0.0, 0.0, 0.0))


def _person(*, painted: bool) -> StrokeOfPerson:
    return StrokeOfPerson(1, {}, (0.0, 0.0, 0.0), painted)


PAUSED, LOOKED = Paused("You asked.", 10, "person"), Looked(10)
STEPS = [(0.1, PlanningStep("replan", step, 4, 0.1)) for step in (1, 2, 3, 4)]
REPLANNED = Planned(10, 290, 1.0, 0.5)
OF_A_PERSON: dict[str, list[tuple[float, Event]]] = {
    "a pause": [(0, PAUSED), (300, WentOn())],
    "a pause whose end nobody tells": [(0, PAUSED), (300, Dipped(0))],
    "a pause and nothing else": [(0, PAUSED), (300, StrokePainted(11, 300))],
    "two pauses": [(0, PAUSED), (300, WentOn()), (1, StrokePainted(11, 300)), (0, PAUSED), (300, Dipped(0))],
    "a pause during a look": [(0, PAUSED), (300, LOOKED)],
    "a frame after a pause": [(0, PAUSED), (300, _frame(10)), (0, WentOn())],
    "a turn with strokes": [
        (0, PAUSED), (100, LOOKED), (9, _person(painted=False)), (1, _person(painted=True)), (2, _frame(10)),
        (300, WentOn()),
    ],
    "strokes alone": [(300, _person(painted=True)), (1, _frame(10)), (0, Dipped(0))],
    "a question": [(0, Asked({})), (300, Asked(None)), (0, Dipped(0))],
    "a question in a pause": [(0, PAUSED), (90, Asked({})), (300, Asked(None)), (300, WentOn())],
    "paints to be mixed": [(0, PAINTS), (300, Dipped(0))],
    "mixed paints for which the rest is planned again": [
        (0, PAINTS), (300, STEPS[0][1]), *STEPS[1:], (0, REPLANNED), (300, Dipped(0)),
    ],
    "a canvas to be toned": [(0, PaintsWanted(("#000000",), ground=True)), (300, Dipped(0))],
    "a brush changed by hand": [(0, BrushInHand(None)), (300, BrushInHand("fine")), (0, LayerBegun(2, "fine"))],
    "a plan in a pause, and a person who thinks": [(0, PAUSED), (300, LOOKED), *STEPS, (0, REPLANNED), (300, WentOn())],
    "a plan after a pause": [(0, PAUSED), (300, WentOn()), (0, LOOKED), *STEPS, (0, REPLANNED)],
    "a pause within a plan": [STEPS[0], (0, PAUSED), (300, STEPS[1][1]), *STEPS[2:], (0, REPLANNED)],
}  # fmt: skip


@pytest.mark.parametrize("timetable", [(), tuple(map(float, range(1, 301)))])
@pytest.mark.parametrize("events", OF_A_PERSON.values(), ids=OF_A_PERSON)
def test_what_a_person_takes_is_never_counted_as_work(
    events: list[tuple[float, Event]], timetable: tuple[float, ...]
) -> None:
    """Strokes of a second, with minutes of a person among them: 300 strokes take 300 s in all."""
    expecting, now = time_left(300, 0, (0, 4)), 0.0
    if timetable:
        expecting.hear(planned(Timetable(strokes=300.0, after=timetable), 300), 0.0)
    before = [(1.0, StrokePainted(done, 300)) for done in range(1, 11)]
    painted = max([10, *(event.done for _, event in events if isinstance(event, StrokePainted))])
    after = [(1.0, StrokePainted(done, 300)) for done in range(painted + 1, 20)]
    for passed, event in (*before, *events, *after):
        now += passed
        expecting.hear(event, now)
        left = 300 - (event.done if isinstance(event, StrokePainted) else 10)
        assert expecting.remaining == pytest.approx(left, abs=1.5), event


def test_a_picture_alone_makes_nothing_longer() -> None:
    """Seconds count only if a stroke follows, and not if a person turns out to have had them."""
    expecting = time_left(300, 0, (0, 0))
    for done in range(1, 11):
        expecting.hear(StrokePainted(done, 300), float(done))
    for now, event in ((310.0, _frame(10)), (610.0, LOOKED), (611.0, PAUSED), (612.0, StrokePainted(11, 300))):
        expecting.hear(event, now)
    assert expecting.remaining == pytest.approx(289.0)


def test_a_person_does_not_slow_the_forecast_of_planning_either() -> None:
    """A pause within a replan, and one before its first iteration; four iterations take 0.4 s."""
    quick, slow = time_left(), time_left()
    for expecting, pause in ((quick, 0.0), (slow, 300.0)):
        now = 0.0
        for step in range(1, 9):
            expecting.hear(PlanningStep("plan", step, PLANNING, 0.1), now := now + 0.1)
            if step == 4:
                expecting.hear(PAUSED, now)
                expecting.hear(LOOKED, now := now + pause)
    assert slow.remaining == pytest.approx(quick.remaining, rel=0.01)


@pytest.mark.parametrize(("pace", "left"), [(1.0, 610.0), (0.0, 10.0), (0.1, 70.0)])
def test_drying_counts_as_long_as_people_wait_for_it(pace: float, left: float) -> None:
    """20 minutes of the robot's clock are nothing in a studio that is simulated at once."""
    expecting = time_left(4, 0, (0, 0))
    table = Timetable(strokes=20, drying=600, after=(5.0, 10.0, 615.0, 620.0), dried=(0.0, 0.0, 600.0, 600.0))
    expecting.hear(planned(table, 4, pace=pace), 0.0)
    for done in (1, 2):
        expecting.hear(StrokePainted(done, 4), 5.0 * done)
    assert expecting.remaining == pytest.approx(left)
    for part in (1.0, 0.5, 0.0) if pace else ():
        expecting.hear(Drying(2, 600.0 * part), 10.0 + 600 * pace * (1 - part))
        assert expecting.remaining == pytest.approx(10.0 + 600 * pace * part)
    expecting.hear(StrokePainted(3, 4), 15.0 + 600 * pace)
    assert expecting.remaining == pytest.approx(5.0)


def test_planning_alone_has_a_line_too() -> None:
    out = io.StringIO()
    with PlanningLine(Console(file=out, width=100, force_terminal=False)) as bar:
        bar.hear(Step(1, 4, 0.5))
        bar.hear(Step(4, 4, 0.1))
    assert "planning 100 %" in out.getvalue()
