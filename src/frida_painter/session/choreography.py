"""What the hand does in which order: dips, rinses, wipes and strokes as motions, before anything moves.

Nothing in here knows a robot. Whoever wants to know what painting a plan takes, in motions, in
time or in paint, asks here; `brushwork` performs it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

import torch

from frida_painter.brush.kinds import BrushKind, brush_kind
from frida_painter.errors import ConfigError
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Waypoints
from frida_painter.palette import to_lab
from frida_painter.plan import Plan
from frida_painter.session.events import Dipped, StrokePainted

_WASHINGS = 2  # rinse and wipe, so often; what one leaves is seen in a lighter paint alone


@dataclass(frozen=True)
class BrushLoad:
    """What is on the brush: paint from which well, None on a clean one, and how much is left of its dip."""

    paint: int | None = None
    left: float = 0.0


@dataclass(frozen=True)
class Action:
    """One thing to do with the brush: motions that belong together, what to tell then, and what is on it then."""

    motions: tuple[Waypoints, ...]
    done: Dipped | StrokePainted
    load: BrushLoad


@dataclass(frozen=True)
class Choreography:
    """Sets plans for a brush: refills it before it runs out, and cleans it where the colour changes.

    What is left on the brush is reckoned by the area that it has painted since it was dipped, or by its
    strokes where that is all that is known (paper, "Robot Setup Details"). others: for layers of other brushes, by
    their names.
    """

    motion: Motion
    brush: BrushKind
    others: "Mapping[str, Choreography]" = field(default_factory=dict)

    @classmethod
    def of(cls, motion: Motion, brushes: Sequence[str]) -> Self:
        """For several brushes that move alike, and strokes in any order.

        Raises ConfigError where one of them is not known.
        """
        first, *others = (brush_kind(name).for_any_order for name in brushes)
        return cls(motion, first, {kind.name: cls(motion, kind) for kind in others})

    def with_brush(self, name: str) -> "Choreography":
        """With the brush of that name. Raises ConfigError where there are several, and it is none of them."""
        if self.others and name not in (self.brush.name, *self.others):
            raise ConfigError(
                f"A layer is for the brush {name!r}; here are {self.brush.name}, {', '.join(self.others)}."
            )
        return self.others.get(name, self)

    def actions(self, plan: Plan, load: BrushLoad, already_done: int, of: int) -> Iterator[Action]:
        """All that painting the plan takes with a brush that holds `load`, in order; each further layer begins clean.

        Its strokes are numbered from `already_done` + 1, `of` so many. Raises WorkspaceViolation
        where the workspace has no well for a paint.
        """
        for part in plan.filled_layers():
            yield from self.with_brush(part.layers[0].brush)._layer(part, load, already_done, of)
            load, already_done = BrushLoad(), already_done + len(part)

    def loads(self, layer: Plan, load: BrushLoad) -> list[tuple[bool, BrushLoad]]:
        """Of every stroke of a layer whether the brush, which holds `load` at first, is dipped before it, and what is
        on it afterwards."""
        found = []
        used = self.brush.dip.used_by(self.brush.area(layer.strokes.detach().to(torch.float64))).tolist()
        for paint, use in zip(layer.paint.tolist(), used, strict=True):
            dips = paint != load.paint or load.left < use
            load = BrushLoad(paint, (self.brush.dip.holds if dips else load.left) - use)
            found.append((dips, load))
        return found

    def _layer(self, plan: Plan, load: BrushLoad, already_done: int, of: int) -> Iterator[Action]:
        strokes = plan.strokes.detach().to(torch.float64)
        for index, (paint, (dips, after)) in enumerate(zip(plan.paint.tolist(), self.loads(plan, load), strict=True)):
            if dips:
                washing = self.cleaning_between(plan, load.paint, paint)
                full = BrushLoad(paint, self.brush.dip.holds)
                yield Action((*washing, self.motion.dip(paint)), Dipped(paint, cleaned=bool(washing)), full)
            load = after
            number = already_done + index + 1
            red, green, blue = strokes.color[index].tolist()
            motions = self.motion.swift_stroke(strokes, index, f"stroke {number}")
            yield Action(motions, StrokePainted(number, of, (red, green, blue)), load)

    def cleaning_between(self, layer: Plan, held: int | None, paint: int) -> tuple[Waypoints, ...]:
        """What cleans a brush that held one of a layer's paints, None: nothing, for another one: less for a darker."""
        if held is None or held == paint:
            return ()
        lightness = to_lab(layer.palette.color)[:, 0]
        darker = held < len(lightness) and bool(lightness[paint] < lightness[held])
        return self._washing() if darker else self.cleaning()

    def cleaning(self) -> tuple[Waypoints, ...]:
        """Rinses and wipes until whatever comes next is not coloured by what was on the brush."""
        return _WASHINGS * self._washing()

    def _washing(self) -> tuple[Waypoints, ...]:
        return self.motion.rinse(), self.motion.wipe()
