"""How much of each paint a plan takes, so that nobody runs out half-way."""

import torch
from torch import Tensor

from frida_painter.brush.kinds import brush_kind
from frida_painter.plan import Plan

_FILM = 0.15e-3  # metres of wet paint under a brush
_KEPT_BACK = 2.0  # as much again stays in the brush, the water and the wells
_LEAST = 3.0  # millilitres in which a brush can be dipped at all
_ML = 1e6  # in a cubic metre


def volumes(plan: Plan) -> Tensor:
    """Millilitres to mix of each paint of the plan's palette, [k], by the area that its strokes paint.

    Raises ConfigError where a brush of the plan is not known.
    """
    areas = [brush_kind(part.layers[0].brush).area(part.strokes).double() for part in plan.filled_layers()]
    area = torch.cat(areas) if areas else torch.zeros(0).double()  # [n] m2
    painted = plan.paint.bincount(area, minlength=len(plan.palette))  # [k] m2
    return (painted * _FILM * _KEPT_BACK * _ML).clamp(min=_LEAST)
