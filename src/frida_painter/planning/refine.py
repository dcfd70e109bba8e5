"""Between rounds of gradient descent: strokes that hardly matter move, and colours become paints."""

from dataclasses import replace

import torch
from torch import Tensor

from frida_painter.palette import Palette
from frida_painter.planning.distinct_paints import HARDLY_APART, distinct
from frida_painter.planning.initialize import best_proposals, insert
from frida_painter.planning.scene import Scene
from frida_painter.planning.variables import Paints
from frida_painter.render import composite
from frida_painter.strokes import Strokes

MOVED = 0.15
"""Share of the strokes that may move at a time."""
MOVED_WHERE_A_LAYER_BEGINS = 0.5
"""The same where nothing of a layer was painted, and the canvas may be another than it was planned for."""
PROPOSALS = 24
"""Weighed for each stroke that moves."""
_PROBES = 8
_WORTHWHILE = 1.5  # a gain is foreseen on a coarse picture, and neighbours may want the same place


def loss_without(strokes: Strokes, scene: Scene, target: Tensor, generator: torch.Generator) -> Tensor:
    """How much the summed squared error to target [3, H, W] rises when one stroke is left out, for each, [n]."""
    slope, square = loss_of_paint(strokes, scene, target, generator)
    return slope + square


def loss_of_paint(strokes: Strokes, scene: Scene, target: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """What it costs that a stroke lacks a share f of its paint: f slope + f^2 square, for each stroke, [n] and [n].

    That is by how much the summed squared error to target [3, H, W] rises. Errors count by the scene's importance w,
    where it has one: r and D_i below are then those times its root.

    The picture is linear in the opacity of a single stroke: leaving out stroke i takes D_i from
    it, and the error rises by 2 r.D_i + |D_i|^2 with r = target - picture. r.D_i is a derivative;
    |D_i|^2 is the mean of (z.D_i)^2 over random signs z (Hutchinson's estimator), a derivative too.
    """
    with torch.no_grad():
        magnitude, affine = scene.marks(strokes)
    magnitude.requires_grad_()
    picture = composite(magnitude, affine, strokes.color, scene.canvas, bare_cells_answer=False)

    def along(direction: Tensor) -> Tensor:
        """direction . D_i for every stroke."""
        (slope,) = torch.autograd.grad(picture, magnitude, direction, retain_graph=True)
        return (slope * magnitude).sum((1, 2)).detach()

    matters = torch.ones_like(target[0]) if scene.importance is None else scene.importance
    signs = [torch.randint(0, 2, picture.shape, generator=generator).to(picture) * 2 - 1 for _ in range(_PROBES)]
    squared = torch.stack([along(sign * matters.sqrt()).square() for sign in signs]).mean(0)
    return 2 * along((matters * (target - picture)).detach()), squared


def visible_area(strokes: Strokes, scene: Scene) -> Tensor:
    """How much of the picture each stroke's colour makes up, in pixels, [n]."""
    color = strokes.color.detach().clone().requires_grad_()
    picture = scene.render(strokes.with_groups(color=color))
    (share,) = torch.autograd.grad(picture, color, torch.ones_like(picture))
    return share[:, 0]


def anneal_to_palette(strokes: Strokes, scene: Scene, colors: int, keeping: float, seed: int) -> Strokes:
    """The strokes, still in colours of their own, but nearer to `colors` paints: `keeping` of the way is left.

    Done again and again with gradient descent in between, shapes and colours grow used to the
    paints, and lose less when at last they get them.
    """
    palette, paint = _cluster(strokes, scene, colors, seed)
    nearest = palette.color[paint]
    return strokes.with_groups(color=nearest + keeping * (strokes.color - nearest))


def discretize(strokes: Strokes, scene: Scene, colors: int, seed: int) -> tuple[Strokes, Paints]:
    """The strokes in at most `colors` paints, light to dark (paper, "Paint Colors and Mixing")."""
    palette, paint = _cluster(strokes, scene, colors, seed)
    order = torch.argsort(paint, stable=True)
    return strokes[order].with_groups(color=palette.color[paint[order]]), Paints(palette.color, paint[order])


def _cluster(strokes: Strokes, scene: Scene, colors: int, seed: int) -> tuple[Palette, Tensor]:
    """Paints for the strokes' colours that differ, and which one is nearest to each stroke's, [n].

    A colour counts by the fourth root of the area in which it is seen: by the area alone, small
    accents would drown.
    """
    weight = visible_area(strokes, scene).clamp(min=0).pow(0.25)
    palette = distinct(Palette.cluster(strokes.color, weight, colors, seed), strokes.color, weight, HARDLY_APART)
    return palette, torch.cdist(strokes.color, palette.color).argmin(1)


def relocate(
    strokes: Strokes,
    paints: Paints | None,
    scene: Scene,
    target: Tensor,
    *,
    share: float,
    light_to_dark: bool = True,
    proposals: int,
    generator: torch.Generator,
) -> tuple[Strokes, Paints | None]:
    """The same number of strokes, in painting order, of which up to a `share` has moved to better places.

    The strokes that matter least make room for the proposals that gain most, pair by pair, as long
    as the one gains clearly more than the other loses.
    """
    most = round(share * len(strokes))
    if most == 0:
        return strokes, paints
    loss = loss_without(strokes, scene, target, generator)
    found = best_proposals(
        strokes, paints, most, scene, target, proposals, light_to_dark=light_to_dark, generator=generator
    )
    weakest = torch.argsort(loss)[: len(found.strokes)]
    count = int((found.gain > _WORTHWHILE * loss[weakest].clamp(min=0)).sum())
    stays = torch.ones(len(strokes), dtype=torch.bool, device=loss.device)
    stays[weakest[:count]] = False
    if paints is not None:
        paints = replace(paints, paint=paints.paint[stays])
    return insert(strokes[stays], paints, found.first(count), light_to_dark=light_to_dark)
