"""Wet paint from photographs to the forecast: in the loop with the virtual studio, and with the stub easel."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.table import cached_table
from frida_painter.brush.weights import load_stroke_model
from frida_painter.calibration import WetPaint
from frida_painter.canvas_size import CanvasSize
from frida_painter.planning.effort import Effort
from frida_painter.planning.planner import Planner
from frida_painter.session.events import Event, Planned, Scheduled
from frida_painter.session.hand import Hand
from frida_painter.session.loop import PaintingSession
from frida_painter.session.observer import CanvasObserver
from frida_painter.session.progress import PaintingProgress
from frida_painter.session.replan_policy import EvenlySpaced
from frida_painter.system import images
from frida_painter.virtual.studio import open_studio
from support.planning import as_it_is, plain
from support.session import SessionSetup
from support.small_world import small_world

SIZE = CanvasSize(0.20, 0.16)


def sky(turned: bool) -> Tensor:
    """A soft sky from dark blue to pale orange, [3, 128, 160]; turned, from the left to the right."""
    height, width = torch.meshgrid(torch.linspace(0, 1, 128), torch.linspace(0, 1, 160), indexing="ij")
    down = width if turned else height
    dark, pale = torch.tensor([0.12, 0.18, 0.4]), torch.tensor([0.95, 0.8, 0.6])
    return dark[:, None, None] + (pale - dark)[:, None, None] * down


def paint(turned: bool, wet: WetPaint | None) -> tuple[WetPaint | None, float, float]:
    """Paints the sky in the virtual studio.

    Returns what that taught of wet paint, and the squared differences between the last photograph and the picture
    that the session expected, and the one that is expected of paint that dries at once.
    """
    model = cached_table(load_stroke_model("broad"))
    settings = plain(SIZE, model, rows=96, effort=Effort().scale(0.15), seed=1)
    planner = Planner(as_it_is(sky(turned)), *settings)
    heard: list[Event] = []
    easel = open_studio(SIZE, "broad", seed=1).easel
    easel = replace(easel, calibration=replace(easel.calibration, wet=wet))
    easel.robot.connect()
    easel.camera.connect()
    session = PaintingSession(
        planner, Hand(easel, brush_kind("broad")), CanvasObserver(easel), EvenlySpaced(0),
        notify=heard.append,
    )  # fmt: skip
    painting = session.run(60, 8)
    first = next(event for event in heard if isinstance(event, Planned))
    seen = images.resize_by_area(painting.photograph, *planner.bare.shape[1:])
    expected = first.expected, planner.expected(first.plan)
    ours, dry = (float((picture - seen).square().mean()) for picture in expected)
    return session.learn_wet_paint(), ours, dry


def test_one_painting_teaches_the_expectation_of_another_what_wet_paint_does() -> None:
    with small_world((360, 480)):
        learned, ours, dry = paint(turned=False, wet=None)
        assert learned is not None and ours == pytest.approx(dry, rel=0.05)
        _, ours, dry = paint(turned=True, wet=learned)
    assert ours < 0.6 * dry


def setup_with(wet: WetPaint) -> SessionSetup:
    setup = SessionSetup(6, replans=1)
    for easel in (setup.easel, setup.hand.easel):
        object.__setattr__(easel, "calibration", replace(easel.calibration, wet=wet))
    return setup


def test_each_forecast_is_given_the_times_of_the_strokes_that_are_left() -> None:
    wet = WetPaint(10.0, 0.1, 300.0)
    setup = setup_with(wet)
    setup.run()
    tables = [
        pytest.approx([at for _, at, _ in event.after], abs=0.01)
        for event in setup.heard if isinstance(event, Scheduled)
    ]  # fmt: skip
    assert [each.painted_at for each in setup.planner.wet if each] == tables and len(tables) == 2
    assert all(each is not None and each.paint == wet for each in setup.planner.wet)
    assert [mixed for _, mixed in setup.planner.settled] == [False, True]
    assert [len(each.painted_at) for each, _ in setup.planner.settled] == [len(each.expected) for each in tables]
    (known,) = setup.planner.replanned
    assert known is not None and known.below is not None and len(known.painted_at) == len(tables[1].expected)
    assert len(known.below) == len(known.below_at) == 3 and max(known.below_at) == 0 > min(known.below_at) > -300
    dry = SessionSetup(6, replans=1)
    dry.run()
    assert dry.planner.wet == dry.planner.replanned * 2 == [None, None] and dry.planner.settled == []


def test_paint_of_an_earlier_session_is_dry() -> None:
    setup, canvas = setup_with(WetPaint(10.0, 0.1, 300.0)), torch.ones(3, 48, 64)
    plan = setup.planner.plan(canvas, 6, 1, lambda step: None)
    setup.resume(PaintingProgress.resume(plan, 2, 2, None, canvas))
    (known,) = setup.planner.replanned
    assert known is not None and known.below is not None and len(known.below) == len(known.below_at) == 1
