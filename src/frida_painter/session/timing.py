"""Reckons how long painting takes, from lengths and speeds, as the robot's clock will count it.

Thinking takes time of its own, and so does whoever fills the wells.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from frida_painter.brush.trajectory import END_THICKNESS
from frida_painter.hardware.robot import Waypoints
from frida_painter.hardware.workspace import Point
from frida_painter.plan import Plan
from frida_painter.session.choreography import BrushLoad, Choreography
from frida_painter.session.timetable import Timetable

_PHOTOGRAPH = 0.1  # seconds that the arm waits for a photograph
_HOME_RISE = 0.1  # metres above the rag, where a workspace states no home


def reckon(plan: Plan, choreography: Choreography, load: BrushLoad, looks: Callable[[int], int]) -> Timetable:
    """The time that a plan takes with a brush that holds `load`, the arm being at home.

    looks: how often the painter looks, for itself or for the film, after it has painted so many of the
    plan's strokes. Raises WorkspaceViolation where the workspace has no well for a paint.
    """
    motion, workspace = choreography.motion, choreography.motion.workspace
    places, lengths = _on_canvas(plan, choreography)
    drop = motion.travel_height - float(motion.calibration.height(np.array([END_THICKNESS]))[0])
    x, y, z = workspace.home or (*workspace.rag[:2], workspace.rag[2] + _HOME_RISE)
    home, areas = np.array([x, y, max(z, motion.travel_height)]), choreography.brush.area(plan.strokes).tolist()
    dips = {paint: motion.dip(paint) for paint in sorted(set(plan.paint.tolist()))}
    washing = choreography.cleaning()
    hand = _Hand(workspace.travel_speed, tuple(home))
    table, after = Timetable(), []
    for index, (paint, area) in enumerate(zip(plan.paint.tolist(), areas, strict=True)):
        if paint != load.paint or load.area < area:
            if load.paint is not None and paint != load.paint:
                for wash in washing:
                    table = replace(table, travel=table.travel + hand.to(wash), washing=table.washing + _seconds(wash))
            dip = dips[paint]
            table = replace(table, travel=table.travel + hand.to(dip), dips=table.dips + _seconds(dip))
            load = BrushLoad(paint, choreography.dip_area)
        load = BrushLoad(paint, load.area - area)
        way = hand.across(places[index, 0], places[index, 1])
        painting = (lengths[index] + 2 * drop) / workspace.painting_speed
        table = replace(table, travel=table.travel + way, strokes=table.strokes + painting)
        after.append(table.total)
        for _ in range(looks(index + 1)):
            table = replace(table, looks=table.looks + hand.aside() + _PHOTOGRAPH)
    return replace(table, after=tuple(after))


class _Hand:
    """Where the tip is, and how long it travels from there."""

    def __init__(self, speed: float, home: Point) -> None:
        self._speed, self._home = speed, np.array(home)
        self._here: NDArray[np.float64] = self._home

    def to(self, motion: Waypoints) -> float:
        """Seconds to where a motion begins; afterwards the tip is where it ends."""
        return self.across(motion.position[0], motion.position[-1])

    def across(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> float:
        """Seconds to `start`; afterwards the tip is at `end`."""
        seconds = float(np.linalg.norm(start - self._here)) / self._speed
        self._here = end
        return seconds

    def aside(self) -> float:
        """Seconds up and home."""
        above = np.array([*self._here[:2], max(self._here[2], self._home[2])])
        length = float(np.linalg.norm(above - self._here) + np.linalg.norm(self._home - above))
        self._here = self._home
        return length / self._speed


def _on_canvas(plan: Plan, choreography: Choreography) -> tuple[NDArray[np.float64], list[float]]:
    """Where the tip is above each stroke's start and end, robot's frame [n, 2, 3], and the lengths of the paths, m."""
    motion = choreography.motion
    path = plan.strokes.detach().to(torch.float64).path(torch.linspace(0, 1, 33, dtype=torch.float64)).numpy()
    lengths = np.linalg.norm(np.diff(path, axis=1), axis=2).sum(1)
    ends = motion.calibration.place(path[:, [0, -1]].reshape(-1, 2))
    above = motion.workspace.to_robot(ends, np.full(len(ends), motion.travel_height))
    return above.reshape(-1, 2, 3), lengths.tolist()


def _seconds(motion: Waypoints) -> float:
    return motion.length / motion.speed
