"""What a plan would look like if every stroke left a real mark and nothing else went wrong.

Each stroke is painted alone by the virtual studio, in black with a full brush, on a fresh canvas that lies where the
robot believes it to be. What it covers is then composited in the colours of the plan, as a renderer does it.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from frida_painter import images
from frida_painter.brush.dip import Dip
from frida_painter.brush.kinds import brush_kind
from frida_painter.experiments.execution import EXACT, connected
from frida_painter.palette import Palette
from frida_painter.plan import Plan
from frida_painter.session.brushwork import Brushwork
from frida_painter.session.easel_kinds.studio import studio_brush
from frida_painter.session.events import StrokePainted
from frida_painter.virtual.paint import absorption_and_scattering, to_srgb
from frida_painter.virtual.studio import StudioSettings, open_studio
from frida_painter.virtual.table import HandNoise

_BLACK = torch.zeros(1, 3)


def with_real_marks(plan: Plan, canvas: Tensor, seed: int, tell: Callable[[float], None]) -> Tensor:
    """The picture [3, H, W] of a canvas after the plan, with real marks. tell: hears the share that is done."""
    picture, rows, columns = canvas, *canvas.shape[1:]
    for number, coverage in enumerate(_marks(plan, rows, seed)):
        opacity = images.fit(coverage, rows, columns)
        picture = picture + opacity * (plan.strokes.color[number][:, None, None] - picture)
        tell((number + 1) / len(plan))
    return picture


def _marks(plan: Plan, rows: int, seed: int) -> Iterator[Tensor]:
    """How much of each pixel every stroke covers, [1, rows, columns] in [0, 1]."""
    for part in plan.filled_layers():
        yield from _marks_of_layer(part, rows, seed)


def _marks_of_layer(plan: Plan, rows: int, seed: int) -> Iterator[Tensor]:
    layer = plan.layers[0]
    settings = StudioSettings(placement_error=EXACT, noise=HandNoise(0.0, 0.0))
    studio = connected(open_studio(plan.canvas, studio_brush(layer.brush), seed=seed, settings=settings))
    full = replace(brush_kind(layer.brush), known_dip=Dip.of_strokes(1))
    hand = Brushwork(studio.easel, full)
    paint = torch.zeros_like(plan.paint)
    black = Plan.of(plan.strokes, Palette(_BLACK), paint, canvas=plan.canvas, brush=layer.brush, limits=layer.limits)
    studio.easel.operator.fill_wells(black.palette)
    darkest, bare = _seen(_BLACK), studio.truth(rows)
    for action in hand.prepare(black, 0, len(black)):
        if isinstance(hand.perform(action), StrokePainted):
            yield ((bare - studio.truth(rows)) / (bare - darkest)).clamp(0, 1).mean(0, keepdim=True)
            studio.easel.operator.lay_paper()
            bare = studio.truth(rows)


def _seen(color: Tensor) -> float:
    """How dark a thick film of that paint [1, 3] is, sRGB: the studio has no paint that reflects nothing."""
    absorption, _, _, scattering, _, _ = absorption_and_scattering(color.numpy())[0]
    ratio = absorption / scattering
    return float(to_srgb(1 + ratio - np.sqrt(ratio**2 + 2 * ratio)))
