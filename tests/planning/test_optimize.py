import copy
import math
import subprocess
import sys
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from frida_painter.brush.kinds import CoverageSpread, painted_area
from frida_painter.brush.table import StrokeTable
from frida_painter.errors import PlanningDiverged
from frida_painter.frames import PixelGrid
from frida_painter.planning import optimize as adam_module
from frida_painter.planning.optimize import Adam, Step, optimize, stacked_cost
from frida_painter.planning.problem import ObjectiveForms, PlanningProblem, StrokeWishes, unrest_of
from frida_painter.planning.variables import Paints
from frida_painter.strokes.palette import to_lab
from frida_painter.strokes.strokes import Strokes
from support.planning import CANVAS, problem, small_table, some_strokes

PROBLEM = problem(48)


def judged(strokes: Strokes, on: PlanningProblem = PROBLEM) -> float:
    with torch.no_grad():
        return float(on.objective(on.render(strokes)))


def turning_nan(after: int, for_good: bool = True) -> PlanningProblem:
    """The scene whose objective is NaN from its `after`-th call, or only in that one."""
    calls = 0

    def objective(picture: Tensor) -> Tensor:
        nonlocal calls
        calls += 1
        fails = calls > after if for_good else calls == after + 1
        return PROBLEM.objective(picture) * (math.nan if fails else 1)

    return replace(PROBLEM, objective=objective)


def test_strokes_get_better_and_stay_inside_their_limits() -> None:
    strokes = some_strokes(20)
    found, _ = optimize(strokes, PROBLEM, iterations=25)
    assert judged(found) < 0.8 * judged(strokes)
    assert len(found) == 20
    found.check(PROBLEM.limits, CANVAS)
    lightness = to_lab(found.color)[:, 0]
    assert bool((lightness.diff() <= 1e-4).all())


def area(strokes: Strokes) -> float:
    return float(painted_area(strokes.length, strokes.thickness, 1.0).sum())


def test_where_paint_has_a_price_less_of_it_makes_nearly_the_same_picture() -> None:
    strokes = some_strokes(30)
    free, _ = optimize(strokes, PROBLEM, iterations=40)
    priced, _ = optimize(strokes, replace(PROBLEM, wishes=StrokeWishes(paint_price=0.005)), iterations=40)
    assert area(priced) < 0.95 * area(free)
    assert judged(priced) < 1.15 * judged(free) < 0.6 * judged(strokes)


def test_the_price_of_paint_is_a_share_of_the_loss_whatever_its_size() -> None:
    strokes = some_strokes(5)
    darker = replace(PROBLEM, objective=lambda picture: 0.01 * PROBLEM.objective(picture))
    for on in (PROBLEM, darker):
        with torch.no_grad():
            once, loss = stacked_cost([strokes], [on]), on.expected_loss(strokes)
            priced = stacked_cost([strokes], [replace(on, wishes=StrokeWishes(paint_price=0.2))])
            twice = stacked_cost([strokes], [replace(on, wishes=StrokeWishes(paint_price=0.4))])
        assert once == loss < priced
        assert float((twice - loss) / (priced - loss)) == pytest.approx(2.0, rel=1e-4)
        assert float(priced / loss) == pytest.approx(
            float(
                stacked_cost([strokes], [replace(PROBLEM, wishes=StrokeWishes(paint_price=0.2))]).detach()
                / PROBLEM.expected_loss(strokes).detach()
            ),
            rel=1e-4,
        )


