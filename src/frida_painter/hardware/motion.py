"""From painting to motion: strokes, dips, rinses, wipes and changes of brushes as waypoints of the brush's tip.

Every motion begins and ends at one height, above every object in the workspace. Therefore any motion may follow any
other.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from frida_painter.brush.kinds import stroke_path
from frida_painter.calibration import Calibration
from frida_painter.errors import ConfigError, WorkspaceViolation
from frida_painter.hardware.robot import BrushRack, Point, Waypoints, Workspace
from frida_painter.strokes.strokes import Strokes

STIR_RADIUS = 0.008
"""Radius of the tip's circle in a well or in the water, metres."""
_STEP = 0.001
_CLEARANCE = 0.005
_STIRS = 3


@dataclass(frozen=True)
class Motion:
    """Planner of motions: converts painting actions to waypoints, for one workspace and one calibration."""

    workspace: Workspace
    calibration: Calibration

    @property
    def travel_height(self) -> float:
        """Robot z at which the tip travels: above every object in the workspace."""
        return max(self.workspace.top, self.calibration.highest_touch) + self.workspace.hover

    def stroke(self, strokes: Strokes, index: int, name: str | None = None) -> Waypoints:
        """Returns the motion of stroke `index`: down, along its path at the depth for its thickness, and up.

        On an uneven canvas, the tip follows the height map.
        """
        on_canvas, thickness = stroke_path(strokes, index, step=_STEP)  # [k, 2], [k]
        return self.line(name or f"stroke {index}", on_canvas, thickness)

    def line(self, name: str, on_canvas: NDArray[np.float64], thickness: NDArray[np.float64]) -> Waypoints:
        """Returns the motion along points [k, 2] of the canvas, metres, at the depth for each thickness [k]."""
        height = self.calibration.height(thickness) + self.calibration.unevenness(on_canvas)
        path = self.workspace.to_robot(self.calibration.place(on_canvas), height)
        above = path[[0, -1]].copy()
        above[:, 2] = self.travel_height
        position = np.concatenate([above[:1], path, above[1:]])
        return Waypoints(name, position, self.workspace.painting_speed)

    def swift_stroke(self, strokes: Strokes, index: int, name: str) -> tuple[Waypoints, Waypoints, Waypoints]:
        """Returns the same stroke as three motions: to above its start, the stroke, and up; the outer two are fast.

        A robot goes to the first waypoint of a motion at travel speed. The stroke itself begins and ends slightly
        above the canvas, so that only a short way is gone at painting speed.
        """
        slow = self.stroke(strokes, index, name)
        above, low = slow.position[[0, -1]], slow.position[[0, -1]]
        low[:, 2] = self.clearance_height
        position = np.concatenate([low[:1], slow.position[1:-1], low[1:]])
        speed = self.workspace.travel_speed
        return (
            Waypoints(f"above {name}", above[:1], speed),
            Waypoints(name, position, slow.speed),
            Waypoints(f"up from {name}", above[1:], speed),
        )

    @property
    def clearance_height(self) -> float:
        """Robot z from which the tip goes down to the canvas at painting speed."""
        return min(self.travel_height, self.calibration.highest_touch + _CLEARANCE)

    def dip(self, well: int) -> Waypoints:
        """Returns the dip into a paint well with one stirring turn. Raises WorkspaceViolation if it does not exist."""
        if not 0 <= well < len(self.workspace.wells):
            raise WorkspaceViolation(
                f"Paint well {well + 1} was wanted; the workspace has {len(self.workspace.wells)} wells; "
                "use fewer colours (--colors) or add wells to the workspace."
            )
        dip = self._circle(f"dip into well {well + 1}", self.workspace.wells[well], turns=1)
        return replace(dip, cue=("dip", str(well + 1)))

    def rinse(self) -> Waypoints:
        """Returns the motion into the water, three stirring turns, and out."""
        return self._circle("rinse", self.workspace.water, turns=_STIRS)

    def wipe(self) -> Waypoints:
        """Returns the motion across the rag: there, back, and there again."""
        x, y, z = self.workspace.rag
        half = self.workspace.rag_width / 2
        across = np.array([(x - half, y, z), (x + half, y, z)])
        position = np.concatenate([across, across[::-1], across])
        return self._from_above("wipe", position)

    def take(self, brush: str) -> Waypoints:
        """Returns the motion that takes a brush: the empty hand down onto it, out of its fork, and up.

        Raises ConfigError if the workspace has no rack, or its rack lacks the brush.
        """
        rack = self._rack
        if brush not in rack.places:
            there = ", ".join(rack.places) or "no brush"
            raise ConfigError(
                f"The rack has no brush {brush[:40]!r}; it has {there}: add it to [rack], or give one of these."
            )
        place, front = rack.places[brush], rack.front(brush)
        clear = place[0], place[1], place[2] + rack.lift
        way = self._way(f"take the {brush} brush", self._above(place), clear, place, front)
        return replace(way, cue=("change", brush))

    def put_back(self, brush: str) -> Waypoints:
        """Returns the motion that puts a brush back into its fork: the path of `take`, reversed."""
        there = self.take(brush)
        return Waypoints(f"put the {brush} brush back", there.position[::-1].copy(), there.speed)

    def change(self, held: str | None, brush: str) -> tuple[Waypoints, ...]:
        """Returns the motions that change the brush in the hand.

        held: name of the brush in the hand; "" or None for none
        Raises ConfigError if the workspace has no rack, or its rack lacks one of them.
        """
        return (*((self.put_back(held),) if held else ()), self.take(brush))

    @property
    def _rack(self) -> BrushRack:
        if self.workspace.rack is None:
            raise ConfigError("The workspace has no rack; write one ([rack]), or change the brush by hand.")
        return self.workspace.rack

    def _above(self, place: Point) -> Point:
        return place[0], place[1], self.travel_height

    def _way(self, label: str, *places: Point) -> Waypoints:
        """Returns a path through the places at painting speed, and up at the end."""
        position = np.array([*places, self._above(places[-1])], np.float64)
        return Waypoints(label, position, self.workspace.painting_speed)

    def _circle(self, label: str, center: Point, turns: int) -> Waypoints:
        angle = np.linspace(0, 2 * np.pi * turns, 12 * turns + 1)
        offset = STIR_RADIUS * np.c_[np.cos(angle), np.sin(angle), np.zeros_like(angle)]
        return self._from_above(label, np.array(center) + offset)

    def _from_above(self, label: str, position: NDArray[np.float64]) -> Waypoints:
        above = position[[0, -1]].copy()
        above[:, 2] = self.travel_height
        return Waypoints(label, np.concatenate([above[:1], position, above[1:]]), self.workspace.travel_speed)
