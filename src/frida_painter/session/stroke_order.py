"""The order of strokes that is quick to paint, and spends a full brush where paint must not lack.

Strokes of one paint that follow each other may change places, also where their marks meet: each lets through its share
of what lies below, and paint of one colour makes up the rest, in whatever order. Between paints the planner's order
stays. What a brush paints last before it is dipped again lacks paint: so strokes that would be missed least are painted
then. With the dips that come in between it is the problem of a van that serves customers from a depot, and is solved
as such problems are: from a greedy tour, or from one dip a stroke by joining legs where that saves most (G. Clarke and
J. Wright, "Scheduling of vehicles from a central depot to a number of delivery points", 1964), then by moving one
stroke or exchanging two as long as that costs less.
"""

import itertools
from dataclasses import dataclass
from typing import Self

import numpy as np
import torch

from frida_painter.brush.dip import Dip
from frida_painter.plan import Plan
from frida_painter.planning.fading import Fading
from frida_painter.session.choreography import BrushLoad, Choreography
from frida_painter.strokes import Strokes

_MOST_AT_ONCE = 60  # strokes; of longer runs each part is put in order on its own
_ROUNDS = 4
_GAIN = 1e-3  # metres: less is not worth a move, and would let a hair's breadth decide between equal ways
_A_WHOLE_LOSS = 200.0  # metres that may be travelled so that a painting has not twice its squared error

PlanarPoint = complex  # metres in the robot's frame from above, x + iy: the distance of two is abs(a - b)


def put_in_order(
    plan: Plan, count: int, choreography: Choreography, load: BrushLoad, fading: Fading | None = None
) -> Plan:
    """The plan with its first `count` strokes in an order that is good to paint with a brush that holds `load`.

    All of these are of one layer. The plan's picture stays: only strokes of the same paint change places, and paints
    keep their order. fading: what it costs that strokes of the plan lack paint, None: nothing.
    """
    fading = fading or Fading.none(len(plan))
    order: list[int] = []
    numbers = plan.well[:count].tolist()
    if numbers:
        choreography = choreography.with_brush(plan.layers[int(plan.layer[0])].brush)
    for paint, run in itertools.groupby(range(len(numbers)), numbers.__getitem__):
        if not 0 <= paint < len(choreography.motion.workspace.wells):
            return plan  # there is no such well; whoever sets the motions says so
        indices = list(run)
        for first in range(0, len(indices), _MOST_AT_ONCE):
            part = indices[first : first + _MOST_AT_ONCE]
            tour = _Tour.of(plan.strokes[part], choreography, paint, load, fading.of(part))
            chosen, left = tour.best()
            order += [part[index] for index in chosen]
            load = BrushLoad(paint, left)
    order += range(len(order), len(plan))
    return plan.reordered(torch.tensor(order, dtype=torch.long))


