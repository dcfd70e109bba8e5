"""Layers that are settled together: what one of them leaves is what another one makes good.

Each layer is grown as if it were the last one. Then strokes of all layers move and descend towards the picture that all
of them make, so that a broad brush cares for what finer ones cannot do as well.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import torch
from torch import Tensor

from frida_painter.frames import PixelGrid
from frida_painter.plan import Plan
from frida_painter.planning.initialize import Growth, descended, progressive
from frida_painter.planning.optimize import Step, StrokesInScene, optimize, optimize_together
from frida_painter.planning.problem import Scene, Scenes
from frida_painter.planning.refine import HARDLY_APART, MOVED, PROPOSALS, binding_iterations, relocate, without_twins
from frida_painter.planning.variables import Paints, as_palette
from frida_painter.strokes import Strokes

# Steps of planning as they are told: one count through all the optimisations that make a plan.


class StepCount:
    """Adds the iterations of several optimisations up to one count."""

    def __init__(self, notify: Callable[[Step], None], total: int) -> None:
        self._notify = notify
        self._total = total
        self._done = 0

    def begin(self, iterations: int, below: Sequence[tuple[str, Strokes]] = ()) -> Callable[[Step], None]:
        """Where the next `iterations` steps are to be reported; below: each brush and its strokes that lie below."""
        before = self._done
        self._done += iterations

        def tell(step: Step) -> None:
            number = before + step.iteration
            self._notify(replace(step, iteration=number, of=self._total, laid=(*below, *step.laid)))

        return tell


def unheard(step: Step) -> None:
    """Where nobody listens."""


def at_the_end(notify: Callable[[Step], None]) -> Callable[[Step], None]:
    """Where the steps of a second try are to be reported: nobody knew before that there is one."""
    return lambda step: notify(replace(step, iteration=step.of))


# How much work a plan is worth.

_WHERE_A_LAYER_BEGINS = 3


@dataclass(frozen=True)
class Effort:
    """How many iterations are spent on what.

    growth: on the start; refining: joint steps after each of `relocations` rounds in which weak
    strokes move; drawing: steps after each round in which colours are drawn towards the paints;
    binding: steps once they are paints; rounds: in which strokes of several layers move to better places;
    settling: joint steps after each of them, and after each look; before_settling: which part of the effort each
    layer is grown with before that; polishing: last steps at full resolution; replanning: the same after
    each look. docs/lab/planning.md has the measurements.
    """

    growth: Growth = field(default_factory=Growth)
    relocations: int = 3
    refining: int = 25
    drawing: int = 20
    binding: int = 40
    rounds: int = 5
    settling: int = 40
    before_settling: float = 0.3
    polishing: int = 80
    replanning: int = 40

    def scaled(self, factor: float) -> "Effort":
        """The same effort with `factor` times as many iterations."""
        growth = Growth(self.growth.rounds, math.ceil(self.growth.settling * factor), self.growth.proposals)
        names = "refining", "drawing", "binding", "settling", "polishing", "replanning"
        counts = {name: math.ceil(getattr(self, name) * factor) for name in names}
        return replace(self, growth=growth, **counts)

    def judged_by_networks(self) -> "Effort":
        """The same for goals that networks judge: what they see is grown, and settled in fewer rounds."""
        return replace(self, rounds=min(self.rounds, 3), settling=self.refining, before_settling=0.6)

    def growing_of(self, layers: int) -> "Effort":
        """What each of so many layers is grown with: less where they are settled together afterwards."""
        return self if layers == 1 else self.scaled(self.before_settling)

    def growing(self, strokes: int) -> int:
        """Iterations while so many strokes grow."""
        return min(self.growth.rounds, strokes) * self.growth.settling

    def rounds_of(self, layers: int) -> int:
        """Rounds in which so many layers of a plan are settled together."""
        return self.rounds if layers > 1 else 0

    def planning(self, sizes: Sequence[int], *, new_paints: bool) -> int:
        """Iterations of a plan of layers of so many strokes, of which later ones have paints of their own or not."""
        effort = self.growing_of(len(sizes))
        mixing = binding_iterations(effort.drawing, effort.binding)
        later = mixing if new_paints else effort.binding
        settled = self.rounds_of(len(sizes)) * self.settling + self.polishing
        return sum(map(effort.free_iterations, sizes)) + mixing + later * (len(sizes) - 1) + settled

    def rounds_of_a_look(self, asked: int, *, fresh: bool) -> int:
        """Rounds in which the rest is planned again where so many are asked for; fresh: whether a layer begins."""
        return max(asked, min(_WHERE_A_LAYER_BEGINS, self.rounds)) if fresh else asked

    @property
    def of_a_look(self) -> int:
        """Iterations in which the rest is planned again, where nothing else is said."""
        return self.settling + self.replanning

    def free_iterations(self, strokes: int) -> int:
        """Iterations until so many strokes are where they are to be, in colours of their own."""
        return self.growing(strokes) + self.relocations * self.refining


# Strokes in colours of their own: grown where the canvas needs them, then moved to where they gain most.


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
