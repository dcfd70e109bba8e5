"""The rule by which a silent painting process is taken for dead or for slow, with times that are made up."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.easel.watchdog import LOOK_EVERY, MACHINE, SIMULATED, LinkState, SilenceRule

STEP = LOOK_EVERY


def stopped_at(
    rule: SilenceRule,
    until: float,
    *,
    moving: bool = True,
    thinking: bool = False,
    gone: bool = False,
    starved: float = 0.0,
    beats: tuple[float, ...] = (),
) -> tuple[float, str] | None:
    """When, and why, it is stopped; looked at every 20 ms from 0 to `until`. starved: which part of the time."""
    left = sorted(beats)
    for number in range(1, int(until / STEP) + 1):
        now = number * STEP
        while left and left[0] <= now:
            rule.hear(now)
            left.pop(0)
        if reason := rule.judge(LinkState(now, moving, gone, thinking, starved * now)):
            return now, reason
    return None


@pytest.mark.parametrize(
    ("moving", "thinking", "starved", "latest"),
    [
        (True, False, 0.0, MACHINE.silence),  # halted, or in a deadlock
        (True, True, 0.0, MACHINE.silence),  # it computes, and does not let its heart beat
        (False, False, 0.0, MACHINE.silence),
        (False, True, 0.0, MACHINE.absence),
        (True, False, 1.0, MACHINE.starved_moving),  # it never got a processor
        (False, False, 1.0, MACHINE.absence),
        (True, False, 0.5, 2 * MACHINE.silence),  # it had one for half of the time
    ],
)
def test_how_long_a_silence_may_last(moving: bool, thinking: bool, starved: float, latest: float) -> None:
    found = stopped_at(SilenceRule(0.0), 40.0, moving=moving, thinking=thinking, starved=starved)
    assert found is not None and "fell silent" in found[1]
    assert found[0] == pytest.approx(latest, abs=2 * STEP)


@given(
    gaps=st.lists(st.floats(0.01, MACHINE.silence - 0.1), min_size=1, max_size=20),
    moving=st.booleans(),
    starved=st.floats(0, 1),
)
def test_whoever_is_heard_in_time_is_never_stopped(gaps: list[float], moving: bool, starved: float) -> None:
    beats = tuple(sum(gaps[: number + 1]) for number in range(len(gaps)))
    assert stopped_at(SilenceRule(0.0), sum(gaps), moving=moving, starved=starved, beats=beats) is None


@given(starved=st.floats(0, 1), more=st.floats(0, 1))
def test_within_a_motion_there_is_an_upper_bound_and_who_waited_more_is_waited_for_longer(
    starved: float, more: float
) -> None:
    least = stopped_at(SilenceRule(0.0), 12.0, starved=min(starved, more))
    most = stopped_at(SilenceRule(0.0), 12.0, starved=max(starved, more))
    assert least is not None and most is not None
    assert MACHINE.silence < least[0] <= most[0] <= MACHINE.starved_moving + 2 * STEP


def test_what_it_waited_before_it_fell_silent_is_no_excuse() -> None:
    rule = SilenceRule(0.0)
    for number in range(1, 500):
        rule.hear(number * STEP)
        assert rule.judge(LinkState(number * STEP, True, starved=number * STEP)) is None
    heard = 499 * STEP
    reasons = [rule.judge(LinkState(heard + number * STEP, True, starved=heard)) for number in range(1, 151)]
    first = next(number for number, reason in enumerate(reasons) if reason)
    assert first * STEP <= MACHINE.silence + STEP


def test_a_watch_that_did_not_run_itself_does_not_blame_the_painter() -> None:
    rule = SilenceRule(0.0)
    assert rule.judge(LinkState(0.02, False)) is None
    assert rule.judge(LinkState(9.0, False)) is None, "it stood still for nine seconds, and so did what it looks at"
    assert rule.judge(LinkState(9.02, False)) is None
    late = [rule.judge(LinkState(9.02 + number * STEP, False)) for number in range(200)]
    assert any(late), "but not for ever"


@pytest.mark.parametrize(("gap", "says"), [(2.5, False), (3.5, True), (20.0, True)])
def test_an_easels_process_that_stood_still_within_a_motion(gap: float, says: bool) -> None:
    """Fault B11: the easel's process is frozen."""
    rule, spared = SilenceRule(0.0), SilenceRule(0.0, SIMULATED)
    for each in (rule, spared):
        assert each.judge(LinkState(0.02, True)) is None
        each.hear(gap)
    assert spared.judge(LinkState(gap, True)) is None
    reason = rule.judge(LinkState(gap, True))
    assert (reason is not None and "held up" in reason) == says
    assert rule.judge(LinkState(gap + STEP, True)) is None, "it is said once"


