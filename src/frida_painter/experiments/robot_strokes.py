"""From soft strokes to what a robot can paint with its brush, as nearly as that goes."""

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


def held_to(model: StrokeModel, size: CanvasSize) -> Freedom:
    """Opaque strokes of even width, as long, as wide and as bent as the brush paints them."""
    limits = model.limits.within(size)
    _, width = mark_widths(model)
    return Freedom(
        length=limits.length,
        radius=(float(width[0]) / 2, float(width[-1]) / 2),
        bow=(_BOW_OF_BEND * limits.bend[0], _BOW_OF_BEND * limits.bend[1]),
        opacity=(1.0, 1.0),
        tapered=False,
    )


@torch.no_grad()
def mark_widths(model: StrokeModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Thicknesses from 0 to 1, and how wide a mark of each is in the middle of a long straight stroke, metres."""
    thickness = torch.linspace(0, 1, _THICKNESSES)
    length = torch.full_like(thickness, model.limits.length[1])
    marks = model(thickness, length, torch.zeros_like(thickness))  # [k, rows, columns]
    across, down = model.frame.pitch
    middle = round((model.limits.length[1] / 2 - model.frame.left) / across)
    width = marks[:, :, middle - 1 : middle + 2].mean(2).sum(1).double().numpy() * down
    return thickness.double().numpy(), np.maximum.accumulate(width)


def as_plan(soft: SoftStrokes, model: StrokeModel, size: CanvasSize, colors: int, canvas: Tensor, seed: int) -> Plan:
    """The robot's plan that comes nearest to soft strokes: as many strokes, in the same order, in `colors` paints.

    Lengths and bends are cut to what the brush can do, around the middle of the stroke; the radius
    becomes the thickness whose mark is as wide. Opacity is mixed into the colour: a stroke is
    painted in the colour that its place has once it is laid on `canvas` [3, H, W] and the strokes
    before it. The colours are then clustered, weighed by the area of their strokes.
    """
    limits = model.limits.within(size)
    start, control, end = soft.points.unbind(1)
    middle, chord = (start + end) / 2, end - start
    angle = torch.atan2(chord[:, 1], chord[:, 0])
    cos, sin = torch.cos(angle), torch.sin(angle)
    length = chord.norm(dim=1).clamp(*limits.length)
    off = control - middle
    bend = ((cos * off[:, 1] - sin * off[:, 0]) / _BOW_OF_BEND).clamp(*limits.bend)
    thicknesses, width = mark_widths(model)
    thickness = torch.from_numpy(np.interp(2 * soft.radius.mean(1).numpy(), width, thicknesses)).to(length)
    color = seen_colors(soft, canvas, size)
    palette = Palette.cluster(color, length * soft.radius.mean(1), colors, seed)
    paint = palette.nearest(color)
    position = middle - torch.stack((cos, sin), 1) * length[:, None] / 2
    strokes = Strokes(position, angle, length, bend, thickness, palette.color[paint]).project(limits, size)
    return Plan.of(strokes, palette, paint, canvas=size, brush=model.brush, limits=limits)
