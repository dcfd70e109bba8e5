"""Hand: performs the actions of a choreography on an easel and keeps track of the paint on the brush."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

import numpy as np
import torch

from frida_painter.brush.kinds import BrushKind, Dip, brush_kind
from frida_painter.calibration import Calibration
from frida_painter.errors import ConfigError
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gateway import RobotGateway
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Waypoints, Workspace
from frida_painter.planning.forecast import Fading
from frida_painter.planning.placement import Placement
from frida_painter.registry import Later
from frida_painter.session.choreography import DRYING, Action, BrushLoad, Choreography, Looks, Timetable, reckon
from frida_painter.session.events import Dipped, StrokeLeftOut, StrokePainted
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import Strokes

# Order of strokes: quick to paint, with a full brush for strokes that must not lack paint.
#
# Strokes of one paint may change places even if their marks overlap. Each lets through its share of the picture
# below, and paint of one colour makes up the rest, in any order. Between paints, the planner's order stays.
#
# The last strokes before a dip lack paint, so these should be strokes that matter least. With the dips, this is a
# vehicle routing problem, and is solved like one. The start is a greedy tour, or a tour with one dip for each
# stroke, whose legs are joined by their savings (G. Clarke and J. Wright, "Scheduling of vehicles from a central
# depot to a number of delivery points", 1964). Then single strokes move or two strokes are exchanged, as long as
# that reduces the cost.

_MAX_AT_ONCE = 60  # strokes; longer runs are ordered in parts
_ROUNDS = 4
_GAIN = 1e-3  # metres: a smaller gain is not worth a move; rounding would decide between equal orders
_A_WHOLE_LOSS = 200.0  # metres of travel that are worth as much as the squared error of the whole painting

PlanarPoint = complex  # metres in the robot's frame from above, x + iy: the distance of two is abs(a - b)


def put_in_order(
    plan: Plan, count: int, choreography: Choreography, load: BrushLoad, fading: Fading | None = None
) -> Plan:
    """Returns the plan with its first `count` strokes, all of one layer, in a good order for painting.

    The plan's picture stays the same: only strokes of the same paint change places, and paints keep their order.
    load: paint on the brush at the beginning.
    fading: cost of strokes that lack paint. None: no cost.
    """
    fading = fading or Fading.none(len(plan))
    order: list[int] = []
    numbers = plan.well[:count].tolist()
    if numbers:
        choreography = choreography.with_brush(plan.layers[int(plan.layer[0])].brush)
    for paint, run in itertools.groupby(range(len(numbers)), numbers.__getitem__):
        if not 0 <= paint < len(choreography.motion.workspace.wells):
            return plan  # the choreography reports the missing well
        indices = list(run)
        for first in range(0, len(indices), _MAX_AT_ONCE):
            part = indices[first : first + _MAX_AT_ONCE]
            tour = _Tour.of(plan.strokes[part], choreography, paint, load, fading.of(part))
            chosen, left = tour.best()
            order += [part[index] for index in chosen]
            load = BrushLoad(paint, left)
    order += range(len(order), len(plan))
    return plan.reorder(torch.tensor(order, dtype=torch.long))


@dataclass(frozen=True)
class _Tour:
    """Strokes of one paint: starts, ends, use of paint, and cost of missing paint."""

    starts: list[PlanarPoint]
    ends: list[PlanarPoint]
    uses: list[float]
    slopes: list[float]
    squares: list[float]
    well: PlanarPoint
    water: PlanarPoint
    load: float
    dip: Dip
    dip_length: float  # length of a dip's motion, in metres at travel speed

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
        """Returns the order of the least cost that was found, and the rest of the dip after it."""
        order = list(range(len(self.starts)))
        best = self.cost(order)
        for start in (self._nearest_next(), self._join_dips()):
            cost = self.cost(start)
            if cost < best - _GAIN:
                order, best = start, cost
        for _ in range(_ROUNDS):
            before = best
            for change in (_move, _exchange):
                for one, other in itertools.permutations(range(len(order)), 2):
                    changed = change(order, one, other)
                    cost = self.cost(changed)
                    if cost < best - _GAIN:
                        order, best = changed, cost
            if best == before:
                break
        return order, self._walk(order)[1]

    def cost(self, order: list[int]) -> float:
        """Returns the metres from the well through all strokes to the water, with dips when the brush is empty.

        Missing paint of strokes is added, converted into metres.
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
        """Returns the greedy order: always the nearest stroke, by the well if the brush is empty."""
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

    def _join_dips(self) -> list[int]:
        """Returns the order of the savings method: one dip for each stroke, then legs joined by the largest saving."""
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


