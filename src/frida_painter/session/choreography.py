"""Choreography of a plan: dips, rinses, wipes and strokes as motions in their order, before anything moves.

This module does not use a robot. It also tells how many motions, how much time and how much paint a plan takes. The
class `Hand` (hand.py) performs the motions.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray

from frida_painter.brush.kinds import END_THICKNESS, BrushKind, brush_kind
from frida_painter.errors import ConfigError
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Point, Waypoints
from frida_painter.hardware.timing import AxisTiming, Timing
from frida_painter.session.events import Dipped, StrokePainted
from frida_painter.strokes.palette import to_lab
from frida_painter.strokes.plan import Plan

_MILESTONES = 300
_WASHINGS = 2  # rounds of rinse and wipe; the rest of one round shows only in a lighter paint


@dataclass(frozen=True)
class BrushLoad:
    """Paint on the brush.

    paint: well number, None for a clean brush.
    left: rest of the last dip, in units of the brush's `Dip`.
    """

    paint: int | None = None
    left: float = 0.0


@dataclass(frozen=True)
class Action:
    """One action of the brush: its motions, the event that reports it, and the brush load after it."""

    motions: tuple[Waypoints, ...]
    done: Dipped | StrokePainted
    load: BrushLoad


@dataclass(frozen=True)
class Choreography:
    """Turns plans into motions of a brush: it refills the brush before it runs out and cleans it between colours.

    The paint on the brush is estimated from the area painted since the last dip, or from the number of strokes if
    only that is known (paper, "Robot Setup Details").
    others: choreographies of the brushes of other layers, by brush name.
    """

    motion: Motion
    brush: BrushKind
    others: "Mapping[str, Choreography]" = field(default_factory=dict)

    @classmethod
    def of(cls, motion: Motion, brushes: Sequence[str], refill: float | None = None) -> Self:
        """Returns a choreography for several brushes with the same motions, and for strokes in any order.

        refill: as in `BrushKind.dipped_for`
        Raises ConfigError for an unknown brush.
        """
        first, *others = (brush_kind(name).for_any_order.dipped_for(refill) for name in brushes)
        return cls(motion, first, {kind.name: cls(motion, kind) for kind in others})

    def with_brush(self, name: str) -> "Choreography":
        """Returns the choreography of a brush.

        Raises ConfigError if there are several brushes and this is none of them.
        """
        if self.others and name not in (self.brush.name, *self.others):
            raise ConfigError(
                f"A layer is for the brush {name!r}; here are {self.brush.name}, {', '.join(self.others)}."
            )
        return self.others.get(name, self)

    def actions(self, plan: Plan, load: BrushLoad, already_done: int, of: int) -> Iterator[Action]:
        """Yields all actions of painting the plan, in order; each further layer begins with a clean brush.

        load: paint on the brush at the beginning.
        already_done, of: strokes painted before, and their total; numbers begin at `already_done` + 1.
        Raises WorkspaceViolation if the workspace has no well for a paint.
        """
        for part in plan.filled_layers():
            yield from self.with_brush(part.layers[0].brush)._layer(part, load, already_done, of)
            load, already_done = BrushLoad(), already_done + len(part)

    def loads(self, layer: Plan, load: BrushLoad) -> list[tuple[bool, BrushLoad]]:
        """Returns for each stroke of a layer if the brush is dipped before it, and the brush load after it.

        load: paint on the brush at the beginning.
        """
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
        """Returns the motions that clean a brush between two paints of a layer; a darker next paint needs fewer.

        held: paint on the brush, None for a clean one.
        """
        if held is None or held == paint:
            return ()
        lightness = to_lab(layer.palette.color)[:, 0]
        darker = held < len(lightness) and bool(lightness[paint] < lightness[held])
        return self._washing() if darker else self.cleaning()

    def cleaning(self) -> tuple[Waypoints, ...]:
        """Returns rinses and wipes after which no rest of the old paint colours the next one."""
        return _WASHINGS * self._washing()

    def _washing(self) -> tuple[Waypoints, ...]:
        return self.motion.rinse(), self.motion.wipe()


# Duration of painting, from lengths, speeds and accelerations, in seconds of the robot's clock.
#
# The time for planning and for filling the wells is not included.

DRYING = 1200.0
"""Default drying time in seconds between two layers.

