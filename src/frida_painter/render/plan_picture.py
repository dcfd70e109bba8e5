"""A plan as a picture of any size."""

import torch
from torch import Tensor

from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.brush.weights import load_stroke_model
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.plan import Plan
from frida_painter.render.painting import render

LEAST_ROWS, MOST_ROWS = 16, 10_000


def render_plan(plan: Plan, height: int = 1080, model: StrokeModel | None = None) -> Tensor:
    """The picture [3, height, W] that a plan paints on its bare canvas, as the simulation of its brush sees it.

    model: what the marks look like; by default the model of the plan's brush. Raises ConfigError unless height is
    from 16 to 10000 pixels, and WeightsError where the plan's brush has no model here.
    """
    if not LEAST_ROWS <= height <= MOST_ROWS:
        raise ConfigError(f"A picture {height} pixels high was asked for; it is from {LEAST_ROWS} to {MOST_ROWS} high.")
    grid = PixelGrid.of_height(plan.canvas, height)
    ground = torch.tensor(plan.ground)[:, None, None].expand(3, grid.rows, grid.columns).contiguous()
    with torch.no_grad():
        return render(plan.strokes, model or load_stroke_model(plan.brush), ground, plan.canvas)
