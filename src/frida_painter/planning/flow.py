"""Strokes that go the way of a style's brushwork: its directions, its curves, and no longer than it runs straight."""

import math

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.canvas_size import CanvasSize
from frida_painter.strokes import StrokeLimits, Strokes

_WAVERS = 0.15  # radians, standard deviation of strokes about the flow
_TURN = math.pi / 3  # of the flow from one end of a stroke to the other, for which a stroke has half the length


def along_flow(
    strokes: Strokes, flow: Tensor, limits: StrokeLimits, size: CanvasSize, generator: torch.Generator
) -> Strokes:
    """Strokes about whose directions chance has decided, turned into the flow about their middles.

    flow [3, H, W]: cosine and sine of twice the direction and how sure it is; a stroke is turned with that probability,
    forwards or backwards. It bends as the flow turns between its ends, and is the shorter the more that is.
    """
    middle = strokes.path(strokes.angle.new_tensor([0.5]))[:, 0]
    doubled, sure = _seen(flow, middle, size)
    count = len(strokes)
    chance = torch.rand(2, count, generator=generator).to(sure)
    wavers = _WAVERS * torch.randn(count, generator=generator).to(sure)
    turned = chance[0] < sure
    angle = torch.where(turned, doubled / 2 + math.pi * (chance[1] < 0.5) + wavers, strokes.angle)
    along = torch.stack((angle.cos(), angle.sin()), -1)
    half = along * strokes.length[:, None] / 2
    ends = [_seen(flow, middle + step, size)[0] for step in (-half, half)]
    turn = torch.remainder((ends[1] - ends[0]) + math.pi, 2 * math.pi) / 2 - math.pi / 2  # of a direction: a quarter
    length = torch.where(turned, strokes.length / (1 + turn.abs() / _TURN), strokes.length)
    # A stroke's path heads by 3 b / l to one side at its start, and as much to the other at its end.
    bend = torch.where(turned, -turn * length / 6, strokes.bend)
    across = torch.stack((-angle.sin(), angle.cos()), -1)
    start = middle - along * length[:, None] / 2 - across * (0.75 * bend)[:, None]
    return strokes.with_groups(position=start, angle=angle, length=length, bend=bend).project(limits, size)


def _seen(flow: Tensor, place: Tensor, size: CanvasSize) -> tuple[Tensor, Tensor]:
    """Twice the direction of the flow and how sure it is, [n] each, at canvas places [n, 2]."""
    at = torch.stack((2 * place[:, 0] / size.width - 1, 1 - 2 * place[:, 1] / size.height), -1)
    cosine, sine, sure = functional.grid_sample(
        flow[None], at[None, None].to(flow), align_corners=False, padding_mode="border"
    )[0, :, 0]
    return torch.atan2(sine, cosine), sure