Winsor & Newton ("Understanding drying times for acrylic paints") give 10 to 20 minutes for thin films of Galeria
and 20 to 30 for thin films of Professional Acrylic.
"""


@dataclass(frozen=True)
class Timetable:
    """Duration of painting, in seconds of the robot's clock.

    strokes: on the canvas.
    dips: paint from the wells.
    washing: rinses and wipes.
    changes: brushes at the rack.
    travel: between all of these.
    looks: trips to the home position and back.
    drying: layers that dry before the next one.
    after: seconds from the beginning until each stroke is painted.
    dried: seconds of these in which a layer dries.
    """

    strokes: float = 0.0
    dips: float = 0.0
    washing: float = 0.0
    changes: float = 0.0
    travel: float = 0.0
    looks: float = 0.0
    drying: float = 0.0
    after: tuple[float, ...] = ()
    dried: tuple[float, ...] = ()

    @property
    def total(self) -> float:
        """Total seconds."""
        return self.strokes + self.dips + self.washing + self.changes + self.travel + self.looks + self.drying

    @property
    def milestones(self) -> tuple[tuple[int, float, float], ...]:
        """Numbers of at most some hundred strokes with their seconds in `after` and `dried`.

        They include the strokes before and after a drying, so that the seconds of those in between grow evenly.
        """
        count = len(self.after)
        dry = (number for number in range(1, count) if self.dried[number] != self.dried[number - 1])
        every = -(-count // _MILESTONES) or 1
        numbers = {1, *range(every, count, every), count, *(near for number in dry for near in (number, number + 1))}
        return tuple(
            (number, round(self.after[number - 1], 2), round(self.dried[number - 1], 2))
            for number in sorted(numbers) if 0 < number <= count
        )  # fmt: skip

    def after_drying(self, seconds: float) -> "Timetable":
        """Returns the timetable with this drying time before everything else."""
        after, dried = (tuple(seconds + done for done in each) for each in (self.after, self.dried))
        return replace(self, drying=self.drying + seconds, after=after, dried=dried)


_PHOTOGRAPH = 0.1  # seconds that the arm waits for a photograph
_HOME_RISE = 0.1  # metres above the rag, if a workspace has no home

Looks = Callable[[int, bool], int]
"""Number of trips to the home position, for a look or for the film, after so many strokes of a plan.

Its second argument is True if the arm leaves the canvas then anyway, for paint or at the end of a layer. It is
called for every stroke in turn.
"""


def no_looks(painted: int, leaves: bool) -> int:
    """Returns 0: no looks."""
    return 0


def reckon(
    plan: Plan,
    choreography: Choreography,
    load: BrushLoad,
    looks: Looks = no_looks,
    timing: Timing | AxisTiming | None = None,
    drying: float = DRYING,
    held: str | None = None,
) -> Timetable:
    """Computes the time that a plan takes, with the arm at home at the beginning.

    load: paint on the brush at the beginning.
    looks: looks of the painter and of the film.
    timing: limits of the robot. None: it always moves at full speed.
    drying: seconds between two layers.
    held: brush in the hand of a robot with a rack; "" or None for none.
    Raises WorkspaceViolation if the workspace has no well for a paint.
    """
    motion, pace = choreography.motion, _Pace(timing)
    x, y, z = motion.workspace.home or (*motion.workspace.rag[:2], motion.workspace.rag[2] + _HOME_RISE)
    home = np.array([x, y, max(z, motion.travel_height)])
    hand = _Hand(motion.workspace.travel_speed, tuple(home), pace)
    kinds = ("strokes", "dips", "washing", "changes", "travel", "looks", "drying")  # in the order of `Timetable.total`
    spent: dict[str, Any] = dict.fromkeys(kinds, 0.0)
    after, dried = [], []

    def make(motions: Iterable[Waypoints], kind: str) -> None:
        for each in motions:
            way, work = hand.make(each)
            spent["travel"] += way
            spent[kind] += work

    for number, part in enumerate(plan.filled_layers()):
        if number:  # the brush is cleaned, and the arm moves to its home position
            make(choreography.cleaning() if load.paint is not None else (), "washing")
            load = BrushLoad()
            spent["travel"] += hand.aside()
            spent["drying"] += drying
        brush = part.layers[0].brush
        if motion.workspace.rack is not None and brush != held:
            make(motion.change(held, brush), "changes")
            held = brush
        here = choreography.with_brush(brush)
        places, lengths = _on_canvas(part, here)
        painting = _steadily(lengths, here.motion) if timing is None else _motion_by_motion(part, here.motion, pace)
        loads = here.loads(part, load)
        dips = {paint: motion.dip(paint) for paint in sorted(set(part.paint.tolist()))}
        for index, (paint, (dipped, after_stroke)) in enumerate(zip(part.paint.tolist(), loads, strict=True)):
            if dipped:
                make(here.cleaning_between(part, load.paint, paint), "washing")
                make((dips[paint],), "dips")
            load = after_stroke
            spent["travel"] += hand.across(places[index, 0], places[index, 1]) + pace.between
            spent["strokes"] += painting[index]
            after.append(sum(spent.values()))
            dried.append(spent["drying"])
            leaves = all(dipped for dipped, _ in loads[index + 1 : index + 2])  # also True at the end of a layer
            for _ in range(looks(len(after), leaves)):
                spent["looks"] += hand.aside() + _PHOTOGRAPH
    return Timetable(**spent, after=tuple(after), dried=tuple(dried))


@dataclass(frozen=True)
class _Pace:
    """Duration of motions of the brush tip, from rest to rest."""

    timing: Timing | AxisTiming | None

    @property
    def between(self) -> float:
        """Seconds between two motions, if the robot's controller tells its limits; else 0."""
        return self.timing.between if isinstance(self.timing, AxisTiming) else 0.0

    def of(self, motion: Waypoints) -> float:
        """Returns the seconds from the first waypoint to the last."""
        return self.along(motion.position, np.full(len(motion.position) - 1, motion.speed))

    def along(self, path: NDArray[np.float64], speeds: NDArray[np.float64]) -> float:
        """Returns the seconds through points [k, 3]; speeds [k - 1] of the pieces are in m/s."""
        if self.timing is None:
            return float((np.linalg.norm(np.diff(path, axis=0), axis=1) / speeds).sum())
        return self.timing.seconds(path, speeds)


