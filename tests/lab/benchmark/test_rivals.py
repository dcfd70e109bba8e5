from types import SimpleNamespace
from typing import cast

import cv2
import numpy as np
import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.planning.planner import Planner
from frida_painter.planning.settings import PlannerSettings
from frida_painter.runs.run import PaintingRun
from frida_painter.system import images
from frida_painter_lab.benchmark import rivals
from frida_painter_lab.benchmark.suite import Budget

CANVAS = CanvasSize(0.12, 0.09)
BUDGET = Budget(12, 3, 60.0, 100)


def run_of(planner: Planner) -> PaintingRun:
    spec = SimpleNamespace(canvas=planner.size, seed=planner.seed)
    return cast(PaintingRun, SimpleNamespace(planner=planner, spec=spec))


def two_halves() -> torch.Tensor:
    """Dark blue at the left, light ochre at the right."""
    picture = torch.empty(3, 60, 80)
    picture[:, :, :40] = torch.tensor([0.15, 0.2, 0.45])[:, None, None]
    picture[:, :, 40:] = torch.tensor([0.85, 0.7, 0.4])[:, None, None]
    return picture


def planner_of(*brushes: str) -> Planner:
    goal = Goal((ImageTerm(two_halves()),)).fit_to(64, 85)
    return Planner(
        goal,
        PlannerSettings.of(
            canvas=CANVAS, brushes=brushes, strokes=12, colors=3, render_height=64, focus="none", seed=3
        ),
    )


def error_of(planner: Planner, plan) -> float:
    shown = planner.expected(plan, torch.ones(3, 64, 85))
    return float((shown - images.fit(two_halves(), 64, 85)).square().mean())


BARE = float((torch.ones(3, 64, 85) - images.fit(two_halves(), 64, 85)).square().mean())


def test_the_plain_algorithm_comes_near_in_few_paints(monkeypatch):
    monkeypatch.setattr(rivals, "_ITERATIONS", 60)
    planner = planner_of("medium")
    plan = rivals.plan_plain(run_of(planner), two_halves(), BUDGET)
    assert len(plan) == 12 and len(plan.palette) <= 3 and len(plan.layers) == 1
    lightness = plan.palette.lab()[plan.paint, 0]
    assert bool((lightness[1:] <= lightness[:-1] + 1e-4).all()), "from light to dark"
    assert error_of(planner, plan) < 0.75 * BARE
    assert rivals.plan_plain(run_of(planner), two_halves(), BUDGET).digest == plan.digest


def test_the_greedy_painter_uses_each_brush_and_comes_near():
    planner = planner_of("broad", "medium", "fine")
    plan = rivals.plan_greedy(run_of(planner), two_halves(), BUDGET)
    assert len(plan) == 12 and len(plan.palette) <= 3
    assert {layer.brush for layer in plan.layers} == {"broad", "medium", "fine"}
    assert error_of(planner, plan) < 0.32 * BARE


def test_hertzmann_paints_along_edges_in_the_colours_of_the_picture():
    pixels = 255 * two_halves().permute(1, 2, 0).double().numpy().repeat(3, 0).repeat(3, 1)
    strokes = rivals.paint_hertzmann(pixels, 100, CANVAS, 0)
    assert strokes and len({stroke.width for stroke in strokes}) <= 3
    again = rivals.paint_hertzmann(pixels, 100, CANVAS, 0)
    assert all(np.array_equal(a.points, b.points) for a, b in zip(strokes, again, strict=True))
    for stroke in strokes:
        x = stroke.points[0, 0]
        if abs(x - 0.06) > 0.02:
            wanted = (0.15, 0.2, 0.45) if x < 0.06 else (0.85, 0.7, 0.4)
            assert np.allclose(stroke.color, wanted, atol=0.05)
        assert ((stroke.points >= 0) & (stroke.points <= (0.12, 0.09))).all()
    longest = max(strokes, key=lambda one: float(np.abs(np.diff(one.points, axis=0)).sum()))
    steps = np.abs(np.diff(longest.points, axis=0)).sum(0)
    assert steps[1] > 2 * steps[0], "the only edge is upright"


def test_hertzmann_follows_round_edges_and_does_not_turn_back():
    y, x = np.mgrid[:270, :360] + 0.5
    disc = 255 * np.repeat(np.where(np.hypot(x - 180, y - 135) < 90, 0.2, 0.8)[..., None], 3, 2)
    strokes = rivals.paint_hertzmann(disc, 50, CANVAS, 0)
    assert len(strokes) > len(rivals.paint_hertzmann(disc, 150, CANVAS, 0))
    assert {stroke.width for stroke in strokes} == {0.024, 0.012, 0.006}
    assert 5 < max(len(stroke.points) for stroke in strokes) <= 17
    for stroke in strokes:
        steps, outwards = np.diff(stroke.points, axis=0), stroke.points[:-1] - (0.06, 0.045)
        at_edge = abs(np.hypot(*outwards.T) - 0.03) < 0.25 * stroke.width
        aslant = abs((steps * outwards).sum(1)) / np.hypot(*steps.T) / np.hypot(*outwards.T)
        assert (aslant[at_edge] < 0.35).all()
    clouds = 255 * cv2.GaussianBlur(np.random.default_rng(0).random((270, 360, 3)), (0, 0), 6)
    for stroke in rivals.paint_hertzmann(clouds, 50, CANVAS, 0):
        steps = np.diff(stroke.points, axis=0)
        assert ((steps[1:] * steps[:-1]).sum(1) >= -1e-9).all()


def test_hertzmann_keeps_the_budget():
    run = run_of(planner_of("medium"))
    plan = rivals.plan_hertzmann(run, two_halves(), BUDGET)
    assert 1 <= len(plan) <= 12 and len(plan.palette) <= 3
    more = rivals.plan_hertzmann(run, two_halves(), Budget(200, 3, 60.0, 100))
    assert 150 < len(more) <= 200
