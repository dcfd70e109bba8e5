"""Layers that are settled together: what one of them leaves is what another one makes good.

Each layer is grown as if it were the last one. Then strokes of all layers move and descend towards the picture that all
of them make, so that a broad brush cares for what finer ones cannot do as well.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from frida_painter.frames import PixelGrid
from frida_painter.plan import Plan
from frida_painter.planning.distinct_paints import HARDLY_APART, without_twins
from frida_painter.planning.optimize import Step, StrokesInScene, optimize_together
from frida_painter.planning.refine import MOVED, PROPOSALS, relocate
from frida_painter.planning.scene import Scene
from frida_painter.planning.scenes import Scenes
from frida_painter.planning.variables import Paints, as_palette
from frida_painter.strokes import Strokes

_CLOSED = 0.05  # of a canvas that shows through later layers: what lies below is as good as anything


@dataclass(frozen=True)
class LayerAtWork:
    """A layer that is being planned: its brush, its strokes in painting order, their paints.

    mixes: whether the paints may still change.
    """

    brush: str
    strokes: Strokes
    paints: Paints
    mixes: bool

    def after(self, found: StrokesInScene) -> Self:
        """The layer with what was found of it; paints that are mixed stay as they are, to the last bit."""
        assert found.paints is not None
        paints = found.paints if self.mixes else replace(found.paints, color=self.paints.color)
        return replace(self, strokes=found.strokes, paints=paints)

    def with_paints_in_order(self) -> Self:
        """The layer with its paints lightest first, no two of them nearly the same, and its strokes likewise."""
        strokes, palette, paint = as_palette(self.strokes, without_twins(self.paints, HARDLY_APART))
        return replace(self, strokes=strokes, paints=Paints(palette.color, paint))


def mixed_later(rest: Plan, new_paints: bool, *, fresh: bool) -> list[bool]:
    """Of each layer of the rest of a plan that has strokes: whether paints are mixed for it alone, and were not yet.

    new_paints: whether layers have paints of their own; fresh: whether the layer of the next stroke begins now.
    """
    now, wells = int(rest.layer[0]), [layer.paints for layer in rest.layers]
    return [
        new_paints and (number > now or (fresh and number == now > 0)) and wells.count(layer.paints) == 1
        for number, layer in enumerate(rest.layers)
        if layer.strokes
    ]


def settled_together(
    layers: Sequence[LayerAtWork],
    canvas: Tensor,
    scenes: Scenes,
    coarse: tuple[PixelGrid, int, int],
    fine: tuple[PixelGrid, int],
    begin: Callable[[int], Callable[[Step], None]],
    *,
    pace: float = 1.0,
    share: float = MOVED,
    generator: torch.Generator | None = None,
) -> list[LayerAtWork]:
    """The layers, each painted over the one before on a canvas picture [3, H, W], settled for what they make together.

    coarse: a grid, in how many rounds strokes move to better places on it, and how many iterations follow each; fine:
    another grid, and how many iterations end on it, at `pace`; begin: where so many iterations are to be reported;
    share: of each layer's strokes that may move in a round.
    generator: of the places that are weighed; None: strokes stay about where they are.
    """
    grid, rounds, refining = coarse
    found = list(layers)
    for _ in range(rounds):
        if generator is not None:
            found = _moved(found, canvas, scenes, grid, share, generator)
        found = _descended(found, canvas, scenes, grid, refining, begin)
    last, polishing = fine
    return _descended(found, canvas, scenes, last, polishing, begin, pace)


def _descended(
    layers: Sequence[LayerAtWork],
    canvas: Tensor,
    scenes: Scenes,
    grid: PixelGrid,
    iterations: int,
    begin: Callable[[int], Callable[[Step], None]],
    pace: float = 1.0,
) -> list[LayerAtWork]:
    """The layers after some steps down the slope of what they cost together."""
    found = optimize_together(
        [
            StrokesInScene(layer.strokes, scenes.of(canvas, grid, layer.brush), layer.paints, layer.mixes)
            for layer in layers
        ],
        iterations=iterations,
        pace=pace,
        notify=begin(iterations),
    )
    return [layer.after(part) for layer, part in zip(layers, found, strict=True)]


def _moved(
    layers: Sequence[LayerAtWork],
    canvas: Tensor,
    scenes: Scenes,
    grid: PixelGrid,
    share: float,
    generator: torch.Generator,
) -> list[LayerAtWork]:
    """The layers, of each of which some strokes moved to where they gain more, below the layers that follow."""
    found, below = list(layers), canvas
    for number, layer in enumerate(found):
        scene = scenes.of(below, grid, layer.brush)
        guide = scenes.guide(scene)
        if guide is None:
            return found
        above = [(later.strokes, scenes.of(canvas, grid, later.brush)) for later in found[number + 1 :]]
        seen, wanted = beneath(above, layer.strokes, scene, guide) if above else (scene, guide)
        strokes, paints = relocate(
            layer.strokes, layer.paints, seen, wanted, share=share, proposals=PROPOSALS, generator=generator
        )
        assert paints is not None
        found[number] = replace(layer, strokes=strokes, paints=paints)
        below = scene.render(strokes).detach()
    return found


@torch.no_grad()
def beneath(
    above: Sequence[tuple[Strokes, Scene]], strokes: Strokes, scene: Scene, target: Tensor
) -> tuple[Scene, Tensor]:
    """A layer's scene and target [3, H, W] as they are under other layers, each with a scene of its brush.

    What lies above shows a share t of what is below, and adds a: the picture is t p + a where the layer leaves p. So
    (t p + a - target)^2 is t^2 (p - (target - a) / t)^2: errors count by t^2, from another target. Where hardly
    anything shows through, the layer's own strokes are as they should be.
    """
    added, through = torch.zeros_like(scene.canvas), torch.ones_like(scene.canvas)
    for laid, on in above:
        added, through = (replace(on, canvas=picture).render(laid) for picture in (added, through))
    share = (through - added)[0].clamp(0, 1)  # [H, W]
    wanted = torch.where(share > _CLOSED, (target - added) / share.clamp(min=_CLOSED), scene.render(strokes))
    matters = share.square() if scene.importance is None else share.square() * scene.importance
    return replace(scene, importance=matters), wanted
