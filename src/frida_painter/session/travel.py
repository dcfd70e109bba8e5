"""The order of strokes that lets the hand travel least, as far as nobody will see the difference.

Strokes of one paint that follow each other may change places where their marks do not meet; where
they meet, and between paints, the planner's order stays. With the dips that come in between it is
the problem of a van that serves customers from a depot, and is solved as such problems are: from a
greedy tour by moving one stroke at a time to where it costs less, as long as one does.
"""

import itertools
from dataclasses import dataclass
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray

from frida_painter.plan import Plan
from frida_painter.session.choreography import BrushLoad, Choreography
from frida_painter.strokes import Strokes

_MOST_AT_ONCE = 120  # strokes; of longer runs each part is put in order on its own
_POINTS = 9  # of a path, to tell whether two marks meet
_ROUNDS = 6
_GAIN = 1e-3  # metres: less is not worth a move, and would let a hair's breadth decide between equal ways

PlanarPoint = complex  # metres in the robot's frame from above, x + iy: the distance of two is abs(a - b)


def shorten_travel(plan: Plan, count: int, choreography: Choreography, load: BrushLoad) -> Plan:
    """The plan with its first `count` strokes in an order that is quicker to paint with a brush that holds `load`.

    All of these are of one layer. The picture stays: strokes whose marks may meet keep their order, and so do paints.
    """
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
            tour = _Tour.of(plan.strokes[part], choreography, paint, load)
            chosen, left = tour.shortest()
            order += [part[index] for index in chosen]
            load = BrushLoad(paint, left)
    order += range(len(order), len(plan))
    return plan.reordered(torch.tensor(order, dtype=torch.long))


def marks_may_meet(strokes: Strokes, width: float) -> NDArray[np.bool_]:
    """Whether the marks of each two strokes may meet, [n, n]; width: of the widest mark, metres."""
    fraction = torch.linspace(0, 1, _POINTS, dtype=torch.float64)
    path = strokes.detach().to(torch.float64).path(fraction).numpy()  # [n, t, 2]
    # Between two points the path strays from both by half of their distance at most.
    between = np.linalg.norm(np.diff(path, axis=1), axis=2).max(1, initial=0.0) / 2  # [n]
    apart = np.stack([_distances(one, path) for one in path]) if len(path) else np.zeros((0, 0))
    return apart <= width + between[:, None] + between


def _distances(one: NDArray[np.float64], path: NDArray[np.float64]) -> NDArray[np.float64]:
    """The least distance between points of `one` [t, 2] and of each path [n, t, 2], [n]."""
    across = path[:, None, :, :] - one[None, :, None, :]  # [n, t, t, 2]
    return np.sqrt((across**2).sum(-1).min((1, 2)))


@dataclass(frozen=True)
class _Tour:
    """Strokes of one paint: where each starts and ends, what it takes, and which must come before it."""

    starts: list[PlanarPoint]
    ends: list[PlanarPoint]
    uses: list[float]
    before: list[set[int]]
    well: PlanarPoint
    water: PlanarPoint
    load: float
    dip_holds: float
    dip_length: float  # metres that a dip itself takes at the speed of travel

    @classmethod
    def of(cls, strokes: Strokes, choreography: Choreography, paint: int, load: BrushLoad) -> Self:
        motion = choreography.motion
        precise = strokes.detach().to(torch.float64)
        ends = precise.path(torch.tensor([0.0, 1.0], dtype=torch.float64)).numpy()  # [n, 2, 2]
        sent = motion.workspace.to_robot(motion.calibration.place(ends.reshape(-1, 2)), np.zeros(2 * len(strokes)))
        places = (sent[:, 0] + 1j * sent[:, 1]).tolist()
        meets = marks_may_meet(strokes, choreography.brush.width)
        dip, held = motion.dip(paint), load.paint == paint
        return cls(
            starts=places[::2],
            ends=places[1::2],
            uses=choreography.brush.dip.used_by(choreography.brush.area(strokes)).tolist(),
            before=[set(np.flatnonzero(meets[index, :index]).tolist()) for index in range(len(strokes))],
            well=complex(*dip.position[-1, :2]),
            water=complex(*motion.rinse().position[0, :2]),
            load=load.left if held else 0.0,
            dip_holds=choreography.brush.dip.holds,
            dip_length=dip.length,
        )

    def shortest(self) -> tuple[list[int], float]:
        """The shortest order that was found, and what it leaves of the dip."""
        order, other = list(range(len(self.starts))), self._nearest_next()
        if self.travel(other) < self.travel(order) - _GAIN:
            order = other
        best = self.travel(order)
        for _ in range(_ROUNDS):
            found = self._moved_one(order, best)
            if found is None:
                break
            order, best = found
        return order, self._walk(order)[1]

    def travel(self, order: list[int]) -> float:
        """Metres from the well through all strokes, by the well wherever the brush runs out, and to the water."""
        return self._walk(order)[0]

    def _walk(self, order: list[int]) -> tuple[float, float]:
        here, left, total = self.well, self.load, 0.0
        for index in order:
            use, start = self.uses[index], self.starts[index]
            if left < use:
                total += abs(self.well - here) + self.dip_length
                here, left = self.well, self.dip_holds
            total += abs(start - here)
            here, left = self.ends[index], left - use
        return total + abs(self.water - here), left

    def _nearest_next(self) -> list[int]:
        """Always the nearest stroke that may come next; by the well, where the brush has run out."""
        order: list[int] = []
        done: set[int] = set()
        here, left = self.well, self.load
        open_ = set(range(len(self.starts)))
        while open_:
            free = [index for index in open_ if self.before[index] <= done]
            chosen = min(free, key=lambda index: (self._step(here, left, index), index))
            if left < self.uses[chosen]:
                left = self.dip_holds
            here, left = self.ends[chosen], left - self.uses[chosen]
            order.append(chosen)
            done.add(chosen)
            open_.remove(chosen)
        return order

    def _step(self, here: PlanarPoint, left: float, index: int) -> float:
        if left < self.uses[index]:
            return abs(self.well - here) + self.dip_length + abs(self.starts[index] - self.well)
        return abs(self.starts[index] - here)

    def _moved_one(self, order: list[int], best: float) -> tuple[list[int], float] | None:
        """The order after every move of one stroke that shortened it; None where none did."""
        improved = False
        for stroke in range(len(self.starts)):
            at = order.index(stroke)
            rest = order[:at] + order[at + 1 :]
            low, high = self._room(rest, stroke)
            for place in range(low, high + 1):
                moved = [*rest[:place], stroke, *rest[place:]]
                length = self.travel(moved)
                if length < best - _GAIN:
                    order, best, improved = moved, length, True
        return (order, best) if improved else None

    def _room(self, rest: list[int], stroke: int) -> tuple[int, int]:
        """The first and the last place in `rest` where the stroke may stand."""
        low, high = 0, len(rest)
        for place, other in enumerate(rest):
            if other in self.before[stroke]:
                low = place + 1
            elif stroke in self.before[other] and high == len(rest):
                high = place
        return low, high