class _Hand:
    """Position of the brush tip, and durations of travel from there."""

    def __init__(self, speed: float, home: Point, pace: _Pace) -> None:
        self._speed, self._home, self._pace = speed, np.array(home), pace
        self._here: NDArray[np.float64] = self._home

    def make(self, motion: Waypoints) -> tuple[float, float]:
        """Returns the seconds to the beginning of a motion and from there to its end, and moves the tip to the end."""
        if not isinstance(self._pace.timing, AxisTiming):
            return self.to(motion), self._pace.of(motion)
        way = self._pace.along(np.stack([self._here, motion.position[0]]), np.array([self._speed]))
        return way, self.through(motion) + self._pace.between - way  # the machine does not stop between both

    def to(self, motion: Waypoints) -> float:
        """Returns the seconds to the beginning of a motion, and moves the tip to the motion's end."""
        return self.across(motion.position[0], motion.position[-1])

    def through(self, motion: Waypoints) -> float:
        """Returns the seconds to the beginning of a motion and through it, without a stop between."""
        path = np.concatenate([self._here[None], motion.position])
        self._here = motion.position[-1]
        return self._pace.along(path, np.r_[self._speed, np.full(len(path) - 2, motion.speed)])

    def across(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> float:
        """Returns the seconds to `start`, and moves the tip to `end`."""
        seconds = self._pace.along(np.stack([self._here, start]), np.array([self._speed]))
        self._here = end
        return seconds

    def aside(self) -> float:
        """Returns the seconds for moving up and to the home position."""
        above = np.array([*self._here[:2], max(self._here[2], self._home[2])])
        path = np.stack([self._here, above, self._home])
        self._here = self._home
        return self._pace.along(path, np.full(2, self._speed)) + self._pace.between


def _on_canvas(plan: Plan, choreography: Choreography) -> tuple[NDArray[np.float64], list[float]]:
    """Returns the tip positions above each stroke's start and end, and the lengths of the paths in metres.

    The positions are in the robot frame, [n, 2, 3].
    """
    motion = choreography.motion
    path = plan.strokes.detach().to(torch.float64).path(torch.linspace(0, 1, 33, dtype=torch.float64)).numpy()
    lengths = np.linalg.norm(np.diff(path, axis=1), axis=2).sum(1)
    ends = motion.calibration.place(path[:, [0, -1]].reshape(-1, 2))
    above = motion.workspace.to_robot(ends, np.full(len(ends), motion.travel_height))
    return above.reshape(-1, 2, 3), lengths.tolist()


def _steadily(lengths: list[float], motion: Motion) -> list[float]:
    """Returns the seconds of each stroke from the length of its path, with lowering and lifting."""
    low = motion.clearance_height
    drop = low - float(motion.calibration.height(np.array([END_THICKNESS]))[0])
    air = 2 * (motion.travel_height - low) / motion.workspace.travel_speed
    return [(length + 2 * drop) / motion.workspace.painting_speed + air for length in lengths]


def _motion_by_motion(plan: Plan, motion: Motion, pace: _Pace) -> list[float]:
    """Returns the seconds of each stroke from its full motion, which slows down in bends."""
    strokes = plan.strokes.detach().to(torch.float64)
    seconds = []
    for index in range(len(plan)):
        above, stroke, up = motion.swift_stroke(strokes, index, "stroke")
        hand = _Hand(up.speed, tuple(above.position[0]), pace)
        seconds.append(hand.through(stroke) + hand.to(up) + 2 * pace.between)
    return seconds
