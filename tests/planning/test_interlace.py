"""Iterations that look at some rows in turn."""

import copy
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from frida_painter.brush.kinds import BROAD, FINE, MEDIUM, BrushKind, CoverageSpread
from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.objectives.interpretation import prepare
from frida_painter.objectives.objective import Goal
from frida_painter.planning.optimize import Step, interlace_rows, optimize, stacked_cost
from frida_painter.planning.problem import PlanningProblem, Region
from frida_painter.strokes import Strokes
from frida_painter_calibration.teaching.bezier import BezierStroke
from support.planning import CANVAS, goal, problem, small_table, some_strokes

PAPER = CanvasSize(0.3556, 0.2794)


def by_rows(rows: int = 480, wanted: Goal | None = None) -> PlanningProblem:
    """A scene whose marks vary and whose objective may be asked about some rows; 480 rows have four turns."""
    table = copy.copy(small_table())
    table.spread = CoverageSpread(0.5, 0.95)
    bare = problem(rows)
    judge = prepare(wanted or goal(), PixelGrid(CANVAS, *bare.canvas.shape[1:]))
    return replace(bare, model=table, objective=judge, objective_on_rows=judge.on_rows, paint_price=0.0003)


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
        on = PlanningProblem(canvas, PAPER, BezierStroke.typical(kind), judge, objective_on_rows=judge.on_rows)
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
def test_what_comes_back_is_never_worse_however_wild_the_steps(pace: float, iterations: int) -> None:
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
