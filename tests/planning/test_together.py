"""Layers that are settled together, and iterations that look at some rows in turn."""

import copy
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import pytest
import torch
from torch import Tensor

from frida_painter.brush.kinds import BROAD, FINE, MEDIUM, BrushKind, CoverageSpread
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.objectives.interpretation import WeightedObjective, prepare
from frida_painter.objectives.objective import Goal, ObjectiveTerm
from frida_painter.planning.effort import Effort
from frida_painter.planning.initialize import best_proposals
from frida_painter.planning.layers import beneath, find_later_mixing
from frida_painter.planning.optimize import (
    Step,
    StrokesInScene,
    find_renewals,
    interlace_rows,
    optimize,
    optimize_together,
    stacked_cost,
    take_turns,
)
from frida_painter.planning.planner import Planner
from frida_painter.planning.problem import ObjectiveForms, PlanningProblem, Region, StrokeWishes
from frida_painter.planning.variables import Paints
from frida_painter.strokes.strokes import Strokes
from frida_painter_calibration.teaching.bezier import BezierStroke
from support.planning import CANVAS, goal, plain, problem, small_table, some_strokes, target


def varying(rows: int = 48) -> PlanningProblem:
    """A scene whose marks vary."""
    table = copy.copy(small_table())
    table.spread = CoverageSpread(0.5, 0.95)
    return replace(problem(rows), model=table, wishes=StrokeWishes(paint_price=0.0003))


def planner(layers: int = 3, **more: object) -> Planner:
    facts = {"rows": 64, "effort": Effort().scale(0.1), "seed": 1, "new_paints": True, **more}
    return Planner(goal(), *plain(CANVAS, small_table(), layers=layers, **facts))


def cost(parts: Sequence[StrokesInScene]) -> float:
    with torch.no_grad():
        return float(stacked_cost([part.strokes for part in parts], [part.problem for part in parts]))


def test_errors_count_below_other_layers_as_they_do_on_the_canvas() -> None:
    on = problem()
    above = [(some_strokes(9, 1), on), (some_strokes(7, 2), on)]
    strokes = some_strokes(8, 3)
    for other in (strokes, some_strokes(8, 4)):
        seen, wanted = beneath(above, strokes, on, target(on))
        below = on.render(other)
        left = below
        for laid, scene_above in above:
            left = replace(scene_above, canvas=left).render(laid)
        assert seen.wishes.importance is not None
        open_ = seen.wishes.importance > 0.05**2
        found = seen.wishes.importance * (below - wanted).square()
        torch.testing.assert_close(found[:, open_], (left - target(on)).square()[:, open_], rtol=1e-3, atol=1e-6)
        assert bool(open_.any()) and not bool(open_.all())


def test_no_stroke_is_proposed_where_later_layers_cover_the_canvas() -> None:
    on = problem()
    cover = some_strokes(60, 5)
    left = cover.with_groups(
        position=cover.position * torch.tensor([0.3, 1.0]), length=torch.full((60,), 0.03), thickness=torch.ones(60)
    )
    seen, wanted = beneath([(left, on)], some_strokes(4), on, target(on))
    assert seen.wishes.importance is not None
    covered = seen.wishes.importance < 0.01
    assert float(covered.float().mean()) > 0.1
    found = best_proposals(some_strokes(4), None, 12, seen, wanted, 24, generator=torch.Generator().manual_seed(1))
    rows, columns = covered.shape
    column = (found.strokes.position[:, 0] / CANVAS.width * columns).long().clamp(0, columns - 1)
    row = ((1 - found.strokes.position[:, 1] / CANVAS.height) * rows).long().clamp(0, rows - 1)
    assert not bool(covered[row, column].all()) and float(covered[row, column].float().mean()) < 0.25


