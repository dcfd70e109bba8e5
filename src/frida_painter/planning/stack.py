"""Strokes of several brushes, each brush's laid over those of the one before: their picture, their loss, their worth.

Every part of the strokes has a scene, with its brush, on the canvas of the first.
"""

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from frida_painter.frames import PixelGrid, pixel_to_map
from frida_painter.planning.refine import worth
from frida_painter.planning.scene import Scene
from frida_painter.render import Moments, composite_moments
from frida_painter.strokes import Strokes


def stacked_moments(
    strokes: Sequence[Strokes], scenes: Sequence[Scene], magnitudes: Sequence[Tensor] | None = None
) -> Moments:
    """Mean and variance of the picture [3, H, W] after strokes of several brushes, each laid over what came before.

    scenes: one for each part, with its brush, on the canvas of the first; magnitudes: the maps [n, h, w] of each
    part's strokes, to differentiate in, by default what its stroke model says. What lies below varies as well, and
    shows through as much as the second moment of what the strokes above let through.
    """
    below = scenes[0].canvas
    mean, variance = below, torch.zeros_like(below)
    for number, (part, scene) in enumerate(zip(strokes, scenes, strict=True)):
        if len(part) == 0:
            continue
        model = scene.model
        affine = pixel_to_map(part.position, part.angle, PixelGrid(scene.size, *below.shape[1:]), model.frame)
        magnitude = model(part.thickness, part.length, part.bend) if magnitudes is None else magnitudes[number]
        over = magnitude, affine

        def laid(color: Tensor, canvas: Tensor, over: tuple[Tensor, Tensor] = over, scene: Scene = scene) -> Moments:
            return composite_moments(*over, color, canvas, scene.spread, bare_cells_answer=False)

        above = laid(part.color, mean)
        if number:
            through = laid(torch.zeros_like(part.color), torch.ones_like(mean))
            variance = variance * (through.variance + through.mean.square()) + above.variance
        else:
            variance = above.variance
        mean = above.mean
    return Moments(mean, variance)


def stacked_loss(strokes: Sequence[Strokes], scenes: Sequence[Scene], *, priced: bool = False) -> Tensor:
    """The distance to the goal that paintings of the strokes have on average, by its validation objective if any.

    priced: with what the paint costs.
    """
    judge = scenes[0].validation or scenes[0].objective
    several = len(scenes) > 1
    loss = judge(*stacked_moments(strokes, scenes)) if several else scenes[0].expected_loss(strokes[0], judge)
    if priced:
        loss = loss * (1 + sum(scene.paint_cost(part) for part, scene in zip(strokes, scenes, strict=True)))
    return loss


def stacked_worth(strokes: Sequence[Strokes], scenes: Sequence[Scene], target: Tensor | None, seed: int) -> Tensor:
    """How much each stroke would be missed, [n], as `worth` tells it for one brush."""
    found, below = [], scenes[0].canvas
    for part, scene in zip(strokes, scenes, strict=True):
        on = replace(scene, canvas=below)
        found.append(worth(part, on, target, seed))
        below = on.render(part).detach()
    return torch.cat(found)
