"""Directions of the brush marks in a style picture.

The direction is that of least change, from the structure tensor of the lightness (Bigün and Granlund 1987,
"Optimal orientation detection of linear symmetry"). There is no direction if the lightness changes equally in
all directions.
"""

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import images
from frida_painter.frames import PixelGrid
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.style_places import change_by_place, styles_of

_ROWS = 160  # rows of the picture in which directions are measured
_MARK = 1.0  # pixels of that picture: smoothing of its grain
_AROUND = 5.0  # pixels of that picture: window of one direction, about a stroke's width
_CLEAR = 0.5  # coherence above which a direction is certain
_EDGE = 2.0  # times the mean slope: above it the content sets the direction


def directions(picture: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Returns the directions in a picture [3, H, W] at up to 160 rows, three maps [h, w].

    First map: twice the angle from the canvas's x axis, counter-clockwise. Doubled, because opposite angles are
    the same direction.
    Second map: coherence in [0, 1], how much more the lightness changes along one axis than along the other.
    Third map: energy, total change of the lightness.
    """
    rows = min(_ROWS, picture.shape[1])
    small = images.fit(picture, rows, max(1, round(rows * picture.shape[2] / picture.shape[1])))
    light = images.gaussian_blur(small.mean(0, keepdim=True), _MARK)[0]
    padded = functional.pad(light[None, None], (1, 1, 1, 1), mode="replicate")[0, 0]
    right = padded[1:-1, 2:] - padded[1:-1, :-2]
    up = padded[:-2, 1:-1] - padded[2:, 1:-1]
    along, across, both = images.gaussian_blur(torch.stack((right.square(), up.square(), right * up)), _AROUND)
    energy = along + across
    difference = along - across
    coherence = torch.sqrt(difference.square() + 4 * both.square()) / energy.clamp(min=1e-8)
    # The gradient points across a mark. The mark's direction is a quarter turn further, half a turn when doubled.
    doubled = torch.atan2(-2 * both, -difference)
    return doubled, coherence.clamp(0, 1), energy


def flow_of(goal: Goal, grid: PixelGrid) -> Tensor | None:
    """Returns `flow` on a grid for the styles of a goal and the guide of its beginning; None without a style.

    Several styles have their places in the guide. Without a guide of their own, the first one has the canvas.
    """
    styles = [term.brushwork for term in goal.terms if term.brushwork is not None]
    if not styles:
        return None
    guide = next((term.guide for term in goal.initial_terms if term.guide is not None), None)
    if guide is None or any(guide is style for style in styles):
        return flow(styles[0], None, grid.rows, grid.columns)
    colored = styles_of(goal)
    if len(colored) < 2:
        return flow(styles[0], guide, grid.rows, grid.columns)
    return change_by_place(guide, colored, lambda style: flow(style, guide, grid.rows, grid.columns))


def flow(style: Tensor, content: Tensor | None, rows: int, columns: int) -> Tensor:
    """Returns the directions of a style on a canvas, [3, rows, columns]; the content's own directions take precedence.

    style, content [3, H, W]: pictures that fill the canvas. Content None: the style alone sets the composition.
    Returns cosine and sine of twice the angle, and certainty in [0, 1]. The certainty is low at places with
    directions in the content.
    """
    filled = images.fit(style, rows, columns)
    doubled, coherence, _ = directions(filled)
    sure = (coherence / _CLEAR).clamp(max=1)
    if content is not None:
        _, straight, energy = directions(images.fit(content, rows, columns))
        sure = sure * (1 - straight * _clear(energy))
    field = torch.stack((doubled.cos(), doubled.sin(), sure))[None]
    return functional.interpolate(field, (rows, columns), mode="bilinear", align_corners=False)[0]


def clear_edges(picture: Tensor, rows: int, columns: int) -> Tensor:
    """Returns how clear the edges at each place of a picture [3, H, W] are, in [0, 1]: [rows, columns]."""
    _, _, energy = directions(picture)
    return images.fit(_clear(energy)[None], rows, columns)[0]


def _clear(energy: Tensor) -> Tensor:
    return (energy.sqrt() / (_EDGE * energy.sqrt().mean()).clamp(min=1e-4)).clamp(max=1)
