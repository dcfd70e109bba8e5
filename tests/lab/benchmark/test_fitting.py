import itertools
import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from frida_painter.brush.weights import load_stroke_model
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import HandInError
from frida_painter.render import render
from frida_painter.report.vector import plan_widths
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter_lab.benchmark.fitting import PathPiece, _bounds, _schedule, find_brushes, fit_hand_in
from frida_painter_lab.benchmark.hand_in import DrawnStroke, HandIn
from frida_painter_lab.benchmark.suite import Budget

CANVAS = CanvasSize(0.28, 0.21)
BUDGET = Budget(100, 12, 60.0, 100)
RED = (0.7, 0.1, 0.1)


@pytest.fixture(scope="module")
def models():
    return {name: load_stroke_model(name) for name in ("fine", "medium", "broad")}


def line(*points, width=0.008, color=RED, opacity=1.0) -> DrawnStroke:
    return DrawnStroke(np.array(points, float), width, color, opacity)


def fit(*strokes, budget=BUDGET, models=None):
    return fit_hand_in(HandIn(CANVAS, strokes), budget, 0, models)


def picture(plan: Plan, models) -> torch.Tensor:
    shown = torch.ones(3, 210, 280)
    for kind, strokes in plan.by_kind():
        shown = render(strokes, models[kind], shown, plan.canvas)
    return shown


def test_an_exported_plan_comes_back_as_the_same_marks(models):
    """The oracle: paths and widths of strokes of ours, as the project exports them, drawn anew by the fit."""
    model, random = models["medium"], torch.Generator().manual_seed(1)
    limits = model.limits.within(CANVAS)
    from frida_painter.planning.initialize import uniform

    strokes = uniform(12, limits, CANVAS, random)
    strokes = strokes.with_groups(thickness=0.3 + 0.5 * strokes.thickness, bend=strokes.bend / 3)
    palette = Palette.sort_light_to_dark(torch.tensor([[0.7, 0.2, 0.1], [0.1, 0.2, 0.5]]))
    plan = Plan.of(
        strokes.project(limits, CANVAS), palette, torch.arange(12) % 2, canvas=CANVAS, brush="medium", limits=limits
    )
    paths, widths = plan.strokes.path(torch.linspace(0, 1, 16)).numpy().astype(float), plan_widths(plan, models)
    drawn = [
        line(*path, width=width, color=tuple(color))
        for path, width, color in zip(paths, widths.tolist(), plan.strokes.color.tolist(), strict=True)
    ]
    again, _ = fit(*drawn, models=models)
    before, after = picture(plan, models), picture(again, models)
    bare = float((before - 1).square().mean())
    assert 12 <= len(again) <= 14, "a few are as long as a stroke can be"
    assert float((before - after).square().mean()) < 0.2 * bare


@pytest.mark.parametrize("degrees", [0, 35, 140, 270])
def test_the_mark_covers_the_line(models, degrees):
    middle, half = (
        np.array([0.14, 0.105]),
        0.02 * np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))]),
    )
    plan, remarks = fit(line(middle - half, middle + half, width=0.009), models=models)
    assert len(plan) == 1 and remarks == ()
    shown = 1 - picture(plan, models).mean(0)
    rows, columns = torch.meshgrid(torch.arange(210.0), torch.arange(280.0), indexing="ij")
    weight = shown / shown.sum()
    x, y = float((weight * columns).sum()) + 0.5, 210 - float((weight * rows).sum()) - 0.5
    assert math.hypot(x - 140, y - 105) < 1.5, "mark and line have one middle, mm"
    area = float(shown.sum()) / float(shown.max())
    assert area == pytest.approx(40 * 9 + math.pi / 4 * 81, rel=0.25)


def test_a_long_path_is_split_and_a_curve_is_followed(models):
    straight, remarks = fit(line((0.02, 0.1), (0.26, 0.1)), models=models)
    assert 4 <= len(straight) <= 6 and remarks == (f"1 stroke became {len(straight)} brush strokes.",)
    angle = np.linspace(0, 1.5 * np.pi, 40)
    circle = np.stack((0.14 + 0.06 * np.cos(angle), 0.105 + 0.06 * np.sin(angle)), -1)
    round_, _ = fit(line(*circle), models=models)
    path = round_.strokes.path(torch.linspace(0, 1, 9)).reshape(-1, 2)
    radius = (path - torch.tensor([0.14, 0.105])).norm(dim=1)
    assert float((radius - 0.06).abs().max()) < 0.004


