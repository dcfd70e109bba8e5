import numpy as np
import pytest
import torch

from frida_painter.brush.kinds import FINE
from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.render import render as brush_render
from frida_painter.strokes.strokes import Strokes
from frida_painter_calibration.teaching.bezier import BezierStroke
from frida_painter_lab.soft_strokes import (
    Freedom,
    MarkSizes,
    SoftPlanner,
    SoftStrokes,
    allow_any_stroke,
    as_plan,
    constrain_to_brush,
    render,
    seen_colors,
)

SIZE = CanvasSize(0.2, 0.1)
BARE = torch.ones(3, 100, 200, dtype=torch.float64)


def stroke(points, radius=(0.01, 0.01), opacity=(1.0, 1.0), color=(0.0, 0.0, 0.0)) -> SoftStrokes:
    return SoftStrokes(*(torch.tensor([part], dtype=torch.float64) for part in (points, radius, opacity, color)))


STRAIGHT = ((0.05, 0.05), (0.1, 0.05), (0.15, 0.05))


def covered(strokes: SoftStrokes) -> torch.Tensor:
    return 1 - render(strokes, BARE, SIZE)[0]


def test_it_lies_where_it_should_and_its_middle_hangs_half_of_its_bow_aside():
    alpha = covered(stroke(((0.05, 0.03), (0.1, 0.07), (0.15, 0.03)), radius=(0.004, 0.004)))
    row, _ = PixelGrid(SIZE, 100, 200).to_pixels(torch.tensor([[0.1, 0.05]], dtype=torch.float64))[0].flip(0)
    column = alpha[:, 100]
    center = float((column * torch.arange(100)).sum() / column.sum())
    assert center == pytest.approx(float(row), abs=0.5)


def test_it_tapers_and_fades_from_its_start_to_its_end():
    alpha = covered(stroke(STRAIGHT, radius=(0.012, 0.004), opacity=(1.0, 0.5)))
    start, end = alpha[:, 60], alpha[:, 140]  # at a tenth and nine tenths of its way, a pixel is a millimetre
    assert float(start.max()) == pytest.approx(0.95, abs=0.02) and float(end.max()) == pytest.approx(0.55, abs=0.02)
    assert float((start > 0.2).sum()) > 2 * float((end > 0.2).sum()) > 10


def test_projection_holds_strokes_to_their_freedom_and_stays_there():
    chance = torch.Generator().manual_seed(3)
    wild = SoftStrokes(
        0.6 * torch.rand(40, 3, 2, generator=chance) - 0.2,
        0.1 * torch.rand(40, 2, generator=chance),
        3 * torch.rand(40, 2, generator=chance) - 1,
        3 * torch.rand(40, 3, generator=chance) - 1,
    )
    freedom = Freedom((0.01, 0.05), (0.002, 0.008), (-0.01, 0.01), (0.5, 1.0), tapered=False)
    held = freedom.project(wild, SIZE)
    assert ((held.length() > 0.01 - 1e-6) & (held.length() < 0.05 + 1e-6)).all()
    assert ((held.radius >= 0.002) & (held.radius <= 0.008)).all() and (held.radius[:, 0] == held.radius[:, 1]).all()
    assert ((held.opacity >= 0.5) & (held.opacity <= 1)).all() and ((held.color >= 0) & (held.color <= 1)).all()
    for name, part in freedom.project(held, SIZE).arrays().items():
        torch.testing.assert_close(part, held.arrays()[name], rtol=1e-4, atol=1e-6)


# From soft strokes to strokes of a robot.

SMALL, WHITE = CanvasSize(0.12, 0.09), torch.ones(3, 90, 120)
BRUSH_MODEL = BezierStroke.typical(FINE).requires_grad_(False)


def soft(points, radius: float, opacity: float = 1.0) -> SoftStrokes:
    return SoftStrokes(
        torch.tensor([points]), torch.full((1, 2), radius), torch.full((1, 2), opacity), torch.zeros(1, 3)
    )


def test_the_sizes_of_marks_are_those_of_the_ribbon():
    marks, ribbon = MarkSizes.of(BRUSH_MODEL), BRUSH_MODEL.ribbon
    assert (np.diff(marks.width) >= 0).all() and marks.thickness[0] == 0 and marks.thickness[-1] == 1
    # In the middle of a stroke its height is a quarter of that at the ends (0.2) and three quarters of its own.
    for at in (0, -1):
        height = 0.25 * 0.2 + 0.75 * marks.thickness[at]
        wanted = 2 * (ribbon.lightest + height * (ribbon.hardest - ribbon.lightest)) * ribbon.opacity / 1000
        assert marks.width[at] == pytest.approx(wanted, rel=0.12)
    # A ribbon is the same at both ends, where it is half as wide at most as far off as it is wide there.
    np.testing.assert_allclose(marks.before, marks.behind, atol=2 * BRUSH_MODEL.frame.pitch[0])
    assert (np.abs(marks.before) < marks.width).all()


