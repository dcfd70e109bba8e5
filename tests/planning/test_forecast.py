import copy
import dataclasses
import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.nn.functional import avg_pool2d

from frida_painter.brush.kinds import CoverageSpread
from frida_painter.frames import PixelGrid, pixel_to_map
from frida_painter.planning.effort import Effort
from frida_painter.planning.forecast import Fading, SimilarityForecast, fading_of, forecast
from frida_painter.planning.optimize import stacked_moments
from frida_painter.planning.placement import Placement
from frida_painter.planning.planner import Planner
from frida_painter.planning.problem import PlanningProblem
from frida_painter.render import composite
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.system import images
from support.planning import CANVAS, as_it_is, goal, plain, problem, small_table, some_strokes
from support.plans import in_layers, made_up_plan


def varying(share: float) -> PlanningProblem:
    table = copy.copy(small_table())
    table.spread = CoverageSpread(share, 1.0)
    return replace(problem(), model=table)


def known(millimetres: float) -> Placement:
    information = torch.eye(3, dtype=torch.float64) / (millimetres / 1000) ** 2
    return Placement((0.0, 0.0, 0.0), tuple(map(tuple, information.tolist())))


def photograph(on: PlanningProblem) -> torch.Tensor:
    """The goal's photograph, of the size in which is planned."""
    return images.resize_by_area(goal().terms[0].picture, *on.canvas.shape[1:])


def test_it_expects_the_squared_error_of_all_paintings_of_the_plan() -> None:
    on, strokes = varying(0.5), some_strokes(12)
    found = forecast(goal(), [strokes], [on], None, 12)
    mean, variance = on.moments(strokes)
    error = float((mean - photograph(on)).square().mean() + variance.mean())
    assert found.expected == pytest.approx(-10 * math.log10(error), abs=1e-4)
    assert found.least < found.expected < found.most


def test_what_goes_wrong_by_chance_is_repaired_by_strokes_that_are_planned_after_a_look() -> None:
    blind, half, all_but_half, seen = (
        forecast(goal(), [some_strokes(12)], [varying(0.5)], None, unseen, painted=painted).expected
        for unseen, painted in ((12, 0), (6, 0), (0, 12), (0, 0))
    )
    assert blind < half < seen and half == pytest.approx(all_but_half)
    sure = [forecast(goal(), [some_strokes(12)], [varying(0)], None, unseen).expected for unseen in (0, 12)]
    assert sure[0] == pytest.approx(sure[1]), "there is no chance"


def test_the_range_by_chance_is_that_of_strokes_that_leave_more_or_less_paint() -> None:
    """Each stroke's coverage off by the same share of its deviation everywhere, up or down by the toss of a coin."""
    share = 0.01  # so small that first order is all
    on, strokes = varying(share), some_strokes(6)
    found = forecast(goal(), [strokes], [on], Placement.unknown(), 0)
    magnitude = on.model(strokes.thickness, strokes.length, strokes.bend)
    deviation = on.spread.variance(magnitude).sqrt()
    affine = pixel_to_map(
        strokes.position, strokes.angle, PixelGrid(CANVAS, *on.canvas.shape[1:]), on.model.frame
    )  # fmt: skip
    coins = torch.cartesian_prod(*[torch.tensor([-1.0, 1.0])] * 6)
    errors = []
    for coin in coins:
        picture = composite(magnitude + coin[:, None, None] * deviation, affine, strokes.color, on.canvas)
        errors.append(float((picture - photograph(on)).square().mean()))
    half = SimilarityForecast.of_error(10 ** (-found.expected / 10), float(torch.tensor(errors).std(correction=0)))
    assert found.most - found.expected == pytest.approx(half.most - half.expected, rel=0.1)


def test_what_is_not_known_of_the_placement_costs_as_long_as_it_is_not_seen() -> None:
    on, strokes = varying(0.3), some_strokes(12)
    sure, later, never = (forecast(goal(), [strokes], [on], known(4.0), unseen) for unseen in (0, 3, 12))
    assert sure.expected >= later.expected >= never.expected
    assert never.most - never.least > sure.most - sure.least
    exact, blind = (forecast(goal(), [strokes], [on], placement, 12) for placement in (known(1e-6), None))
    assert exact.expected == pytest.approx(blind.expected, abs=1e-3)


def test_strokes_of_two_brushes_are_laid_one_over_the_other() -> None:
    """With one brush for both parts the moments are those of all strokes at once, and so are error and chance."""
    on, strokes = varying(0.6), some_strokes(12)
    parts, problems = [strokes[:7], strokes[7:]], [on, on]
    for whole, stacked in zip(on.moments(strokes), stacked_moments(parts, problems), strict=True):
        assert torch.allclose(whole, stacked, atol=1e-6)
    for placement, unseen in ((Placement.unknown(), 0), (known(4.0), 9)):
        whole = forecast(goal(), [strokes], [on], placement, unseen)
        stacked = forecast(goal(), parts, problems, placement, unseen)
        assert dataclasses.astuple(stacked) == pytest.approx(dataclasses.astuple(whole), abs=1e-4)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.05, 0.5))
def test_of_a_finished_painting_it_is_its_similarity_by_areas(seed: int, contrast: float) -> None:
    """Of pictures with more detail than is planned in; another library's averages are the other side."""
    generator = torch.Generator().manual_seed(seed)
    wanted, seen = (0.5 + contrast * (torch.rand(3, 90, 120, generator=generator) - 0.5) for _ in range(2))
    planner = Planner(as_it_is(wanted), *plain(CANVAS, small_table(), rows=30))
    limits, nothing = small_table().limits, torch.zeros(0, dtype=torch.long)
    empty = Plan.of(some_strokes(0), Palette(torch.zeros(1, 3)), nothing, canvas=CANVAS, brush="small", limits=limits)
    error = (avg_pool2d(wanted, 3) - avg_pool2d(seen, 3)).square().mean()
    assert planner.forecast(empty, seen).expected == pytest.approx(-10 * math.log10(float(error)), abs=1e-3)


def test_only_goals_with_a_photograph_have_one() -> None:
    planner = Planner(goal(), *plain(CANVAS, small_table(), rows=32, effort=Effort().scale(0.02)))
    plan = planner.plan(strokes=3, colors=2)
    assert str(planner.forecast(plan, planner.bare)).count("dB expected") == 1
    wordy = SimpleNamespace(terms=(SimpleNamespace(is_pixelwise=False, picture=None),))
    assert forecast(wordy, [plan.strokes], [varying(0.3)]) is None


PLANNER = Planner(goal(), *plain(CANVAS, small_table(), rows=64, effort=Effort().scale(0.1), seed=1, layers=2))
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