def test_wide_strokes_are_painted_in_lanes_and_thin_ones_by_the_thinnest_mark(models):
    wide, remarks = fit(line((0.1, 0.1), (0.15, 0.1), width=0.06), models=models)
    y = wide.strokes.position[:, 1].sort().values
    assert len({round(float(place), 3) for place in y}) == 3 and "lanes" in " ".join(remarks)
    assert float(y[-1] - y[0]) == pytest.approx(0.06 - find_brushes(CANVAS, models)["broad"].sizes.width[-1], abs=0.003)
    drawing = HandIn(CANVAS, (line((0.1, 0.1), (0.13, 0.1), width=0.0005),), remarks=("Cut.",))
    thin, remarks = fit_hand_in(drawing, BUDGET, 0, models)
    assert (
        len(thin) == 1
        and remarks[0] == "Cut."
        and float(thin.strokes.thickness[0]) == 0.0
        and "thinner" in " ".join(remarks)
    )


def test_the_budget_keeps_the_first_strokes_and_few_paints(models):
    random = np.random.default_rng(0)
    strokes = [
        line(at, at + 0.02, color=tuple(random.uniform(size=3))) for at in random.uniform(0.02, 0.15, size=(30, 2))
    ]
    plan, remarks = fit(*strokes, budget=Budget(10, 4, 60.0, 100), models=models)
    assert len(plan) == 10 and len(plan.palette) <= 4
    said = " ".join(remarks)
    assert "used up by 10 of 30 strokes" in said and "10 colours became 4 paints" in said
    kept = plan.strokes.position
    wanted = torch.tensor(np.array([stroke.points[0] for stroke in strokes[:10]])).float()
    assert float(torch.cdist(wanted, kept).min(1).values.max()) < 0.01


def test_a_dot_and_nothing(models):
    plan, _ = fit(line((0.1, 0.1)), models=models)
    assert len(plan) == 1
    with pytest.raises(HandInError):
        fit(models=models)


def test_a_plan_of_too_many_paints_is_refused(models):
    plan, _ = fit(line((0.1, 0.1), (0.12, 0.1)), line((0.2, 0.1), (0.22, 0.1), color=(0.1, 0.1, 0.6)), models=models)
    again, remarks = fit_hand_in(HandIn(CANVAS, plan=plan), BUDGET, 0)
    assert again is plan and remarks == ()
    with pytest.raises(HandInError, match="2 paints, and the budget is 1"):
        fit_hand_in(HandIn(CANVAS, plan=plan), Budget(100, 1, 60.0, 100), 0)
    cut, remarks = fit_hand_in(HandIn(CANVAS, plan=plan), Budget(1, 12, 60.0, 100), 0)
    assert len(cut) == 1 and "first of 2" in remarks[0]


pieces = st.lists(
    st.tuples(st.floats(0, 0.2), st.floats(0, 0.2), st.integers(0, 2), st.sampled_from(["fine", "broad"])),
    min_size=1, max_size=12,
)  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(pieces)
def test_strokes_that_touch_keep_their_order(given_pieces):
    made = [
        PathPiece(n, brush, 0.02, np.array([x, y]), 0.0, 0.03, 0.0, 0.5)
        for n, (x, y, _, brush) in enumerate(given_pieces)
    ]
    paint = torch.tensor([paint for _, _, paint, _ in given_pieces])
    order, runs = _schedule(made, paint)
    assert sorted(order) == list(range(len(made))) and sum(count for _, count in runs) == len(made)
    place = {index: number for number, index in enumerate(order)}
    boxes = [_bounds(piece) for piece in made]
    for later in range(len(made)):
        for earlier in range(later):
            one, other = boxes[earlier], boxes[later]
            touch = bool((one[:2] <= other[2:]).all() and (other[:2] <= one[2:]).all())
            alike = int(paint[earlier]) == int(paint[later]) and made[earlier].brush == made[later].brush
            if touch and not alike:
                assert place[earlier] < place[later]
    changes = sum(made[a].brush != made[b].brush for a, b in itertools.pairwise(order))
    assert changes == len(runs) - 1