@dataclass(frozen=True)
class _Tour:
    """Strokes of one paint: where each starts and ends, what it takes of a dip, and what it costs that it fades."""

    starts: list[PlanarPoint]
    ends: list[PlanarPoint]
    uses: list[float]
    slopes: list[float]
    squares: list[float]
    well: PlanarPoint
    water: PlanarPoint
    load: float
    dip: Dip
    dip_length: float  # metres that a dip itself takes at the speed of travel

    @classmethod
    def of(cls, strokes: Strokes, choreography: Choreography, paint: int, load: BrushLoad, fading: Fading) -> Self:
        motion = choreography.motion
        precise = strokes.detach().to(torch.float64)
        ends = precise.path(torch.tensor([0.0, 1.0], dtype=torch.float64)).numpy()  # [n, 2, 2]
        sent = motion.workspace.to_robot(motion.calibration.place(ends.reshape(-1, 2)), np.zeros(2 * len(strokes)))
        places = (sent[:, 0] + 1j * sent[:, 1]).tolist()
        dipping, held = motion.dip(paint), load.paint == paint
        return cls(
            starts=places[::2],
            ends=places[1::2],
            uses=choreography.brush.dip.used_by(choreography.brush.area(strokes)).tolist(),
            slopes=fading.slope.tolist(),
            squares=fading.square.tolist(),
            well=complex(*dipping.position[-1, :2]),
            water=complex(*motion.rinse().position[0, :2]),
            load=load.left if held else 0.0,
            dip=choreography.brush.dip,
            dip_length=dipping.length,
        )

    def best(self) -> tuple[list[int], float]:
        """The order of the least cost that was found, and what it leaves of the dip."""
        order = list(range(len(self.starts)))
        best = self.cost(order)
        for start in (self._nearest_next(), self._joined()):
            cost = self.cost(start)
            if cost < best - _GAIN:
                order, best = start, cost
        for _ in range(_ROUNDS):
            before = best
            for change in (_moved, _exchanged):
                for one, other in itertools.permutations(range(len(order)), 2):
                    changed = change(order, one, other)
                    cost = self.cost(changed)
                    if cost < best - _GAIN:
                        order, best = changed, cost
            if best == before:
                break
        return order, self._walk(order)[1]

    def cost(self, order: list[int]) -> float:
        """Metres from the well through all strokes, by the well wherever the brush runs out, and to the water.

        What strokes lack of paint then counts as metres.
        """
        return self._walk(order)[0]

    def _walk(self, order: list[int]) -> tuple[float, float]:
        here, left, total = self.well, self.load, 0.0
        for index in order:
            use, start = self.uses[index], self.starts[index]
            if left < use:
                total += abs(self.well - here) + self.dip_length
                here, left = self.well, self.dip.holds
            lacks = self.dip.lacking(left, use)
            faded = lacks * (self.slopes[index] + lacks * self.squares[index])
            total += abs(start - here) + _A_WHOLE_LOSS * faded
            here, left = self.ends[index], left - use
        return total + abs(self.water - here), left

    def _nearest_next(self) -> list[int]:
        """Always the nearest stroke; by the well, where the brush has run out."""
        order: list[int] = []
        here, left = self.well, self.load
        open_ = set(range(len(self.starts)))
        while open_:
            chosen = min(open_, key=lambda index: (self._step(here, left, index), index))
            if left < self.uses[chosen]:
                left = self.dip.holds
            here, left = self.ends[chosen], left - self.uses[chosen]
            order.append(chosen)
            open_.remove(chosen)
        return order

    def _step(self, here: PlanarPoint, left: float, index: int) -> float:
        if left < self.uses[index]:
            return abs(self.well - here) + self.dip_length + abs(self.starts[index] - self.well)
        return abs(self.starts[index] - here)

    def _joined(self) -> list[int]:
        """At first a dip for each stroke; then what two dips paint is joined wherever that saves most."""
        count = len(self.starts)
        legs = {index: [index] for index in range(count)}  # by the first stroke
        ends = {index: index for index in range(count)}  # last stroke -> first
        used = dict(enumerate(self.uses))
        home = [abs(self.well - end) for end in self.ends]
        away = [abs(start - self.well) for start in self.starts]
        pairs = [
            (home[one] + away[other] - abs(self.starts[other] - self.ends[one]), one, other)
            for one, other in itertools.permutations(range(count), 2)
        ]
        for _, one, other in sorted(pairs, reverse=True):
            first = ends.get(one)
            if first is None or other not in legs or first == other or used[first] + used[other] > self.dip.holds:
                continue
            leg = legs.pop(other)
            legs[first] += leg
            used[first] += used.pop(other)
            del ends[one]
            ends[leg[-1]] = first
        return [index for leg in legs.values() for index in leg]


def _moved(order: list[int], one: int, other: int) -> list[int]:
    """The order with the stroke at place `one` at place `other`."""
    rest = order[:one] + order[one + 1 :]
    return [*rest[:other], order[one], *rest[other:]]


def _exchanged(order: list[int], one: int, other: int) -> list[int]:
    """The order with the strokes at two places exchanged."""
    changed = list(order)
    changed[one], changed[other] = order[other], order[one]
    return changed