def _move(order: list[int], one: int, other: int) -> list[int]:
    """Returns the order with the stroke at place `one` moved to place `other`."""
    rest = order[:one] + order[one + 1 :]
    return [*rest[:other], order[one], *rest[other:]]


def _exchange(order: list[int], one: int, other: int) -> list[int]:
    """Returns the order with the strokes at two places exchanged."""
    changed = list(order)
    changed[one], changed[other] = order[other], order[one]
    return changed


@dataclass
class Hand:
    """Paints plans on an easel, stroke by stroke.

    placement: placement error, which the robot's targets are corrected for.
    load: paint on the brush.
    drying: seconds between two layers.
    others: brushes of later layers.
    held: brush in the holder; "" for none, None if unknown. If the workspace has a rack, all brushes are in the
    rack at first.
    """

    easel: Easel
    brush: BrushKind
    placement: Placement = field(default_factory=Placement.unknown)
    load: BrushLoad = field(default_factory=BrushLoad)
    drying: float = DRYING
    others: tuple[BrushKind, ...] = ()
    held: str | None = field(init=False)
    _gateway: RobotGateway = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._gateway = RobotGateway(self.easel)
        self.learn(self.placement)
        self.held = self.brush.name if self.easel.workspace.rack is None else ""

    @property
    def last_motion(self) -> float:
        """Time of the robot's last motion, in seconds of its clock."""
        return self._gateway.last_motion

    def learn(self, placement: Placement) -> None:
        """Corrects later motions by this placement; touch heights stay if the new ones would leave the workspace."""
        calibration = self.easel.calibration
        record = placement.touch.correct(calibration)
        presses = [record.press_height, *(one.press_height for one in record.others.values())]
        if not min(presses) >= self.easel.workspace.lower[2]:
            placement = replace(placement, touch=self.placement.touch)
        self.placement = placement
        self._gateway.follow_touch(max(map(placement.touch.correction, (calibration.brush, *calibration.others))))

    def arrange(self, plan: Plan, count: int, fading: Fading | None = None) -> Plan:
        """Returns the plan with its first `count` strokes in a good order for painting; its picture stays the same.

        fading: cost of strokes that lack paint. None: no cost.
        """
        return put_in_order(plan, count, self._choreography(), self.load, fading)

    def timetable(self, plan: Plan, looks: Looks, load: BrushLoad | None = None) -> Timetable:
        """Returns the duration of painting the plan, with its looks.

        load: paint on the brush at the beginning. None: the current load.
        """
        return reckon(plan, self._choreography(), load or self.load, looks, self.easel.timing, self.drying, self.held)

    def prepare(self, plan: Plan, already_done: int, of: int) -> list[Action]:
        """Returns all actions of painting the plan; the gateway has checked their motions, and the easel knows them.

        Raises WorkspaceViolation before anything moves.
        """
        actions = list(self._choreography().actions(plan, self.load, already_done, of))
        motions = [motion for action in actions for motion in action.motions]
        self._gateway.check(motions)
        self.easel.foretell(motions)
        return actions

    def perform(self, action: Action) -> Dipped | StrokePainted | StrokeLeftOut:
        """Performs an action and returns the event that reports it. Raises RobotError or a subclass of it."""
        left_out = self._gateway.perform(action.motions)
        self.load = action.load
        done = action.done
        return StrokeLeftOut(done.done, done.of) if left_out and isinstance(done, StrokePainted) else done

    def step_aside(self) -> None:
        """Moves the arm out of the camera's view."""
        self._gateway.step_aside()

    def cleaning(self) -> tuple[Waypoints, ...]:
        """Returns the motions of `clean`."""
        return self._choreography().cleaning()

    def clean(self) -> None:
        """Rinses and wipes the brush; afterwards it holds no paint."""
        self._gateway.perform(self.cleaning())
        self.load = BrushLoad()

    @property
    def has_rack(self) -> bool:
        """True if the robot takes its brushes from a rack."""
        return self.easel.workspace.rack is not None

    def require_rack(self) -> None:
        """Checks, before anything moves, that a rack holds all brushes and that the robot can reach them.

        Raises ConfigError if a brush has no place in the rack, WorkspaceViolation if a place cannot be reached.
        """
        rack = self.easel.workspace.rack
        if rack is None:
            return
        names = [kind.name for kind in (self.brush, *self.others)]
        missing = [name for name in names if name not in rack.places]
        if missing:
            raise ConfigError(
                f"The rack of the workspace holds {', '.join(rack.places)}, and this painting needs "
                f"{' and '.join(missing)}; paint with those that are there (--brushes), or give "
                f"{'it' if len(missing) == 1 else 'them'} a place ([rack] places)."
            )
        motion = self._choreography().motion
        self._gateway.check(each for name in names for each in motion.change(name, name))

    def changing(self, brush: str) -> list[tuple[Waypoints, str]]:
        """Returns the motions that change the brush with the rack, and the held brush after each motion.

        brush: brush that is to be in the hand; "" for none.
        """
        motion = self._choreography().motion
        steps: list[tuple[Waypoints, str]] = []
        if self.held and self.held != brush:
            steps.append((motion.put_back(self.held), ""))
        if brush and self.held != brush:
            steps.append((motion.take(brush), brush))
        return steps

    def move_brush(self, motion: Waypoints, held: str) -> None:
        """Puts a clean brush into the rack or takes one from it; afterwards the robot holds the brush `held`."""
        self.held = None
        self._gateway.perform((motion,))
        self.held, self.load = held, BrushLoad()

    def change_brush(self, name: str) -> None:
        """Asks a person to put the brush of a layer into the holder; the old brush is clean and the arm at home.

        Raises Interrupted if nobody does it.
        """
        self.held = None
        self.easel.operator.change_brush(name)
        self.held, self.load = name, BrushLoad()

    def _choreography(self) -> Choreography:
        record = self.placement.correct(self.easel.calibration, self.easel.canvas)
        return _choreography(self.easel.workspace, record, (self.brush, *self.others))