def test_parts_become_better_together_than_each_alone() -> None:
    on = varying()
    alone, below, greedy = [], on.canvas, []
    for number in range(2):
        here = replace(on, canvas=below)
        strokes, _ = optimize(some_strokes(12, number), here, iterations=40)
        greedy.append(StrokesInScene(strokes, on))
        alone.append(strokes)
        below = here.render(strokes).detach()
    together = optimize_together(greedy, iterations=40)
    assert cost(together) < 0.97 * cost(greedy)
    for part in together:
        part.strokes.check(on.limits, CANVAS)


@pytest.mark.parametrize("pace", [1.0, 50.0])
def test_what_comes_back_is_never_worse_however_wild_the_steps(pace: float) -> None:
    on = varying()
    for iterations in (0, 1, 9):
        parts = [
            StrokesInScene(some_strokes(6, 1), on),
            StrokesInScene(some_strokes(0), on),
            StrokesInScene(some_strokes(5, 2), on),
        ]
        found = optimize_together(parts, iterations=iterations, pace=pace)
        assert [len(part.strokes) for part in found] == [6, 0, 5]
        assert cost(found) <= cost(parts) + 1e-7


def test_paints_that_may_not_change_do_not() -> None:
    on, strokes = varying(), some_strokes(8)
    paints = Paints(strokes.color[:4].clone(), torch.arange(8) % 4)
    fixed, free = optimize_together(
        [StrokesInScene(strokes, on, paints, False), StrokesInScene(strokes, on, paints)], iterations=6
    )
    assert fixed.paints is not None and free.paints is not None
    torch.testing.assert_close(fixed.paints.color, paints.color)
    assert not torch.allclose(free.paints.color, paints.color, atol=1e-4)


def test_steps_show_the_strokes_of_all_parts() -> None:
    on, steps = varying(), list[Step]()
    optimize_together(
        [StrokesInScene(some_strokes(4), on), StrokesInScene(some_strokes(3, 1), on)], iterations=5, notify=steps.append
    )
    assert [[len(strokes) for _, strokes in step.parts] for step in steps] == [[4, 3]] * 5
    assert [(step.iteration, step.of) for step in steps] == [(number, 5) for number in range(1, 6)]
    first = [strokes for _, strokes in steps[0].parts]
    assert float(stacked_cost(first, [on, on])) == pytest.approx(steps[0].loss, rel=1e-5)


def test_a_plan_of_layers_is_better_than_one_whose_layers_are_grown_one_after_the_other() -> None:
    by = planner()
    plan = by.plan(strokes=36, colors=4)
    unsettled = planner(effort=replace(by.effort, rounds=0, polishing=0)).plan(strokes=36, colors=4)
    assert plan.layer_sizes == unsettled.layer_sizes
    assert by.cost(plan, by.bare) < 0.95 * by.cost(unsettled, by.bare)


@pytest.mark.parametrize("fresh", [False, True])
def test_paints_of_later_layers_may_change_until_they_are_mixed(fresh: bool) -> None:
    by = planner()
    plan = by.plan(strokes=36, colors=4)
    first, second, _ = plan.layer_sizes
    rest = plan.part(slice(first if fresh else first + 2, None))
    assert find_later_mixing(rest, True, fresh=fresh) == [fresh, True]
    assert find_later_mixing(rest, False, fresh=fresh) == [False, False]
    assert find_later_mixing(plan, True, fresh=True) == [False, True, True], "what is in the wells at first is mixed"
    canvas = by.expected(plan.part(slice(0, len(plan) - len(rest)))) * 0.8  # the cost falls by 9 to 21 %
    again = by.replan(rest, canvas, fresh=fresh)
    begun, later = (
        torch.equal(new.palette.color, old.palette.color)
        for new, old in zip(again.filled_layers(), rest.filled_layers(), strict=True)
    )
    assert by.cost(again, canvas) < by.cost(rest, canvas)
    assert begun is not fresh and not later
    assert again.layer_sizes == rest.layer_sizes == (0, second - (0 if fresh else 2), plan.layer_sizes[2])


