"""Strokes in colours of their own: grown where the canvas needs them, then moved to where they gain most."""

from collections.abc import Callable

import torch
from torch import Tensor

from frida_painter.planning.effort import Effort
from frida_painter.planning.initialize import descended, progressive
from frida_painter.planning.optimize import Step, optimize
from frida_painter.planning.refine import MOVED, PROPOSALS, relocate
from frida_painter.planning.scene import Scene
from frida_painter.strokes import Strokes


def free_strokes(
    count: int,
    scene: Scene,
    guide: Tensor | None,
    effort: Effort,
    generator: torch.Generator,
    begin: Callable[[int], Callable[[Step], None]],
) -> Strokes:
    """So many strokes, from light to dark, in a scene.

    guide [3, H, W]: says where strokes are needed; None: only the objective does, and then strokes do not move far: a
    picture that is only one of many good ones must not pull them back to it. begin: where so many iterations are to be
    reported.
    """
    found, _ = progressive(
        count,
        scene,
        descended(scene) if guide is None else guide,
        paints=None,
        light_to_dark=True,
        growth=effort.growth,
        generator=generator,
        notify=begin(effort.growing(count)),
    )
    for _ in range(effort.relocations):
        if guide is not None:
            found, _ = relocate(found, None, scene, guide, share=MOVED, proposals=PROPOSALS, generator=generator)
        found, _ = optimize(found, scene, iterations=effort.refining, notify=begin(effort.refining))
    return found
