"""When the painter looks and plans again, and how a policy is named."""

import importlib.metadata
import itertools
import math
from pathlib import Path

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from frida_painter import registry
from frida_painter.errors import ConfigError
from frida_painter.registry import REPLAN_POLICIES
from frida_painter.session.events import Looked, Planned, StrokePainted
from frida_painter.session.journal import Journal, placement_of
from frida_painter.session.progress import PaintingProgress
from frida_painter.session.replan_policy import (
    CanvasSeen,
    EvenlySpaced,
    EveryNth,
    ReplanPolicy,
    WhenItPays,
    looks_on_the_way,
    parse_replan_policy,
)
from frida_painter.session.resuming import load_kept_plan
from frida_painter.strokes.plan import Plan
from support.easel import PatientCamera
from support.session import NotingPlanner, SessionSetup


@pytest.mark.parametrize(
    ("text", "policy"),
    [
        ("4", EvenlySpaced(4)), ("times:4", EvenlySpaced(4)), ("every:75", EveryNth(75)), (" every:1 ", EveryNth(1)),
        ("when-off-by:0.02", EveryNth(10, 0.02)), ("when-off-by:0.02,25", EveryNth(25, 0.02)),
        ("when-it-pays", WhenItPays(0.05)), ("when-it-pays:0.2", WhenItPays(0.2)),
    ],
)  # fmt: skip
def test_a_policy_is_found_by_its_name(text: str, policy: ReplanPolicy) -> None:
    assert parse_replan_policy(text) == policy


@pytest.mark.parametrize(
    "text",
    ["", "never", "every", "every:0", "every:x", "-1", "every:1.5", "when-off-by:nan", "when-off-by:2", "when-off-by:",
     "when-off-by:0.1,0", "99999", "4:5x", "when-it-pays:0", "when-it-pays:nan", "when-it-pays:x", "when-it-pays:-1"],
)  # fmt: skip
def test_what_is_no_policy_is_refused_in_a_sentence(text: str) -> None:
    with pytest.raises(ConfigError, match=r"\.$"):
        parse_replan_policy(text)


def test_a_plugin_is_found_and_does_not_take_the_place_of_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [
        importlib.metadata.EntryPoint(name, "frida_painter.session.replan_policy:EveryNth.parse", REPLAN_POLICIES)
        for name in ("twice-as-often", "times")
    ]
    monkeypatch.setattr(registry, "_points_of_others", lambda path: [("unknown", point) for point in points])
    assert parse_replan_policy("twice-as-often:3") == EveryNth(3)
    assert parse_replan_policy("4") == EvenlySpaced(4)


policies = st.one_of(
    st.integers(0, 60).map(EvenlySpaced),
    st.integers(1, 60).map(EveryNth),
    st.integers(1, 60).map(lambda strokes: EveryNth(strokes, 0.1)),
    st.tuples(st.integers(1, 90), st.integers(0, 60)).map(lambda two: WhenItPays(0.1, two[0], two[1] - two[0])),
)


@given(policies, st.integers(1, 200))
def test_looks_come_one_after_another_and_the_last_stroke_is_looked_at(policy: ReplanPolicy, strokes: int) -> None:
    looks = [0, *looks_on_the_way(policy, strokes), strokes]
    assert all(one < other for one, other in itertools.pairwise(looks))
    for begin, end in itertools.pairwise(looks):
        assert all(policy.next_look(done, strokes) == end for done in range(begin, end))


@given(st.integers(0, 60), st.integers(1, 200))
def test_evenly_spaced_looks_are_at_the_ends_of_batches(replans: int, strokes: int) -> None:
    policy = EvenlySpaced(replans)
    ends = torch.tensor(policy.batches(strokes)).cumsum(0).tolist()
    assert [*looks_on_the_way(policy, strokes), strokes] == ends


