"""Strokes in the brushwork of a style: they have its sizes, follow its directions and curves, and end where it turns.

The brushwork of a canvas is [6, H, W], from `objectives.style_flow.brushwork_of`.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.brush.kinds import StrokeModel, mark_width
from frida_painter.canvas_size import CanvasSize
from frida_painter.strokes.strokes import Strokes

_WAVERS = 0.15  # radians, standard deviation of proposed strokes about the direction
_VARIES = 0.2  # standard deviation of the logarithm of their length
_TURN = math.pi / 3  # turn of the direction between the ends of a stroke that halves its length
_THINNEST = 0.25  # width of the lightest mark, relative to the widest, as in `painted_area`
_ALONG = (0.15, 0.5, 0.85)  # points of a path at which its direction is compared
_WEIGHTS = 1.0, 0.5, 0.5  # of direction, length and width
_PRICE = 0.35  # share of the loss that a stroke's mean departure of 1 costs


class _Marks(NamedTuple):
    """Wanted marks at some places, [n] each; lengths and widths in metres."""

    doubled: Tensor
    sure: Tensor
    length: Tensor
    width: Tensor
    held: Tensor


def _marks_at(brushwork: Tensor, place: Tensor, size: CanvasSize) -> _Marks:
    """Returns the wanted marks at canvas positions [n, 2]."""
    at = torch.stack((2 * place[:, 0] / size.width - 1, 1 - 2 * place[:, 1] / size.height), -1).detach()
    cosine, sine, sure, length, width, held = functional.grid_sample(
        brushwork[None], at[None, None].to(brushwork), align_corners=False, padding_mode="border"
    )[0, :, 0]
    return _Marks(torch.atan2(sine, cosine), sure, length.exp(), width.exp(), held)


def along_brushwork(
    strokes: Strokes, brushwork: Tensor, model: StrokeModel, size: CanvasSize, generator: torch.Generator
) -> Strokes:
    """Gives strokes of random shape the sizes and directions of the brushwork about their middles.

    A stroke is turned with the certainty of the direction, and sized with the probability that it is held. It then
    points forwards or backwards, bends as the direction turns between its ends, and a stronger turn makes it shorter.
    Strokes of a family are only turned.
    """
    limits, count = model.limits.within(size), len(strokes)
    half = strokes.angle.new_tensor([0.5])
    middle = strokes.path(half)[:, 0]
    wanted = _marks_at(brushwork, middle, size)
    chance = torch.rand(3, count, generator=generator).to(middle)
    noise = torch.randn(2, count, generator=generator).to(middle)
    turned, sized = chance[0] < wanted.sure, chance[2] < wanted.held
    angle = wanted.doubled / 2 + math.pi * (chance[1] < 0.5) + _WAVERS * noise[0]
    angle = torch.where(turned, angle, strokes.angle)
    if strokes.taught is not None:
        found = strokes.with_groups(angle=angle)
        at = strokes.position + middle - found.path(half)[:, 0]
        return found.with_groups(position=at).project(limits, size)
    length = torch.where(sized, wanted.length * torch.exp(_VARIES * noise[1]), strokes.length)
    length = length.clamp(*limits.length)
    press = ((wanted.width / mark_width(model) - _THINNEST) / (1 - _THINNEST)).clamp(0, 1)
    along = torch.stack((angle.cos(), angle.sin()), -1)
    first, last = (_marks_at(brushwork, middle + way * along * length[:, None] / 2, size).doubled for way in (-1, 1))
    turn = torch.remainder(last - first + math.pi, 2 * math.pi) / 2 - math.pi / 2  # of a direction, not of its double
    length = torch.where(turned, length / (1 + turn.abs() / _TURN), length)
    # The heading of a path differs from its chord by 3 b / l at the start, and by as much to the other side at the
    # end. A stroke that is sized and has no direction is straight.
    bend = torch.where(turned, -turn * length / 6, torch.where(sized, 0, strokes.bend))
    across = torch.stack((-angle.sin(), angle.cos()), -1)
    return strokes.with_groups(
        position=middle - along * length[:, None] / 2 - across * (0.75 * bend)[:, None],
        angle=angle, length=length, bend=bend, thickness=torch.where(sized, press, strokes.thickness),
    ).project(limits, size)  # fmt: skip


def brushwork_cost(strokes: Strokes, brushwork: Tensor, model: StrokeModel, size: CanvasSize) -> Tensor:
    """Returns how far strokes depart from the brushwork about them, as a share of the loss; differentiable.

    Directions count by their certainty; sizes by their squared logarithms, within what the brush can paint.
    """
    if strokes.taught is not None or not len(strokes):
        return strokes.length.new_zeros(())
    limits = model.limits.within(size)
    along = strokes.length.new_tensor(_ALONG)
    marks = [_marks_at(brushwork, at, size) for at in strokes.path(along).unbind(1)]
    turned = torch.stack([
        wanted.sure * (1 - torch.cos(2 * (strokes.angle + 3 * (1 - 2 * share) * strokes.bend / strokes.length)
                                     - wanted.doubled))
        for share, wanted in zip(_ALONG, marks, strict=True)
    ]).mean(0)  # fmt: skip
    _, wanted, _ = marks
    widest = mark_width(model)
    width = widest * (_THINNEST + (1 - _THINNEST) * strokes.thickness)
    longer = torch.log(strokes.length / wanted.length.clamp(*limits.length))
    wider = torch.log(width / wanted.width.clamp(_THINNEST * widest, widest))
    parts = torch.stack((turned, wanted.held * longer.square(), wanted.held * wider.square())).mean(1)
    return _PRICE * (parts * parts.new_tensor(_WEIGHTS)).sum()