def test_where_nothing_moved_it_may_stand_still() -> None:
    """Fault B11: the easel's process is frozen."""
    rule = SilenceRule(0.0)
    assert rule.judge(LinkState(0.02, False)) is None
    rule.hear(20.0)
    assert rule.judge(LinkState(20.0, True)) is None, "a motion that was asked for meanwhile begins now"


def test_a_silence_is_told_of_once_and_then_counted_anew() -> None:
    rule = SilenceRule(0.0)
    times = [n * STEP for n in range(1, 400) if rule.judge(LinkState(n * STEP, True))]
    assert len(times) == 3 and times[1] - times[0] > MACHINE.silence


@pytest.mark.parametrize("thinking", [False, True])
@pytest.mark.parametrize("moving", [False, True])
def test_whoever_commands_a_simulated_robot_is_waited_for(moving: bool, thinking: bool) -> None:
    assert stopped_at(SilenceRule(0.0, SIMULATED), 100.0, moving=moving, thinking=thinking) is None


@pytest.mark.parametrize("patience", [MACHINE, SIMULATED])
def test_once_the_painter_is_gone_a_motion_may_end_but_not_for_long(patience) -> None:
    assert stopped_at(SilenceRule(0.0, patience), 100.0, moving=False, gone=True) is None
    found = stopped_at(SilenceRule(0.0, patience), 100.0, moving=True, gone=True, starved=1.0)
    assert found is not None and found[0] == pytest.approx(MACHINE.orphaned, abs=2 * STEP)


def test_a_motion_that_was_asked_for_after_a_long_thought_is_not_stopped_for_it() -> None:
    rule = SilenceRule(0.0)
    assert all(rule.judge(LinkState(n * STEP, False, thinking=True)) is None for n in range(1, 300))
    reasons = [rule.judge(LinkState(n * STEP, True, thinking=True)) for n in range(300, 500)]
    assert next(n for n, reason in enumerate(reasons) if reason) * STEP == pytest.approx(MACHINE.silence, abs=2 * STEP)


@pytest.mark.parametrize(("slept", "says"), [(0.9, False), (1.1, True)])
def test_a_nap_of_the_computer_stops_a_machine_whether_it_moves_or_not(slept: float, says: bool) -> None:
    for moving in (True, False):
        assert (SilenceRule(0.0).judge(LinkState(STEP, moving, slept=slept)) is not None) == says
        assert SilenceRule(0.0, SIMULATED).judge(LinkState(STEP, moving, slept=slept)) is None


@pytest.mark.parametrize("moving", [True, False])
def test_time_in_which_nobody_can_see_the_stop_file_counts_while_it_moves(moving: bool) -> None:
    rule, told = SilenceRule(0.0), []
    for number in range(1, 400):
        rule.hear(number * STEP)
        seen = number < 100
        if rule.judge(LinkState(number * STEP, moving, seen=seen)):
            told.append(number * STEP)
    assert bool(told) == moving and (not told or told[0] == pytest.approx(99 * STEP + MACHINE.blind, abs=2 * STEP))
    rule = SilenceRule(0.0)
    assert rule.judge(LinkState(STEP, False, seen=False)) is None
    assert rule.judge(LinkState(20.0, False, seen=False)) is None
    rule.hear(20.0)
    assert rule.judge(LinkState(20.0 + STEP, True, seen=False)) is None, "the watch did not run, and neither did he"