def test_more_paints_than_a_plan_has_are_refused_before_anything_is_planned() -> None:
    steps: list[Step] = []
    with pytest.raises(ConfigError, match=r"24 paints for each of 3 layers .* at most 64: give --colors 21 or fewer"):
        planner().plan(strokes=36, colors=24, notify=steps.append)
    assert steps == []


def test_what_networks_judge_is_grown_more_and_settled_in_fewer_rounds() -> None:
    of_pictures = Effort().scale(0.5)
    of_words = of_pictures.for_network_objectives()
    assert (of_words.rounds, of_words.settling) == (3, of_pictures.refining)
    assert of_words.growing_of(2).growing_together > of_pictures.growing_of(2).growing_together
    assert of_words.growing_of(1) == of_words and replace(of_pictures, rounds=1).for_network_objectives().rounds == 1


def slow_scene(lasts: int, calls: list[int]) -> PlanningProblem:
    """A scene with a term that is slow, and counts its calls."""
    on, wanted = problem(), 0.4 * torch.ones(3, 1, 1)

    def slow(picture: torch.Tensor) -> torch.Tensor:
        calls.append(1)
        return (picture.mean((1, 2), keepdim=True) - wanted).square().mean() + (picture - target(on)).abs().mean()

    objective = WeightedObjective([(1.0, ObjectiveTerm(slow, lasts=lasts))])
    return replace(on, objective=objective, forms=ObjectiveForms(sparing=objective.sparing))


@pytest.mark.parametrize("protected", [False, True], ids=["all free", "some protected"])
def test_a_slow_term_is_computed_in_every_few_iterations_and_the_plan_gains_nearly_as_much(protected: bool) -> None:
    found, strokes = {}, some_strokes(12, 0)
    for lasts in (1, 4):
        calls: list[int] = []
        on = slow_scene(lasts, calls)
        if protected:
            forbidden = torch.zeros(on.canvas.shape[1:], dtype=torch.bool)
            forbidden[:10, :10] = True
            on = Region(forbidden).guard(on)
        before = float(on.expected_loss(strokes).detach())
        calls.clear()
        better, _ = optimize(strokes, on, iterations=24)
        assert len(calls) == {1: 25, 4: 7}[lasts]  # and once more at the end, to compare
        found[lasts] = before - float(on.expected_loss(better).detach())
    assert found[4] > 0.7 * found[1] > 0


def test_the_turns_of_a_slow_term_begin_with_one_that_computes_it() -> None:
    on = slow_scene(3, [])
    turns = take_turns([on, on], 7)
    assert [comparable for _, comparable in turns] == [True, False, False, True, False, False, True, True]
    picture = on.canvas.clone()
    anew = float(turns[0][0][0].objective(picture))
    assert anew == pytest.approx(float(on.objective(picture))) == float(turns[1][0][0].objective(picture))
    plain = problem()
    assert [comparable for _, comparable in take_turns([plain], 2)] == [True] * 3
    assert len(take_turns([plain], 0)) == len(take_turns([on], 0)) == 1


@pytest.mark.parametrize("pace", [1.0, 0.5])
def test_smooth_terms_are_computed_after_equal_ways_and_not_after_equal_times(pace: float) -> None:
    on = slow_scene(4, [])
    assert on.forms.sparing is not None
    by_time = on.forms.sparing()
    by_way = replace(by_time, smooth=True)
    assert find_renewals(80, by_time) == set(range(0, 80, 4))
    found = sorted(find_renewals(80, by_way, pace))
    gaps = [after - before for before, after in pairwise(found)]
    assert found[0] == 0 and min(gaps) >= 4 and gaps[-1] > 2 * gaps[1], "small steps at the end do not go far"
    assert len(found) <= 11 * pace + 1


PAPER = CanvasSize(0.3556, 0.2794)


