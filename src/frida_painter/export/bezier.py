"""What other programs need of a stroke: the control points of its path, and one width that stands for its mark."""

import math
from collections.abc import Mapping

import torch
from torch import Tensor

from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.plan import Plan
from frida_painter.strokes import Strokes

_AT_A_TIME = 64
_THINNEST = 0.0001


def control_points(strokes: Strokes) -> Tensor:
    """The four control points of each stroke's cubic Bezier, canvas metres, [n, 4, 2]."""
    along = strokes.length[:, None] * torch.arange(4, dtype=strokes.length.dtype, device=strokes.length.device) / 3
    aside = strokes.bend[:, None] * strokes.bend.new_tensor([0.0, 1.0, 1.0, 0.0])
    cos, sin = torch.cos(strokes.angle)[:, None], torch.sin(strokes.angle)[:, None]
    x = strokes.position[:, 0:1] + cos * along - sin * aside
    y = strokes.position[:, 1:2] + sin * along + cos * aside
    return torch.stack((x, y), -1)


def plan_widths(plan: Plan, models: Mapping[str, StrokeModel]) -> Tensor:
    """The width [n] in metres of each stroke of a plan, as `mark_widths` has it; models: of its brushes, by name."""
    widths = [mark_widths(part.strokes, models[part.layers[0].brush]) for part in plan.filled_layers()]
    return torch.cat(widths) if widths else torch.zeros(0)


@torch.no_grad()
def mark_widths(strokes: Strokes, model: StrokeModel) -> Tensor:
    """The width [n] in metres of round-ended lines that cover as much canvas as the strokes' marks.

    A line of length l and width w with round ends covers l w + pi/4 w^2; what a mark covers is the
    sum of its magnitude map. Solved for w, and at least a tenth of a millimetre.
    """
    across, along = model.frame.pitch
    area = [
        model(part.thickness, part.length, part.bend).sum((1, 2)) * across * along
        for part in (strokes[start : start + _AT_A_TIME] for start in range(0, len(strokes), _AT_A_TIME))
    ]
    covered = torch.cat(area) if area else strokes.length
    path = strokes.path(torch.linspace(0, 1, 33, dtype=strokes.length.dtype, device=strokes.length.device))
    length = (path[:, 1:] - path[:, :-1]).norm(dim=-1).sum(-1)
    width = (torch.sqrt(length.square() + math.pi * covered) - length) * 2 / math.pi
    return width.clamp(min=_THINNEST)
