"""Strokes that hardly matter are taken away and placed where they gain more."""

from dataclasses import replace

import torch
from torch import Tensor

from frida_painter.frames import PixelGrid, pixel_to_map
from frida_painter.planning.initialize import place
from frida_painter.planning.scene import Scene
from frida_painter.planning.variables import Paints
from frida_painter.render import composite
from frida_painter.strokes import Strokes

_PROBES = 8


def loss_without(strokes: Strokes, scene: Scene, target: Tensor, generator: torch.Generator) -> Tensor:
    """How much the summed squared error to target [3, H, W] rises when one stroke is left out, for each, [n].

    The picture is linear in the opacity of a single stroke: leaving out stroke i takes D_i from
    it, and the error rises by 2 r.D_i + |D_i|^2 with r = target - picture. r.D_i is a derivative;
    |D_i|^2 is the mean of (z.D_i)^2 over random signs z (Hutchinson's estimator), a derivative too.
    """
    with torch.no_grad():
        magnitude = scene.model(strokes.thickness, strokes.length, strokes.bend)
        affine = pixel_to_map(
            strokes.position, strokes.angle, PixelGrid(scene.size, *scene.canvas.shape[1:]), scene.model.frame
        )
    magnitude.requires_grad_()
    picture = composite(magnitude, affine, strokes.color, scene.canvas)

    def along(direction: Tensor) -> Tensor:
        """direction . D_i for every stroke."""
        (slope,) = torch.autograd.grad(picture, magnitude, direction, retain_graph=True)
        return (slope * magnitude).sum((1, 2)).detach()

    signs = [torch.randint(0, 2, picture.shape, generator=generator).to(picture) * 2 - 1 for _ in range(_PROBES)]
    squared = torch.stack([along(sign).square() for sign in signs]).mean(0)
    return 2 * along((target - picture).detach()) + squared


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
    """The same number of strokes, with the `share` that matters least placed anew, in painting order."""
    count = round(share * len(strokes))
    if count == 0:
        return strokes, paints
    keep = torch.argsort(loss_without(strokes, scene, target, generator))[count:].sort().values
    if paints is not None:
        paints = replace(paints, paint=paints.paint[keep])
    return place(
        strokes[keep], paints, count, scene, target, proposals, light_to_dark=light_to_dark, generator=generator
    )
