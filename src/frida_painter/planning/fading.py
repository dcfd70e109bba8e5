"""What it costs that a brush runs dry: how much worse a painting gets where a stroke lacks a share of its paint."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from frida_painter.frames import PixelGrid
from frida_painter.plan import Plan
from frida_painter.planning.memory import is_lack_of_memory
from frida_painter.planning.refine import loss_of_paint, visible_area
from frida_painter.planning.scene import Scene
from frida_painter.planning.scenes import Scenes
from frida_painter.planning.together import beneath
from frida_painter.strokes import Strokes


@dataclass(frozen=True)
class Fading:
    """Of n strokes what it costs that one lacks a share f of its paint: f slope + f^2 square, [n] and [n].

    In shares of what the whole plan's painting has of squared error. The slope may be below 0: there is too much paint.
    """

    slope: Tensor
    square: Tensor

    @property
    def without_paint(self) -> Tensor:
        """How much each stroke would be missed, [n]: what it costs that it lacks all of its paint."""
        return self.slope + self.square

    @classmethod
    def none(cls, strokes: int) -> Self:
        """That of strokes of which it does not matter."""
        return cls(torch.zeros(strokes), torch.zeros(strokes))

    def of(self, strokes: Sequence[int]) -> Self:
        """That of some strokes, by their numbers."""
        return replace(self, slope=self.slope[strokes], square=self.square[strokes])


def fading_of(plan: Plan, canvas: Tensor, scenes: Scenes, grid: PixelGrid, seed: int) -> Fading:
    """That of a plan's strokes on a canvas picture [3, H, W], as it is seen under the strokes that follow.

    Towards the picture that guides the plan; where there is none, a stroke counts by the area in which it is seen.
    Where there is not memory enough to tell, it does not matter.
    """
    parts, on = scenes.stack(plan, canvas, grid)
    guide = scenes.guide(on[0])
    try:
        return _seen(parts, on) if guide is None else _towards(guide, parts, on, seed)
    except (MemoryError, RuntimeError) as failure:
        if not is_lack_of_memory(failure):
            raise
        return Fading.none(len(plan))


def _seen(parts: Sequence[Strokes], on: Sequence[Scene]) -> Fading:
    areas = torch.cat([visible_area(part, scene) for part, scene in zip(parts, on, strict=True)]).clamp(min=0).cpu()
    return Fading(torch.zeros_like(areas), areas / areas.sum().clamp(min=1))


def _towards(guide: Tensor, parts: Sequence[Strokes], on: Sequence[Scene], seed: int) -> Fading:
    laid = list(zip(parts, on, strict=True))
    found, below = [], on[0].canvas
    for number, (part, scene) in enumerate(laid):
        here, above = replace(scene, canvas=below), laid[number + 1 :]
        seen, wanted = beneath(above, part, here, guide) if above else (here, guide)
        found.append(loss_of_paint(part, seen, wanted, torch.Generator().manual_seed(seed)))
        with torch.no_grad():
            below = here.render(part)
    matters = 1.0 if on[0].importance is None else on[0].importance
    whole = float((matters * (below - guide).square()).sum())
    slope, square = (torch.cat(each).cpu() / max(whole, 1e-9) for each in zip(*found, strict=True))
    return Fading(slope, square)