def test_a_stroke_that_the_brush_can_paint_stays_where_and_what_it_is():
    freedom = constrain_to_brush(BRUSH_MODEL, SMALL)
    stroke = freedom.project(soft(((0.03, 0.03), (0.055, 0.055), (0.07, 0.045)), 0.003), SMALL)
    plan = as_plan(stroke, BRUSH_MODEL, SMALL, 1, WHITE, seed=0)
    wanted = 1 - render(stroke, WHITE, SMALL)

    def overlap(strokes: Strokes) -> float:
        got = 1 - brush_render(strokes, BRUSH_MODEL, WHITE, SMALL)
        return float((wanted * got).sum() / wanted.square().sum().sqrt() / got.square().sum().sqrt())

    assert overlap(plan.strokes) > 0.85
    assert overlap(plan.strokes.with_groups(bend=-plan.strokes.bend)) < 0.6


def test_what_is_too_large_is_cut_around_its_middle_and_opacity_becomes_colour():
    huge = soft(((0.0, 0.045), (0.06, 0.045), (0.12, 0.045)), 0.03, opacity=0.5)
    plan = as_plan(huge, BRUSH_MODEL, SMALL, 1, WHITE, seed=0)
    middle = plan.strokes.path(torch.tensor([0.5]))[0, 0]
    torch.testing.assert_close(middle, torch.tensor([0.06, 0.045]), atol=1e-5, rtol=0)
    assert float(plan.strokes.length) == pytest.approx(BRUSH_MODEL.limits.within(SMALL).length[1])
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
    plan = as_plan(many, BRUSH_MODEL, SMALL, 4, WHITE, seed=0)
    assert len(plan) == 20 and len(plan.palette) == 4
    chord = many.points[:, 2] - many.points[:, 0]
    torch.testing.assert_close(plan.strokes.angle, torch.atan2(chord[:, 1], chord[:, 0]))


# Planning with them.

PLANNED = CanvasSize(0.13, 0.1)


def target() -> torch.Tensor:
    """A dark disc on a field that goes from yellow to blue."""
    y, x = torch.meshgrid(torch.linspace(-1, 1, 48), torch.linspace(-1.3, 1.3, 62), indexing="ij")
    field = torch.stack((0.5 - 0.3 * x, 0.5 - 0.2 * x, 0.5 + 0.3 * x))
    return torch.where(x * x + y * y < 0.3, torch.tensor([0.2, 0.1, 0.1])[:, None, None], field)


def test_few_strokes_come_near_and_more_come_nearer():
    errors = []
    for count in (2, 16):
        heard: list[float] = []
        colors = 3 if count == 16 else None
        planner = SoftPlanner(
            target=target(), size=PLANNED, freedom=allow_any_stroke(PLANNED), colors=colors, effort=0.15, seed=0,
            notify=heard.append,
        )  # fmt: skip
        strokes, shown = planner.plan(count)
        assert len(strokes) == count and heard == sorted(heard) and heard[-1] == pytest.approx(1)
        assert len(torch.unique(strokes.color, dim=0)) <= (colors or count)
        torch.testing.assert_close(shown, render(strokes, torch.ones(3, 48, 62), PLANNED))
        errors.append(float((shown - target()).square().mean()))
    bare = float((1 - target()).square().mean())
    assert errors[0] < 0.6 * bare and errors[1] < 0.5 * errors[0]


def test_a_half_opaque_black_stroke_on_white_is_seen_grey_and_the_next_sees_it():
    place = torch.tensor([[0.03, 0.05], [0.06, 0.05], [0.1, 0.05]])
    strokes = SoftStrokes(
        place.expand(2, 3, 2), torch.full((2, 2), 0.02), torch.tensor([[0.5, 0.5], [0.5, 0.5]]), torch.zeros(2, 3)
    )
    first, second = seen_colors(strokes, torch.ones(3, 48, 62), PLANNED)[:, 0].tolist()
    assert abs(first - 0.5) < 0.06 and abs(second - 0.25) < 0.06
