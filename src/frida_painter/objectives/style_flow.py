"""Which way the brush went in a picture: the field of directions that a style's marks leave.

Directions are those of least change, from the structure tensor of the lightness (Bigün and Granlund 1987, "Optimal
orientation detection of linear symmetry"); where light and dark change alike in all directions there is none.
"""

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import images
from frida_painter.frames import PixelGrid
from frida_painter.objectives.objective import Goal

_ROWS = 160  # of the pictures in which directions are seen
_MARK = 1.0  # pixels of those, over which the grain of a picture is smoothed
_AROUND = 5.0  # pixels of those, over which a direction is asked for: about a stroke's width
_CLEAR = 0.5  # coherence from which a direction is sure
_EDGE = 2.0  # times the mean slope, from which the content has an opinion


def directions(picture: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The directions of a picture [3, H, W]: twice the angle from the canvas's x, counter-clockwise, [h, w]; how much
    lightness changes one way rather than the other, [h, w] in [0, 1]; how much it changes at all, [h, w].

    h is 160 rows at the most. An angle and the opposite one are the same direction, hence twice.
    """
    rows = min(_ROWS, picture.shape[1])
    small = images.fit(picture, rows, max(1, round(rows * picture.shape[2] / picture.shape[1])))
    light = images.blurred(small.mean(0, keepdim=True), _MARK)[0]
    padded = functional.pad(light[None, None], (1, 1, 1, 1), mode="replicate")[0, 0]
    right = padded[1:-1, 2:] - padded[1:-1, :-2]
    up = padded[:-2, 1:-1] - padded[2:, 1:-1]
    along, across, both = images.blurred(torch.stack((right.square(), up.square(), right * up)), _AROUND)
    energy = along + across
    difference = along - across
    coherence = torch.sqrt(difference.square() + 4 * both.square()) / energy.clamp(min=1e-8)
    # The gradient points across a mark: the mark's own direction is a quarter turn further, half a turn when doubled.
    doubled = torch.atan2(-2 * both, -difference)
    return doubled, coherence.clamp(0, 1), energy


def flow_of(goal: Goal, grid: PixelGrid) -> Tensor | None:
    """The `flow` on a grid of a goal's first style beside what a plan begins with; None without a style."""
    style = next((term.brushwork for term in goal.terms if term.brushwork is not None), None)
    if style is None:
        return None
    guide = next((term.guide for term in goal.initial_terms if term.guide is not None), None)
    return flow(style, None if guide is style else guide, grid.rows, grid.columns)


def flow(style: Tensor, content: Tensor | None, rows: int, columns: int) -> Tensor:
    """The directions of a style's brushwork on a canvas where the content has none of its own, [3, rows, columns].

    style, content [3, H, W]: both as they fill the canvas; None: nothing but the style says what is where. Cosine and
    sine of twice the direction, and how sure it is, in [0, 1].
    """
    filled = images.fit(style, rows, columns)
    doubled, coherence, _ = directions(filled)
    sure = (coherence / _CLEAR).clamp(max=1)
    if content is not None:
        _, straight, energy = directions(images.fit(content, rows, columns))
        opinion = straight * (energy.sqrt() / (_EDGE * energy.sqrt().mean()).clamp(min=1e-4)).clamp(max=1)
        sure = sure * (1 - opinion)
    field = torch.stack((doubled.cos(), doubled.sin(), sure))[None]
    return functional.interpolate(field, (rows, columns), mode="bilinear", align_corners=False)[0]
