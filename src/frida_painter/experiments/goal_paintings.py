"""Paintings of goals that networks judge: planned, and painted by the virtual robot without looking in between."""

import time
from dataclasses import dataclass

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.experiments.execution import execute, open_easel
from frida_painter.experiments.outcome import Notify, Progress
from frida_painter.frames import CanvasSize
from frida_painter.goal import Goal
from frida_painter.objectives.encoders.shelf import Encoders
from frida_painter.planning.optimize import Step
from frida_painter.planning.planner import Effort, Planner

CANVAS = CanvasSize(14 * 0.0254, 11 * 0.0254)
_PLANNING = 0.9  # share of the time that a painting takes
_PHOTOGRAPH_ROWS = 512


@dataclass(frozen=True)
class Scale:
    """strokes and paints of every plan, rows in which is planned, and how long is planned."""

    strokes: int
    colors: int
    rows: int
    effort: float


FULL = Scale(strokes=100, colors=12, rows=256, effort=0.3)
QUICK = Scale(strokes=6, colors=3, rows=48, effort=0.03)


@dataclass(frozen=True)
class Painted:
    """The plan as a picture and the photograph of the canvas, [3, rows, columns], and the CPU seconds of planning."""

    planned: Tensor
    photograph: Tensor
    seconds: float


def paint(
    goal: Goal,
    size: CanvasSize,
    model: StrokeModel,
    encoders: Encoders,
    scale: Scale,
    seed: int,
    notify: Notify,
    words: str,
) -> Painted:
    """Plans the goal and has the virtual robot paint it; it stands as far off as the seed says.

    words: what `notify` says is being done. Raises WeightsError where a network is missing.
    """
    started = time.process_time()
    planner = Planner(
        goal, size, model, rows=scale.rows, effort=Effort().scaled(scale.effort), seed=seed, encoders=encoders
    )
    bare = torch.ones(3, planner.fine.rows, planner.fine.columns)

    def hear(step: Step) -> None:
        notify(Progress(_PLANNING * step.iteration / step.of, f"{words}: planning"))

    plan = planner.plan(bare, scale.strokes, scale.colors, hear)
    seconds = time.process_time() - started
    notify(Progress(_PLANNING, f"{words}: painting"))
    photograph = execute(plan, open_easel(size, model.brush, seed), _PHOTOGRAPH_ROWS)
    grid = planner.fine
    return Painted(planner.expected(plan, bare), images.fit(photograph, grid.rows, grid.columns), seconds)
