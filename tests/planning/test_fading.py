"""What it costs that strokes lack paint."""

from dataclasses import replace

import pytest
import torch

from frida_painter.plan import Plan
from frida_painter.planning.effort import Effort
from frida_painter.planning.forecast import Fading, fading_of
from frida_painter.planning.planner import Planner
from frida_painter.planning.problem import PlanningProblems
from frida_painter.render import composite
from support.planning import CANVAS, goal, plain, small_table
from support.plans import in_layers, made_up_plan

PLANNER = Planner(goal(), plain(CANVAS, small_table(), rows=64, effort=Effort().scale(0.1), seed=1, layers=2))
BARE = torch.ones(3, 64, 64)


def plan_in_layers(*sizes: int) -> Plan:
    plan = made_up_plan(sum(sizes), 4, seed=2)
    limits = PLANNER.models[PLANNER.brushes[0]].limits
    layer = replace(plan.layers[0], brush=PLANNER.brushes[0], limits=limits)
    there = replace(plan, canvas=CANVAS, layers=(layer,), strokes=plan.strokes.project(limits, CANVAS))
    return in_layers(there, *sizes)


def fading(plan: Plan) -> Fading:
    """By the random signs of one seed; it is right in the mean of many."""
    return fading_of(plan, BARE, PLANNER.problems, PLANNER.coarse, 3)


def test_what_a_stroke_costs_that_lacks_paint_is_what_the_painting_loses() -> None:
    plan = plan_in_layers(12)
    (strokes,), (problem,) = PLANNER.problems.stack(plan, BARE, PLANNER.coarse)
    guide = PLANNER.problems.guide(problem)
    assert guide is not None
    several = [fading_of(plan, BARE, PLANNER.problems, PLANNER.coarse, seed) for seed in range(30)]
    slope, square = several[0].slope, torch.stack([one.square for one in several]).mean(0)
    magnitude, affine = problem.marks(strokes)
    for lacks in (0.3, 0.7):
        errors = []
        for stroke in range(-1, 12):
            left = torch.ones(12)
            if stroke >= 0:
                left[stroke] -= lacks
            picture = composite(magnitude * left[:, None, None], affine, strokes.color, problem.canvas)
            errors.append(float((picture - guide).square().sum()))
        true = torch.tensor(errors[1:]) / errors[0] - 1
        told = lacks * slope + lacks**2 * square
        assert torch.corrcoef(torch.stack((true, told)))[0, 1] > 0.95
        assert float((told - true).abs().mean()) < 0.2 * float(true.abs().mean())


def test_what_later_layers_cover_may_lack_paint() -> None:
    """The same strokes again on top: the ones below are hardly seen, as are those below a layer of their brush."""
    plan = plan_in_layers(8)
    twice = replace(
        plan, strokes=plan.strokes[[*range(8), *range(8)]], paint=plan.paint.repeat(2), layers=2 * plan.layers
    )
    found = fading(twice)
    assert found.square.shape == (16,)
    assert float(found.square[:8].sum()) < 0.2 * float(found.square[8:].sum())


def test_the_strokes_that_would_be_missed_least_go_first() -> None:
    plan = plan_in_layers(10, 6)
    (strokes,), (problem,) = PLANNER.problems.stack(plan, BARE, PLANNER.coarse)
    guide = PLANNER.problems.guide(problem)
    assert guide is not None

    def error(kept: list[int]) -> float:
        with torch.no_grad():
            return float((problem.render(strokes[kept]) - guide).square().sum())

    order = torch.argsort(fading(plan).without_paint)
    best, worst = (error(some.sort().values.tolist()) for some in (order[-10:], order[:10]))
    assert best < worst
    left = PLANNER.without_weakest(plan, BARE, 6)
    assert [layer.strokes for layer in left.layers] == [
        sum(number >= 6 for number in torch.argsort(order)[:10].tolist()),
        sum(number >= 6 for number in torch.argsort(order)[10:].tolist()),
    ]


def test_some_strokes_are_asked_by_their_numbers() -> None:
    found = fading(plan_in_layers(6))
    some = found.of([4, 1])
    assert some.square.tolist() == [found.square[4], found.square[1]] and some.slope[0] == found.slope[4]
    assert Fading.none(3).square.tolist() == [0, 0, 0]


def test_it_is_the_same_every_time() -> None:
    plan = plan_in_layers(5, 4)
    assert torch.equal(fading(plan).square, fading(plan).square)


def test_without_a_picture_that_guides_strokes_count_by_the_area_in_which_they_are_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(PlanningProblems, "guide", lambda self, problem: None)
    found = fading(plan_in_layers(7))
    assert float(found.square.sum()) == pytest.approx(1) and float(found.square.min()) >= 0
    assert not bool(found.slope.any())


@pytest.mark.parametrize("failure", [MemoryError(), RuntimeError("[enforce fail] not enough memory")])
def test_without_memory_a_plan_is_painted_as_if_paint_did_not_matter(
    failure: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def short(*_: object) -> Fading:
        raise failure

    monkeypatch.setattr("frida_painter.planning.forecast.loss_of_paint", short)
    assert PLANNER.fading(plan_in_layers(4), BARE).without_paint.tolist() == [0, 0, 0, 0]
    monkeypatch.setattr("frida_painter.planning.forecast.loss_of_paint", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        PLANNER.fading(plan_in_layers(4), BARE)