def by_rows(rows: int = 480, wanted: Goal | None = None) -> PlanningProblem:
    """A scene whose marks vary and whose objective may be asked about some rows; 480 rows have four turns."""
    table = copy.copy(small_table())
    table.spread = CoverageSpread(0.5, 0.95)
    bare = problem(rows)
    judge = prepare(wanted or goal(), PixelGrid(CANVAS, *bare.canvas.shape[1:]))
    forms, wishes = ObjectiveForms(on_rows=judge.on_rows), StrokeWishes(paint_price=0.0003)
    return replace(bare, model=table, objective=judge, forms=forms, wishes=wishes)


def judged(strokes: Strokes, on: PlanningProblem) -> float:
    with torch.no_grad():
        return float(stacked_cost([strokes], [on]))


def cost_and_slopes(strokes: Strokes, on: PlanningProblem) -> list[Tensor]:
    leaves = {name: part.clone().requires_grad_() for name, part in strokes.arrays().items()}
    cost = stacked_cost([Strokes(**leaves)], [on])
    return [cost.detach(), *torch.autograd.grad(cost, list(leaves.values()))]


@pytest.mark.parametrize(
    ("kind", "turns"),
    [(BROAD, {128: 1, 256: 2, 512: 4, 1024: 8}), (MEDIUM, {256: 1, 512: 2, 1024: 5}), (FINE, {512: 1, 1024: 3})],
    ids=lambda one: getattr(one, "name", ""),
)
def test_rows_are_as_far_apart_at_any_resolution_and_nearer_for_smaller_marks(
    kind: BrushKind, turns: dict[int, int]
) -> None:
    judge = prepare(goal(), PixelGrid.of_height(PAPER, 32))
    for rows, count in turns.items():
        canvas = torch.empty(3, rows, 1)
        on = PlanningProblem(canvas, PAPER, BezierStroke.typical(kind), judge, ObjectiveForms(on_rows=judge.on_rows))
        assert len(interlace_rows([on])) == count


@pytest.mark.parametrize("guarded", [False, True], ids=["all free", "some protected"])
def test_the_turns_have_the_cost_and_the_slopes_of_the_whole_in_the_mean(guarded: bool) -> None:
    on = by_rows()
    if guarded:
        forbidden = torch.zeros(90, 120, dtype=torch.bool)
        forbidden[:41, :33] = True
        on = Region(forbidden).guard(on)
    strokes = some_strokes(15)
    turns = [turn for (turn,) in interlace_rows([on])]
    assert len(turns) == 4
    each = [cost_and_slopes(strokes, turn) for turn in turns]
    for whole, *parts in zip(cost_and_slopes(strokes, on), *each, strict=True):
        mean = torch.stack(parts).mean(0)
        torch.testing.assert_close(mean, whole, rtol=1e-4, atol=5e-3 * float(whole.abs().max()))


@pytest.mark.parametrize("pace", [1.0, 50.0])
@pytest.mark.parametrize("iterations", [0, 1, 2, 9])
def test_what_comes_back_of_some_rows_is_never_worse_however_wild_the_steps(pace: float, iterations: int) -> None:
    on = by_rows(240)
    assert len(interlace_rows([on])) == 2
    for seed in range(3):
        strokes = some_strokes(12, seed)
        found, _ = optimize(strokes, on, iterations=iterations, pace=pace)
        assert judged(found, on) <= judged(strokes, on) + 1e-7
        found.check(on.limits, CANVAS)


def test_steps_tell_the_loss_of_what_was_looked_at() -> None:
    on, steps = by_rows(), list[Step]()
    optimize(some_strokes(8), on, iterations=7, notify=steps.append)
    turns = [turn for (turn,) in interlace_rows([on])]
    for step, seen in zip(steps, [on, *turns[1:], turns[0], *turns[1:3]], strict=True):
        ((_, shown),) = step.parts
        assert judged(shown, seen) == pytest.approx(step.loss, rel=1e-4)