def test_every_colour_is_of_the_palette_and_the_palette_may_move_or_not() -> None:
    palette = torch.tensor([[0.9, 0.85, 0.8], [0.7, 0.3, 0.2], [0.1, 0.1, 0.2]])
    paints = Paints(palette, torch.arange(15) // 5)
    for vary in (True, False):
        found, kept = optimize(some_strokes(15), PROBLEM, iterations=10, paints=paints, vary_colors=vary)
        assert kept is not None and torch.allclose(found.color, kept.color[kept.paint], atol=1e-6)
        assert bool(((kept.color >= 0) & (kept.color <= 1)).all())
        assert torch.allclose(kept.color, palette, atol=1e-6) != vary
        assert sorted(kept.paint.tolist()) == sorted(paints.paint.tolist())


@pytest.mark.parametrize(("after", "found"), [(4, r"iteration 6, for the 3\. time.*another seed"), (0, "iteration 0")])
def test_the_third_step_that_is_not_finite_ends_it_and_a_first_one_at_once(after: int, found: str) -> None:
    """Fault F29: values that are not finite while planning."""
    steps: list[Step] = []
    with pytest.raises(PlanningDiverged, match=found):
        optimize(some_strokes(10), turning_nan(after), iterations=30, notify=steps.append)
    assert len(steps) == after and all(math.isfinite(step.loss) for step in steps)


def test_gradients_that_are_not_finite_never_reach_the_strokes() -> None:
    """Fault F29: values that are not finite while planning."""

    def objective(picture: Tensor) -> Tensor:  # its slope at 0 is 0 x infinity
        return PROBLEM.objective(picture) + 0 * (picture - picture.detach()).sqrt().mean()

    with pytest.raises(PlanningDiverged):
        optimize(some_strokes(10), replace(PROBLEM, objective=objective), iterations=10)


def test_one_step_that_is_not_finite_is_discarded_and_the_best_is_kept() -> None:
    """Fault F29: values that are not finite while planning."""
    strokes = some_strokes(10)
    found, _ = optimize(strokes, turning_nan(after=6, for_good=False), iterations=20)
    assert judged(found) < 0.95 * judged(strokes)
    found.check(PROBLEM.limits, CANVAS)
    assert all(bool(torch.isfinite(part).all()) for part in found.arrays().values())


def test_where_there_is_a_judge_it_says_which_strokes_were_best() -> None:
    """The objective wants darkness; the judge wants things as they were."""
    start = some_strokes(10)
    before = PROBLEM.render(start)
    eager = replace(PROBLEM, objective=lambda picture: picture.mean())
    found, _ = optimize(
        start, replace(eager, forms=ObjectiveForms(lambda picture: (picture - before).square().mean())), iterations=20
    )
    torch.testing.assert_close(PROBLEM.render(found), before)
    unjudged, _ = optimize(start, eager, iterations=20)
    assert float(PROBLEM.render(unjudged).mean()) < float(before.mean())


def test_where_marks_vary_the_expected_painting_is_planned_for() -> None:
    """What is minimised is the mean squared error over all paintings of the plan, not that of their mean picture."""
    varying = small_table_that_varies()
    on, strokes = replace(PROBLEM, model=varying), some_strokes(20)
    for_the_mean, _ = optimize(strokes, PROBLEM, iterations=25)
    for_all, _ = optimize(strokes, on, iterations=25)
    with torch.no_grad():
        assert float(on.expected_loss(for_all)) < float(on.expected_loss(for_the_mean))
        mean, variance = on.moments(for_all)
        assert float(on.expected_loss(for_all)) == pytest.approx(float(on.objective(mean) + variance.mean()))


def test_specks_of_the_canvas_count_where_the_picture_is_light_and_even() -> None:
    """Under strokes that let a share t of it show, the unrest of the canvas counts by t squared."""
    grid = PixelGrid(CANVAS, *PROBLEM.canvas.shape[1:])
    white = torch.ones_like(PROBLEM.canvas)
    grey, black, rough = 0.7 * white, 0 * white, 0.7 * white
    rough[:, ::2] = 0.5
    light = unrest_of(white, grey, grid)
    assert float(light.amin()) > 5 * 0.3**2 and not bool(unrest_of(grey, grey, grid).any())
    assert not bool(unrest_of(white, black, grid).any())
    assert float(unrest_of(white, rough, grid).amax()) < float(light.mean()) / 2
    on = replace(PROBLEM, model=small_table_that_varies(), wishes=StrokeWishes(unrest=light))
    strokes, plain = some_strokes(20), replace(on, wishes=StrokeWishes())
    with torch.no_grad():
        more = (on.moments(strokes).variance - plain.moments(strokes).variance) / light
        through = plain.render(strokes.with_groups(color=torch.zeros_like(strokes.color)))[0] / plain.canvas[0]
        bare = through > 0.999
        torch.testing.assert_close(more[bare], torch.ones_like(more[bare]), rtol=0.01, atol=0)
        assert bool((more >= through.square() - 1e-4).all()) and float(more.amin()) < 0.1
        assert float(on.expected_loss(strokes)) > float(plain.expected_loss(strokes))


def small_table_that_varies() -> StrokeTable:
    table = copy.copy(small_table())
    table.spread = CoverageSpread(0.9, 1.0)
    return table


BETAS = (0.9, 0.98)


@pytest.mark.parametrize("compiled", [False, True], ids=["plain", "compiled"])
def test_its_steps_are_those_of_torch(monkeypatch: pytest.MonkeyPatch, compiled: bool) -> None:
    """Those of PyTorch's operations bit for bit, those of the compiled loops but for rounding."""
    monkeypatch.setattr(adam_module, "compiles_for", lambda leaf: compiled)
    random = torch.Generator().manual_seed(0)
    ours = [torch.randn(shape, generator=random).requires_grad_() for shape in ((300, 6), (12, 3))]
    torchs = [leaf.detach().clone().requires_grad_() for leaf in ours]
    adam, oracle = Adam(ours), torch.optim.Adam(torchs, betas=BETAS, foreach=True)
    for iteration in range(60):
        adam.forget_gradients()
        oracle.zero_grad()
        for leaves in (ours, torchs):
            sum((leaf.sin() * leaf * (iteration % 7 - 2.5)).sum() for leaf in leaves).backward()
        rate = 0.1 / (1 + iteration)
        oracle.param_groups[0]["lr"] = rate
        oracle.step()
        adam.step(rate)
        for one, other in zip(ours, torchs, strict=True):
            torch.testing.assert_close(one, other, atol=1e-5 if compiled else 0, rtol=0, msg=str(iteration))


def test_planning_does_not_load_the_compiler() -> None:
    code = (
        "import sys, torch; from frida_painter.planning.optimize import Adam\n"
        "leaf = torch.ones(3, requires_grad=True); leaf.sum().backward(); Adam([leaf]).step(0.1)\n"
        "sys.exit('torch._dynamo' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