def test_only_what_is_off_is_planned_again() -> None:
    policy = EveryNth(10, 0.02)
    assert not policy.wants_replan(CanvasSeen(10, 20, 0.02)) and policy.wants_replan(CanvasSeen(10, 20, 0.021))
    assert policy.wants_replan(CanvasSeen(10, 20, float("nan"))), "what cannot be told is looked into"
    assert EveryNth(5).wants_replan(CanvasSeen(10, 20, 0.0))


def test_a_policy_looks_more_often_where_looks_win_something() -> None:
    policy, done, looks = WhenItPays(0.05), 0, []
    for gain in (None, 0.3, 0.2, 0.01, 0.0, 0.04, 0.06):
        done = policy.next_look(done, 1000)
        looks.append(done)
        assert policy.wants_replan(CanvasSeen(done, 1000 - done, 0.0, gain))
    assert looks == [10, 30, 40, 50, 70, 110, 190]
    assert policy.next_look(done, 1000) == 230
    assert WhenItPays().next_look(150, 1000) == 170, "as after resuming, when it knows of no look"


def test_a_painting_tells_its_policy_what_planning_again_won() -> None:
    heard: list[float | None] = []

    class Hearing(EveryNth):
        def wants_replan(self, seen: CanvasSeen) -> bool:
            heard.append(seen.gain)
            return True

    setup = SessionSetup(8, policy=Hearing(2))
    setup.run()
    told = [event for event in setup.heard if isinstance(event, Planned)][1:]
    assert heard == [None, *(pytest.approx(10 * math.log10(one.loss_before / one.loss_after)) for one in told[:-1])]


class OftenWrong(NotingPlanner):
    """Expects a canvas as white as it is seen, but for the second look, which is to be grey."""

    looks = 0

    def expected(self, plan: Plan, canvas: Tensor, wetness: object = None) -> Tensor:
        return torch.full((3, 48, 64), 0.9) if len(plan) == 2 and self.looks == 1 else canvas

    def locate(self, *told):  # type: ignore[no-untyped-def]
        self.looks += 1
        return super().locate(*told)


def test_a_painting_looks_often_and_plans_again_only_where_the_canvas_is_off() -> None:
    setup = SessionSetup(
        8, planner=OftenWrong(), camera=PatientCamera(noisy=True), simulated=True, policy=EveryNth(2, 0.05)
    )
    assert setup.run().painted == 8 and setup.painted() == list(range(1, 9))
    assert [event.done for event in setup.heard if isinstance(event, Looked)] == [2, 4, 6, 8]
    assert setup.planner.asked == [4], "after the second look, four strokes being left"


def test_what_a_look_taught_is_kept_also_where_nothing_was_planned_again(tmp_path: Path) -> None:
    policy = EveryNth(2, 0.05)
    journal = Journal.begin(tmp_path, {}, {})
    first = SessionSetup(
        8,
        planner=OftenWrong(),
        camera=PatientCamera(noisy=True),
        simulated=True,
        policy=policy,
        stop_at=lambda event: isinstance(event, StrokePainted) and event.done == 3,
        journal=journal,
    )
    first.run()
    journal.close()
    assert first.planner.asked == []
    again, history = Journal.reopen(tmp_path)
    assert [planning.done for planning in history.planning.adopted] == [0, 2]
    known = [placement_of(planning) for planning in history.planning.adopted]
    assert known[1] == first.placements[0] != known[0]
    assert history.planning.adopted[1].photograph != history.planning.adopted[0].photograph
    again.record_resume(repaint=False)
    kept = load_kept_plan(tmp_path, history)
    assert kept is not None and not kept.foreign
    second = SessionSetup(
        8, planner=OftenWrong(), camera=PatientCamera(noisy=True), simulated=True, policy=policy, journal=again
    )
    white = torch.ones(3, 48, 64)
    painting = second.resume(
        PaintingProgress.resume(kept.plan, history.progress.painted, kept.planning.done, white, white)
    )
    again.close()
    assert painting.painted == 8 and second.painted() == [4, 5, 6, 7, 8]
    assert second.planner.located == [2, 2, 2], "strokes of which the first sitting had learned are not learned again"
