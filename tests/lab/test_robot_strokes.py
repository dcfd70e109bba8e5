import numpy as np
import pytest
import torch

from frida_painter.brush.kinds import FINE
from frida_painter.canvas_size import CanvasSize
from frida_painter.lab.sim2real import MarkSizes, SoftStrokes, as_plan, constrain_to_brush, render
from frida_painter.render import render as render_brush
from frida_painter.strokes import Strokes
from frida_painter.teaching.bezier import BezierStroke

SIZE = CanvasSize(0.12, 0.09)
MODEL = BezierStroke.typical(FINE).requires_grad_(False)
BARE = torch.ones(3, 90, 120)


def soft(points, radius: float, opacity: float = 1.0) -> SoftStrokes:
    return SoftStrokes(
        torch.tensor([points]), torch.full((1, 2), radius), torch.full((1, 2), opacity), torch.zeros(1, 3)
    )


def test_the_sizes_of_marks_are_those_of_the_ribbon():
    marks, ribbon = MarkSizes.of(MODEL), MODEL.ribbon
    assert (np.diff(marks.width) >= 0).all() and marks.thickness[0] == 0 and marks.thickness[-1] == 1
    # In the middle of a stroke its height is a quarter of that at the ends (0.2) and three quarters of its own.
    for at in (0, -1):
        height = 0.25 * 0.2 + 0.75 * marks.thickness[at]
        wanted = 2 * (ribbon.lightest + height * (ribbon.hardest - ribbon.lightest)) * ribbon.opacity / 1000
        assert marks.width[at] == pytest.approx(wanted, rel=0.12)
    # A ribbon is the same at both ends, where it is half as wide at most as far off as it is wide there.
    np.testing.assert_allclose(marks.before, marks.behind, atol=2 * MODEL.frame.pitch[0])
    assert (np.abs(marks.before) < marks.width).all()


def test_a_stroke_that_the_brush_can_paint_stays_where_and_what_it_is():
    freedom = constrain_to_brush(MODEL, SIZE)
    stroke = freedom.project(soft(((0.03, 0.03), (0.055, 0.055), (0.07, 0.045)), 0.003), SIZE)
    plan = as_plan(stroke, MODEL, SIZE, 1, BARE, seed=0)
    wanted = 1 - render(stroke, BARE, SIZE)

    def overlap(strokes: Strokes) -> float:
        got = 1 - render_brush(strokes, MODEL, BARE, SIZE)
        return float((wanted * got).sum() / wanted.square().sum().sqrt() / got.square().sum().sqrt())

    assert overlap(plan.strokes) > 0.85
    assert overlap(plan.strokes.with_groups(bend=-plan.strokes.bend)) < 0.6


def test_what_is_too_large_is_cut_around_its_middle_and_opacity_becomes_colour():
    huge = soft(((0.0, 0.045), (0.06, 0.045), (0.12, 0.045)), 0.03, opacity=0.5)
    plan = as_plan(huge, MODEL, SIZE, 1, BARE, seed=0)
    middle = plan.strokes.path(torch.tensor([0.5]))[0, 0]
    torch.testing.assert_close(middle, torch.tensor([0.06, 0.045]), atol=1e-5, rtol=0)
    assert float(plan.strokes.length) == pytest.approx(MODEL.limits.within(SIZE).length[1])
    assert float(plan.strokes.thickness) == 1.0
    assert float(plan.palette.color[0, 0]) == pytest.approx(0.5, abs=0.08)


def test_a_plan_has_as_many_strokes_in_the_same_order_and_no_more_paints_than_asked_for():
    chance = torch.Generator().manual_seed(0)
    many = SoftStrokes(
        0.09 * torch.rand(20, 3, 2, generator=chance),
        0.01 * torch.rand(20, 2, generator=chance),
        torch.rand(20, 2, generator=chance),
        torch.rand(20, 3, generator=chance),
    )
    plan = as_plan(many, MODEL, SIZE, 4, BARE, seed=0)
    assert len(plan) == 20 and len(plan.palette) == 4
    chord = many.points[:, 2] - many.points[:, 0]
    torch.testing.assert_close(plan.strokes.angle, torch.atan2(chord[:, 1], chord[:, 0]))
