"""Rehearsal of a plan: checks every motion before anything moves, and reports all faults."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.hardware.gateway import Fault, MotionLimits, Surface
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Point, Reach, Waypoints, Workspace
from frida_painter.hardware.timing import TravelLimits
from frida_painter.strokes.palette import MAX_COLORS
from frida_painter.strokes.plan import Plan

# Desk: a workspace with only a canvas, for plotters and for people who hand out the paint.

_WELL_PITCH = 0.03
_WATER: Point = (0.0, -0.06, 0.0)
_MARGIN = 0.1
_DEEPEST, _HIGHEST = 0.02, 0.1


@dataclass(frozen=True)
class FlatbedWorkspace:
    """Workspace of a pen or a brush over a canvas; the canvas's bottom-left corner is the zero of all three axes.

    press: depth in metres of the hardest press below the lightest touch (z = 0); 0 for a pen.
    lift: travel height in metres.
    painting_speed, travel_speed: in m/s.
    Raises ConfigError if a value is out of range.
    """

    press: float = 0.002
    lift: float = 0.005
    painting_speed: float = 0.05
    travel_speed: float = 0.1

    def __post_init__(self) -> None:
        if not 0 <= self.press <= _DEEPEST:
            raise ConfigError(
                f"A press of {self.press * 1000:g} mm was given; it is from 0, for a pen, to {_DEEPEST * 1000:g} mm."
            )
        if not 0 < self.lift <= _HIGHEST:
            raise ConfigError(
                f"A lift of {self.lift * 1000:g} mm was given; it is above 0 and at most {_HIGHEST * 1000:g} mm."
            )
        for speed in (self.painting_speed, self.travel_speed):
            if not 0 < speed <= 1:
                raise ConfigError(f"A speed of {speed * 1000:g} mm/s was given; it is above 0 and at most 1000 mm/s.")

    def motion(self, canvas: CanvasSize) -> Motion:
        """Returns the motions of a brush there.

        Wells left of the canvas stand for the person who hands out the paint.
        """
        # A pen does not press, but a calibration must have some depth.
        press = max(self.press, math.ulp(1.0))
        workspace = Workspace(
            lower=(-_MARGIN - _WELL_PITCH * MAX_COLORS, -_MARGIN, -press),
            upper=(canvas.width + _MARGIN, canvas.height + _MARGIN, self.lift),
            canvas_origin=(0.0, 0.0, 0.0),
            canvas_angle=0.0,
            wells=tuple((-_WELL_PITCH * (well + 1), 0.0, 0.0) for well in range(MAX_COLORS)),
            water=_WATER,
            rag=_WATER,
            rag_width=0.0,
            hover=self.lift,
            painting_speed=self.painting_speed,
            travel_speed=self.travel_speed,
        )
        corners = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))  # no camera looks at it
        calibration = Calibration("desk", "any", corners, (1, 1), touch_height=0.0, press_height=-press)
        return Motion(workspace, calibration)


_SAME = 0.001  # metres: canvases are cut by hand


@dataclass(frozen=True)
class Rehearsal:
    """Faults that a rehearsal found.

    mismatches: differences between plan and easel, a sentence each.
    strokes: faults of strokes by their index in the plan.
    others: faults of dips, rinses, wipes and changes of brushes.
    """

    mismatches: tuple[str, ...]
    strokes: dict[int, Fault]
    others: tuple[Fault, ...]

    @property
    def passed(self) -> bool:
        """True if the plan can be painted there."""
        return not (self.mismatches or self.strokes or self.others)


def rehearse(
    plan: Plan,
    workspace: Workspace,
    canvas: CanvasSize,
    calibration: Calibration,
    reach: Reach | None = None,
    travel: TravelLimits | None = None,
) -> Rehearsal:
    """Checks every motion of a plan on an easel with a canvas of that size.

    reach: reach of the arm, if it does not cover the whole workspace.
    travel: limits of the machine itself. None: it has none, or was not asked.
    Raises CalibrationError if the plan has several brushes and the calibration lacks one of them.
    """
    strokes: dict[int, Fault] = {}
    fixed = travel if travel is not None and travel.zero_known else None
    ends: list[NDArray[np.float64]] = []
    before = 0
    for part in plan.filled_layers():
        known = calibration.of_brush(part.layers[0].brush) if len(plan.brushes) > 1 else calibration
        motion = Motion(workspace, known)
        limits = MotionLimits(workspace, Surface.of(canvas, known), reach, fixed)
        for index in range(len(part)):
            path = motion.stroke(part.strokes, index, f"stroke {before + index + 1}")
            ends += [path.position.min(0), path.position.max(0)]
            for fault in limits.faults([path]):
                strokes[before + index] = fault
        before += len(part)
    motion = Motion(workspace, calibration)
    around = list(_around(plan, motion))
    others = MotionLimits(workspace, Surface.of(canvas, calibration), reach, fixed).faults(around)
    ends += [end for path in around for end in (path.position.min(0), path.position.max(0))]
    short = _short_travel(travel, np.array(ends)) if travel is not None and fixed is None else ()
    return Rehearsal((*_mismatches(plan, workspace, canvas), *short), strokes, tuple(others))


def _short_travel(travel: TravelLimits, ends: NDArray[np.float64]) -> Iterator[str]:
    """Yields a sentence for each axis along which a machine whose zero is not known has too little travel."""
    for axis in np.flatnonzero(travel.beyond(ends).any(0)).tolist():
        yield (
            f"the painting needs {1000 * np.ptp(ends[:, axis]):.1f} mm along {'xyz'[axis]}, and the machine's own "
            f"limits leave {travel.describe(axis)}; move wells and canvas together, or change its limits if they are "
            "wrong"
        )


def _mismatches(plan: Plan, workspace: Workspace, canvas: CanvasSize) -> Iterator[str]:
    if max(abs(plan.canvas.width - canvas.width), abs(plan.canvas.height - canvas.height)) > _SAME:
        yield (
            f"the plan is for a canvas of {plan.canvas}, and the easel's is {canvas}; "
            "plan anew with --canvas, or put up the canvas of the plan and make the workspace true"
        )
    wells = max(end - first for first, end in (layer.paints for layer in plan.layers))
    if wells > len(workspace.wells):
        yield (
            f"the plan has {wells} paints, and the workspace {len(workspace.wells)} wells; "
            "plan anew with fewer --colors, or add wells"
        )
    if workspace.rack is not None:
        for name in plan.brushes:
            if name not in workspace.rack.places:
                yield (
                    f"the plan needs the {name} brush, and the rack holds {', '.join(workspace.rack.places)}; plan "
                    "anew with --brushes, or give it a place in the rack"
                )


def _around(plan: Plan, motion: Motion) -> Iterator[Waypoints]:
    """Yields the motions beside the canvas; missing wells are reported elsewhere."""
    for paint in sorted(set(plan.well.tolist())):
        if paint < len(motion.workspace.wells):
            yield motion.dip(paint)
    yield motion.rinse()
    yield motion.wipe()
    rack = motion.workspace.rack
    for name in plan.brushes:
        if rack is not None and name in rack.places:
            yield from motion.change(name, name)
