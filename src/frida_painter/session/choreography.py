"""What the hand does in which order: dips, rinses, wipes and strokes as motions, before anything moves.

Nothing in here knows a robot. Whoever wants to know what painting a plan takes, in motions, in
time or in paint, asks here; `brushwork` performs it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray

from frida_painter.brush.kinds import END_THICKNESS, BrushKind, brush_kind
from frida_painter.errors import ConfigError
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Point, Timing, Waypoints
from frida_painter.palette import to_lab
from frida_painter.plan import Plan
from frida_painter.session.events import DRYING, Dipped, StrokePainted, Timetable

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


# Reckons how long painting takes, from lengths, speeds and how the arm starts and stops, by the robot's clock.
#
# CpuActivity takes time of its own, and so does whoever fills the wells.

_PHOTOGRAPH = 0.1  # seconds that the arm waits for a photograph
_HOME_RISE = 0.1  # metres above the rag, where a workspace states no home

Looks = Callable[[int, bool], int]
"""How often the arm goes aside, to look or for the film, after so many strokes of a plan; whether it leaves the canvas
then anyway, for paint or because a layer ends. It is asked of every stroke in turn."""


def no_looks(painted: int, leaves: bool) -> int:
    """Nobody looks."""
    return 0


def reckon(
    plan: Plan,
    choreography: Choreography,
    load: BrushLoad,
    looks: Looks = no_looks,
    timing: Timing | None = None,
    drying: float = DRYING,
    held: str | None = None,
) -> Timetable:
    """The time that a plan takes with a brush that holds `load`, the arm being at home.

    looks: how often the painter looks, for itself or for the film; timing: how the arm starts and stops, None to reckon
    with its full speed; drying: seconds between two layers; held: the brush in the hand of a robot with a rack, "" or
    None for none. Raises WorkspaceViolation where the workspace has no well for a paint.
    """
    motion, pace = choreography.motion, _Pace(timing)
    x, y, z = motion.workspace.home or (*motion.workspace.rag[:2], motion.workspace.rag[2] + _HOME_RISE)
    home = np.array([x, y, max(z, motion.travel_height)])
    hand = _Hand(motion.workspace.travel_speed, tuple(home), pace)
    table, after = Timetable(), []

    def wash(table: Timetable, washing: tuple[Waypoints, ...]) -> Timetable:
        for each in washing:
            table = replace(table, travel=table.travel + hand.to(each), washing=table.washing + pace.of(each))
        return table

    def change(table: Timetable, brush: str) -> Timetable:
        for each in motion.change(held, brush):
            table = replace(table, travel=table.travel + hand.to(each), changes=table.changes + pace.of(each))
        return table

    for number, part in enumerate(plan.filled_layers()):
        if number:  # the brush is cleaned, and the arm goes aside
            table = wash(table, choreography.cleaning()) if load.paint is not None else table
            load = BrushLoad()
            table = replace(table, travel=table.travel + hand.aside(), drying=table.drying + drying)
        brush = part.layers[0].brush
        if motion.workspace.rack is not None and brush != held:
            table, held = change(table, brush), brush
        here = choreography.with_brush(brush)
        places, lengths = _on_canvas(part, here)
        painting = _steadily(lengths, here.motion) if timing is None else _motion_by_motion(part, here.motion, pace)
        loads = here.loads(part, load)
        dips = {paint: motion.dip(paint) for paint in sorted(set(part.paint.tolist()))}
        for index, (paint, (dipped, after_stroke)) in enumerate(zip(part.paint.tolist(), loads, strict=True)):
            if dipped:
                table = wash(table, here.cleaning_between(part, load.paint, paint))
                dipping = dips[paint]
                table = replace(table, travel=table.travel + hand.to(dipping), dips=table.dips + pace.of(dipping))
            load = after_stroke
            way = hand.across(places[index, 0], places[index, 1])
            table = replace(table, travel=table.travel + way, strokes=table.strokes + painting[index])
            after.append(table.total)
            leaves = all(dipped for dipped, _ in loads[index + 1 : index + 2])  # the end of a layer too
            for _ in range(looks(len(after), leaves)):
                table = replace(table, looks=table.looks + hand.aside() + _PHOTOGRAPH)
    return replace(table, after=tuple(after))


@dataclass(frozen=True)
class _Pace:
    """How long the tip takes for its ways, from rest to rest."""

    timing: Timing | None

    def of(self, motion: Waypoints) -> float:
        """Seconds from the first waypoint to the last."""
        return self.along(motion.position, np.full(len(motion.position) - 1, motion.speed))

    def along(self, path: NDArray[np.float64], speeds: NDArray[np.float64]) -> float:
        """Seconds through points [k, 3], the pieces between them at speeds of [k - 1] m/s."""
        if self.timing is None:
            return float((np.linalg.norm(np.diff(path, axis=0), axis=1) / speeds).sum())
        return self.timing.seconds(path, speeds)


class _Hand:
    """Where the tip is, and how long it travels from there."""

    def __init__(self, speed: float, home: Point, pace: _Pace) -> None:
        self._speed, self._home, self._pace = speed, np.array(home), pace
        self._here: NDArray[np.float64] = self._home

    def to(self, motion: Waypoints) -> float:
        """Seconds to where a motion begins; afterwards the tip is where it ends."""
        return self.across(motion.position[0], motion.position[-1])

    def through(self, motion: Waypoints) -> float:
        """Seconds to where a motion begins and through it, without a stop in between."""
        path = np.concatenate([self._here[None], motion.position])
        self._here = motion.position[-1]
        return self._pace.along(path, np.r_[self._speed, np.full(len(path) - 2, motion.speed)])

    def across(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> float:
        """Seconds to `start`; afterwards the tip is at `end`."""
        seconds = self._pace.along(np.stack([self._here, start]), np.array([self._speed]))
        self._here = end
        return seconds

    def aside(self) -> float:
        """Seconds up and home."""
        above = np.array([*self._here[:2], max(self._here[2], self._home[2])])
        path = np.stack([self._here, above, self._home])
        self._here = self._home
        return self._pace.along(path, np.full(2, self._speed))


def _on_canvas(plan: Plan, choreography: Choreography) -> tuple[NDArray[np.float64], list[float]]:
    """Where the tip is above each stroke's start and end, robot's frame [n, 2, 3], and the lengths of the paths, m."""
    motion = choreography.motion
    path = plan.strokes.detach().to(torch.float64).path(torch.linspace(0, 1, 33, dtype=torch.float64)).numpy()
    lengths = np.linalg.norm(np.diff(path, axis=1), axis=2).sum(1)
    ends = motion.calibration.place(path[:, [0, -1]].reshape(-1, 2))
    above = motion.workspace.to_robot(ends, np.full(len(ends), motion.travel_height))
    return above.reshape(-1, 2, 3), lengths.tolist()


def _steadily(lengths: list[float], motion: Motion) -> list[float]:
    """Seconds of each stroke by the length of its path alone, down and up included."""
    low = motion.clearance_height
    drop = low - float(motion.calibration.height(np.array([END_THICKNESS]))[0])
    air = 2 * (motion.travel_height - low) / motion.workspace.travel_speed
    return [(length + 2 * drop) / motion.workspace.painting_speed + air for length in lengths]


def _motion_by_motion(plan: Plan, motion: Motion, pace: _Pace) -> list[float]:
    """Seconds of each stroke as its motion goes, which slows down in bends."""
    strokes = plan.strokes.detach().to(torch.float64)
    seconds = []
    for index in range(len(plan)):
        above, stroke, up = motion.swift_stroke(strokes, index, "stroke")
        hand = _Hand(up.speed, tuple(above.position[0]), pace)
        seconds.append(hand.through(stroke) + hand.to(up))
    return seconds
