"""The cup of coffee, painted in the closed loop of the virtual studio, and how near it comes."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import torch
from torch import Tensor

from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.table import cached_table
from frida_painter.brush.weights import load_stroke_model
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import lead
from frida_painter.hardware.faults import PlacementError
from frida_painter.planning.effort import Effort
from frida_painter.planning.placement import Placement
from frida_painter.planning.planner import Planner
from frida_painter.session.events import Event, Planned
from frida_painter.session.hand import Hand
from frida_painter.session.loop import PaintingSession
from frida_painter.session.observer import CanvasObserver
from frida_painter.session.progress import Painting
from frida_painter.session.replan_policy import EvenlySpaced
from frida_painter.system import images
from frida_painter.virtual.studio import StudioSettings, VirtualStudio, open_studio
from frida_painter_calibration.procedures.color import color
from support import data
from support.planning import as_it_is, plain

CANVAS = CanvasSize(0.20, 0.16)
# 4 millimetres to the upper right, and 2 degrees.
OFF = PlacementError((0.004 * math.cos(1), 0.004 * math.sin(1)), math.radians(2))


@cache
def coffee() -> Tensor:
    return torch.from_numpy(data.coffee().copy()).permute(2, 0, 1).float() / 255


def paint_coffee(
    seed: int,
    replans: int,
    *,
    settings: StudioSettings | None = None,
    strokes: int = 80,
    effort: float = 0.2,
    brush: str = "broad",
    learns_touch: bool = True,
    calibrated: bool = False,
    notify: Callable[[Event], None] = lambda event: None,
) -> tuple[Painting, VirtualStudio, Planner]:
    """Paints it with a robot that stands off, or in a studio of other settings.

    calibrated: whether the camera's colours are
    """
    model = cached_table(load_stroke_model(brush))
    planner = Planner(as_it_is(coffee()), *plain(CANVAS, model, rows=128, effort=Effort().scale(effort), seed=seed))
    studio = open_studio(CANVAS, brush, seed=seed, settings=settings or StudioSettings(placement_error=OFF))
    easel = studio.easel
    easel.robot.connect()
    easel.camera.connect()
    if calibrated:
        finding = lead(color(easel), lambda question: question.proposal)
        easel = replace(easel, calibration=finding.enter(easel.calibration))
    session = PaintingSession(
        planner,
        Hand(easel, brush_kind(brush), Placement.unknown(easel.calibration.depths if learns_touch else None)),
        CanvasObserver(easel),
        EvenlySpaced(replans),
        notify=notify,
    )
    return session.run(strokes, 8), studio, planner


def error(studio: VirtualStudio, planner: Planner) -> float:
    """How far the canvas, as it really is, is from the goal: mean squared difference at the plan's resolution."""
    grid = planner.fine
    truth = images.fit(studio.truth(grid.rows), grid.rows, grid.columns)
    return float((truth - images.fit(coffee(), grid.rows, grid.columns)).square().mean())


def error_with_looks(seed: int, replans: int = 4, **how: Any) -> float:
    """The error after some looks, of that after none: the same plan, by a robot that stands 4 mm and 2 degrees off."""
    first: list[list[list[float]]] = []

    def hear(event: Event) -> None:
        if isinstance(event, Planned) and event.done == 0:
            first.append(sorted(event.plan.strokes.position.tolist()))  # each batch has an order of its own

    blind, looking = (error(*paint_coffee(seed, looks, notify=hear, **how)[1:]) for looks in (0, replans))
    assert first[0] == first[1], "both begin with the same plan"
    return looking / blind
