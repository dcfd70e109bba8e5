from dataclasses import replace

import pytest
import torch

from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.planning.effort import Effort
from frida_painter.planning.optimize import optimize
from frida_painter.planning.planner import Planner
from frida_painter.planning.problem import Region, region_of
from frida_painter.render import render
from support.planning import CANVAS, goal, plain, problem, small_table, some_strokes

LEFT = torch.zeros(60, 80, dtype=torch.bool)
LEFT[:, :36] = True
SLIVER = torch.ones(60, 80, dtype=torch.bool)
SLIVER[30, 40] = False


def painted_inside(region: Region, strokes: object, rows: int = 192) -> float:
    """The most that any pixel of the forbidden part changes when strokes are painted black on white."""
    grid = PixelGrid.of_height(CANVAS, rows)
    white = torch.ones(3, grid.rows, grid.columns)
    black = replace(strokes, color=torch.zeros_like(strokes.color))  # type: ignore[attr-defined,type-var]
    picture = render(black, small_table(), white, CANVAS)  # type: ignore[arg-type]
    return float((1 - picture)[:, region.on(grid, widened=False)].max())


@pytest.mark.parametrize("seed", range(3))
def test_no_pixel_of_any_stroke_enters_and_most_strokes_find_a_place(seed: int) -> None:
    region, strokes = Region(LEFT), some_strokes(40, seed)
    touched = region.find_touching(strokes, small_table(), CANVAS, 96)
    assert 5 < int(touched.sum()) < 35
    kept, numbers = region.keep_clear(strokes, small_table(), CANVAS, 96)
    assert painted_inside(region, kept) < 1 / 255
    assert len(kept) == len(numbers) >= 36 and bool((numbers.diff() > 0).all())
    kept.check(small_table().limits, CANVAS)
    untouched = (~touched[numbers]).nonzero()[:, 0]
    assert torch.equal(kept.position[untouched], strokes.position[numbers[untouched]])
    assert torch.equal(kept.color, strokes.color[numbers])


def test_where_there_is_no_place_strokes_are_left_out() -> None:
    kept, numbers = Region(SLIVER).keep_clear(some_strokes(5), small_table(), CANVAS, 64)
    assert len(kept) == len(numbers) == 0


def test_margins_widen_and_grids_of_any_size_keep_every_forbidden_pixel() -> None:
    dot = torch.zeros(300, 400, dtype=torch.bool)
    dot[100, 200] = True
    for rows in (30, 75, 300, 600):
        grid = PixelGrid.of_height(CANVAS, rows)
        bare, wide = (Region(dot, margin=0.004).on(grid, widened=widened) for widened in (False, True))
        assert bool(bare.any()) and bool(wide[bare].all()) and int(wide.sum()) > int(bare.sum())
    assert not bool(Region(torch.zeros(20, 20, dtype=torch.bool)).on(PixelGrid.of_height(CANVAS, 50)).any())


def test_gradient_descent_draws_strokes_out_of_it() -> None:
    bare = problem(48)
    region = Region(LEFT, margin=0.0)
    forbidden = region.on(PixelGrid(CANVAS, *bare.canvas.shape[1:]))

    def inside(strokes: object) -> float:
        return float((bare.render(strokes) - bare.canvas)[:, forbidden].square().mean())  # type: ignore[arg-type]

    start = some_strokes(20)
    free, _ = optimize(start, bare, iterations=30)
    guarded, _ = optimize(start, region.guard(bare), iterations=30)
    assert inside(guarded) < 0.4 * inside(free)


def test_a_plan_made_again_keeps_clear_and_a_new_goal_keeps_the_region() -> None:
    effort = Effort().scale(0.05)
    planner = Planner(goal(), *plain(CANVAS, small_table(), rows=64, effort=effort, seed=1))
    white = torch.ones(3, planner.fine.rows, planner.fine.columns)
    plan = planner.plan(white, 12, 3)
    free, planner = planner, planner.keeping_clear(Region(LEFT))
    assert free.region is None and planner.region is not None
    assert planner.towards(goal()).region is planner.region
    steps: list[tuple[int, int]] = []
    again = planner.replan(plan, white, lambda step: steps.append((step.iteration, step.of)), rounds=2)
    assert painted_inside(planner.region, again.strokes) < 1 / 255
    assert [iteration for iteration, _ in steps] == list(range(1, steps[0][1] + 1))
    assert torch.equal(again.palette.color, plan.palette.color)
    fresh = planner.plan(white, 12, 3)
    assert painted_inside(planner.region, fresh.strokes) < 1 / 255
    planner = planner.keeping_clear(Region(SLIVER))
    assert len(planner.replan(plan, white)) == 0


def test_a_drawing_becomes_a_region_or_its_opposite() -> None:
    drawing = torch.zeros(3, 40, 40)
    drawing[:, 10:20, 10:20] = 1
    assert int(region_of(drawing, only_inside=False).forbidden.sum()) == 100
    assert int(region_of(drawing, only_inside=True).forbidden.sum()) == 1500
    with pytest.raises(ConfigError, match="Nothing was drawn"):
        region_of(torch.zeros(3, 40, 40), only_inside=True)
    with pytest.raises(ConfigError, match="All of the canvas"):
        region_of(torch.ones(3, 40, 40), only_inside=False)
    with pytest.raises(ConfigError, match="yes and no"):
        Region(torch.zeros(3, 4))
