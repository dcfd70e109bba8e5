"""Strokes of several brushes, each brush's laid over those of the one before: their picture and their loss.

Every part of the strokes has a scene, with its brush, on the canvas of the first.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from frida_painter.objectives.objective import Objective
from frida_painter.planning.scene import Scene
from frida_painter.render import Marks, Moments, composite_moments
from frida_painter.strokes import Strokes


def stacked_moments(
    strokes: Sequence[Strokes], scenes: Sequence[Scene], marks: Sequence[Marks] | None = None
) -> Moments:
    """Mean [3, H, W] and variance [H, W] of the picture after strokes of several brushes, each over the one before.

    scenes: one for each part, with its brush, on the canvas of the first; marks: those of each part's strokes, to
    differentiate in, by default what its stroke model says.
    """
    mean = scenes[0].rows.of(scenes[0].canvas)
    variance = torch.zeros_like(mean[0])
    for number, (part, scene) in enumerate(zip(strokes, scenes, strict=True)):
        if len(part) == 0:
            continue
        laid = scene.marks(part) if marks is None else marks[number]
        mean, variance = composite_moments(*laid, part.color, mean, scene.spread, variance, bare_cells_answer=False)
    return Moments(mean, variance)


def stacked_loss(strokes: Sequence[Strokes], scenes: Sequence[Scene], objective: Objective | None = None) -> Tensor:
    """What the objective (default: that of the first scene) says on average of paintings of the strokes."""
    if len(scenes) == 1:
        return scenes[0].expected_loss(strokes[0], objective)
    return (objective or scenes[0].objective)(*stacked_moments(strokes, scenes))


def stacked_cost(strokes: Sequence[Strokes], scenes: Sequence[Scene], objective: Objective | None = None) -> Tensor:
    """That, and what the paint costs: every dip takes time, and paint that is hardly seen wins little.

    The price is a share of the loss, for a decibel is worth as much in a dark picture as in a light one.
    """
    loss = stacked_loss(strokes, scenes, objective)
    if all(scene.paint_price == 0 for scene in scenes):
        return loss
    return loss * (1 + sum(scene.paint_cost(part) for part, scene in zip(strokes, scenes, strict=True)))
