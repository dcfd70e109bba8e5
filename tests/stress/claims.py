"""Claims about many paintings, which hold in the mean: one painting is luck, and each processor rounds to another one.

    make stress PROGRAM=claims

Each claim is a test of pytest; the words after the program's name go to pytest.
"""

import sys
from dataclasses import replace
from functools import cache

import pytest
import torch
from skimage import data

from frida_painter import images
from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.table import StrokeTable, cached_table
from frida_painter.brush.weights import load_stroke_model
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import lead
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.planning.effort import Effort
from frida_painter.planning.planner import Planner
from frida_painter.procedures.color import color
from frida_painter.session.hand import Hand
from frida_painter.session.loop import PaintingSession
from frida_painter.session.observer import CanvasObserver
from frida_painter.session.replan_policy import EvenlySpaced
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.studio import StudioSettings, open_studio
from frida_painter.virtual.tabletop import PlacementError
from support.planning import plain

CANVAS = CanvasSize(0.20, 0.16)
# Bands that leak into each other ten times as much as those of the usual studio's camera.
CAMERA = CameraSpec(bleed=0.2)
EXACT = PlacementError((0.0, 0.0), 0.0)


@cache
def medium() -> StrokeTable:
    return cached_table(load_stroke_model("medium"))


def error(seed: int, *, calibrated: bool) -> float:
    """The cup of coffee in 120 strokes and four looks: how far the canvas as it really is is from it, squared."""
    target = torch.from_numpy(data.coffee().copy()).permute(2, 0, 1).float() / 255
    effort = Effort().scale(0.2)
    planner = Planner(Goal((ImageTerm(target),)), plain(CANVAS, medium(), rows=128, effort=effort, seed=seed))
    settings = StudioSettings(camera=CAMERA, placement_error=EXACT)
    studio = open_studio(CANVAS, "medium", seed=seed, settings=settings)
    easel = studio.easel
    easel.robot.connect()
    easel.camera.connect()
    if calibrated:
        finding = lead(color(easel), lambda question: question.proposal)
        easel = replace(easel, calibration=finding.enter(easel.calibration))
    session = PaintingSession(
        planner,
        Hand(easel, brush_kind("medium")),
        CanvasObserver(easel),
        EvenlySpaced(4),
        stop_asked=lambda: False,
        notify=lambda event: None,
    )
    session.run(120, 8)
    grid = planner.fine
    truth = images.fit(studio.truth(grid.rows), grid.rows, grid.columns)
    return float((truth - images.fit(target, grid.rows, grid.columns)).square().mean())


@pytest.mark.timeout(7200)
def test_a_painter_that_sees_true_colours_paints_nearer_to_its_goal() -> None:
    """Measured with seeds 0 to 3: 0.95, 0.75, 0.77 and 0.75 of the error; with the first two on an Intel Xeon, 0.91.

    With the usual camera, whose bands hardly leak, both paint alike (0.93 to 1.08): the light on the
    bare canvas has told nearly all there is to know.
    """
    calibrated, not_calibrated = ([error(seed, calibrated=known) for seed in range(5)] for known in (True, False))
    print(*(f"{one / other:.3f}" for one, other in zip(calibrated, not_calibrated, strict=True)))
    assert sum(calibrated) < 0.9 * sum(not_calibrated)


if __name__ == "__main__":
    sys.exit(pytest.main([__file__, *sys.argv[1:]]))
