"""From soft strokes to what a robot can paint with its brush, as nearly as that goes."""

from dataclasses import dataclass
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.experiments.soft_planner import seen_colors
from frida_painter.experiments.soft_strokes import Freedom, SoftStrokes
from frida_painter.frames import CanvasSize
from frida_painter.palette import Palette
from frida_painter.plan import Plan
from frida_painter.strokes import Strokes

_THICKNESSES = 33
# The middle of a quadratic Bezier lies half of its bow aside, that of a brush stroke three quarters of its bend.
_BOW_OF_BEND = 1.5
# A round end is half as wide as the stroke at this share of its radius beyond the curve's end.
_ROUND_END = 3**0.5 / 2


@dataclass(frozen=True)
class MarkSizes:
    """How large the marks of a brush are, by thickness, as a stroke model knows them; all [k], metres.

    thickness: from 0 to 1; width: in the middle of a long straight stroke; before, behind: how far
    the mark reaches beyond the start and the end of the path, to where it is half as wide.
    """

    thickness: NDArray[np.float64]
    width: NDArray[np.float64]
    before: NDArray[np.float64]
    behind: NDArray[np.float64]

    @classmethod
    @torch.no_grad()
    def of(cls, model: StrokeModel) -> Self:
        """Measured on the model's own marks."""
        thickness = torch.linspace(0, 1, _THICKNESSES)
        longest = model.limits.length[1]
        marks = model(thickness, torch.full_like(thickness, longest), torch.zeros_like(thickness))
        across, down = model.frame.pitch
        profile = marks.sum(1).double().numpy() * down  # [k, columns], width along the stroke
        middle = round((longest / 2 - model.frame.left) / across)
        width = profile[:, middle - 1 : middle + 2].mean(1)
        wide = profile >= width[:, None] / 2
        first, last = wide.argmax(1), wide.shape[1] - 1 - wide[:, ::-1].argmax(1)
        return cls(
            thickness.double().numpy(),
            np.maximum.accumulate(width),
            -(model.frame.left + first * across),
            model.frame.left + (last + 1) * across - longest,
        )


def held_to(model: StrokeModel, size: CanvasSize) -> Freedom:
    """Opaque strokes of even width, as long, as wide and as bent as the brush paints them."""
    limits = model.limits.within(size)
    width = MarkSizes.of(model).width
    return Freedom(
        length=limits.length,
        radius=(float(width[0]) / 2, float(width[-1]) / 2),
        bow=(_BOW_OF_BEND * limits.bend[0], _BOW_OF_BEND * limits.bend[1]),
        opacity=(1.0, 1.0),
        tapered=False,
    )


def as_plan(soft: SoftStrokes, model: StrokeModel, size: CanvasSize, colors: int, canvas: Tensor, seed: int) -> Plan:
    """The robot's plan that comes nearest to soft strokes: as many strokes, in the same order, in `colors` paints.

    The radius becomes the thickness whose mark is as wide; the path is as long, and lies so, that
    the mark with its ends covers what the stroke with its round ends covers. Lengths and bends are
    cut to what the brush can do, around the middle. Opacity is mixed into the colour: a stroke is
    painted in the colour that its place has once it is laid on `canvas` [3, H, W] and the strokes
    before it. The colours are then clustered, weighed by the area of their strokes.
    """
    limits = model.limits.within(size)
    start, control, end = soft.points.unbind(1)
    middle, chord = (start + end) / 2, end - start
    angle = torch.atan2(chord[:, 1], chord[:, 0])
    along = torch.stack((torch.cos(angle), torch.sin(angle)), 1)  # [n, 2]
    off = control - middle
    bend = ((along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0]) / _BOW_OF_BEND).clamp(*limits.bend)
    marks, radius = MarkSizes.of(model), soft.radius.mean(1)
    thickness = np.interp(2 * radius.numpy(), marks.width, marks.thickness)
    before, behind = (
        torch.from_numpy(np.interp(thickness, marks.thickness, reach)).to(radius)
        for reach in (marks.before, marks.behind)
    )
    covered = chord.norm(dim=1) + 2 * _ROUND_END * radius
    length = (covered - before - behind).clamp(*limits.length)
    middle = middle + along * (before - behind)[:, None] / 2
    color = seen_colors(soft, canvas, size)
    palette = Palette.cluster(color, length * radius, colors, seed)
    paint = palette.nearest(color)
    strokes = Strokes(
        middle - along * length[:, None] / 2,
        angle,
        length,
        bend,
        torch.from_numpy(thickness).to(radius),
        palette.color[paint],
    ).project(limits, size)
    return Plan.of(strokes, palette, paint, canvas=size, brush=model.brush, limits=limits)