def choreography_at(
    workspace: Workspace, record: Calibration, brushes: Sequence[str], *, simulated: bool, refill: float | None = None
) -> Choreography:
    """Returns the choreography of these brushes at the easel of a record; the first brush is in the holder.

    simulated, refill: as in `with_measured_dip`
    Raises ConfigError for an unknown brush, CalibrationError if the record does not have a brush.
    """
    kinds = [with_measured_dip(brush_kind(name), record, simulated=simulated, refill=refill) for name in brushes]
    return _choreography(workspace, record, kinds)


def _choreography(workspace: Workspace, record: Calibration, kinds: Sequence[BrushKind]) -> Choreography:
    first, *others = kinds
    later = {kind.name: Choreography(Motion(workspace, record.of_brush(kind.name)), kind) for kind in others}
    return Choreography(Motion(workspace, record), first, later)


STROKES_PER_DIP = 4
"""Strokes per dip of an unmeasured brush; the program that was published with the paper used this for all brushes."""


_load_library = Later("frida_painter.brush.library:StrokeLibrary.load")
_estimate_dip = Later("frida_painter.brush.library:estimate_dip")


def with_measured_dip(
    kind: BrushKind, record: Calibration, *, simulated: bool, refill: float | None = None
) -> BrushKind:
    """Returns the brush with the capacity of one dip at the easel of that record.

    refill: millimetres that a dip paints with the whole width of the brush. None: as the record's stroke library
        shows; without it a fixed number of strokes, and in the virtual studio what the brush is known to hold
    Raises LibraryError if the library is damaged.
    """
    if refill is not None:
        return kind.dipped_for(refill)
    if kind.name in record.others:
        record = record.of_brush(kind.name)
    if record.library is not None and record.brush == kind.name:
        shown = _estimate_dip(_load_library(Path(record.library.path)), kind.width)
        if shown is not None:
            return replace(kind, known_dip=shown)
    return kind if simulated else replace(kind, known_dip=Dip.of_strokes(STROKES_PER_DIP))
