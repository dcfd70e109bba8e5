"""A plan as a picture of any size."""

from collections.abc import Mapping

import torch
from torch import Tensor

from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.brush.weights import load_stroke_models
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.plan import Plan
from frida_painter.render.painting import render

LEAST_ROWS, MOST_ROWS = 16, 10_000


def render_on(plan: Plan, models: Mapping[str, StrokeModel], canvas: Tensor) -> Tensor:
    """The picture [3, H, W] that a plan leaves on a canvas of its size which now looks like `canvas` [3, H, W].

    models: what the marks of its brushes look like, by their names.
    """
    with torch.no_grad():
        for part in plan.filled_layers():
            canvas = render(part.strokes, models[part.layers[0].brush], canvas, plan.canvas)
    return canvas


def render_plan(plan: Plan, height: int = 1080, models: Mapping[str, StrokeModel] | None = None) -> Tensor:
    """The picture [3, height, W] that a plan paints on its bare canvas, as the simulation of its brushes sees it.

    models: what their marks look like, by their names; by default the models that they have. Raises ConfigError unless
    height is from 16 to 10000 pixels, and WeightsError where a brush of the plan has no model here.
    """
    if not LEAST_ROWS <= height <= MOST_ROWS:
        raise ConfigError(f"A picture {height} pixels high was asked for; it is from {LEAST_ROWS} to {MOST_ROWS} high.")
    grid = PixelGrid.of_height(plan.canvas, height)
    ground = torch.tensor(plan.ground)[:, None, None].expand(3, grid.rows, grid.columns).contiguous()
    return render_on(plan, models or load_stroke_models(plan.brushes), ground)
