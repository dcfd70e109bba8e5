"""Where things stand around the robot, in metres of its frame: canvas, paint wells, water, rag, and the bounds."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float, float]


@dataclass(frozen=True)
class BrushRack:
    """Forks in which brushes stand, each open to one side; the robot's hand holds a brush less firmly than its fork.

    places: where the tip is of each brush that stands in its fork, by the brush's name; slide: x and y, metres,
    from there to where the brush is clear of its fork; lift: metres that the hand rises to be clear of a brush.
    """

    places: Mapping[str, Point]
    slide: tuple[float, float]
    lift: float

    def front(self, brush: str) -> Point:
        """Where the tip of a brush is when it is clear of its fork, and still as low."""
        x, y, z = self.places[brush]
        return x + self.slide[0], y + self.slide[1], z


@dataclass(frozen=True)
class Workspace:
    """The place in which a robot paints.

    lower, upper: corners of the box that the tip never leaves; canvas_origin: the canvas's
    bottom-left corner on its surface; canvas_angle: radians from the robot's x axis to the canvas's
    lower edge; wells: the tip's place in each paint well; water, rag: likewise; rag_width: how far
    one wipes along x; hover: height of the tip above things while it travels; painting_speed,
    travel_speed: m/s; home: where the tip waits while the camera looks, None where the robot knows
    a home of its own; rack: where the robot finds its brushes, None where a person changes them.
    """

    lower: Point
    upper: Point
    canvas_origin: Point
    canvas_angle: float
    wells: tuple[Point, ...]
    water: Point
    rag: Point
    rag_width: float
    hover: float
    painting_speed: float
    travel_speed: float
    home: Point | None = None
    rack: BrushRack | None = None

    @property
    def top(self) -> float:
        """Robot z of the highest thing that stands there, metres."""
        things = [self.canvas_origin[2], self.water[2], self.rag[2], *(well[2] for well in self.wells)]
        if self.rack is not None:  # over a brush in its fork the empty hand passes free of it
            things += [place[2] + self.rack.lift for place in self.rack.places.values()]
        return max(things)

    def to_robot(self, position: NDArray[np.float64], height: NDArray[np.float64]) -> NDArray[np.float64]:
        """Canvas metres [k, 2] and robot heights [k] to the robot's frame [k, 3]."""
        return np.c_[position @ self._turn + np.array(self.canvas_origin[:2]), height]

    def to_canvas(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Places in the robot's frame [k, 3], seen from above, in canvas metres [k, 2]."""
        return (position[:, :2] - np.array(self.canvas_origin[:2])) @ self._turn.T

    @property
    def _turn(self) -> NDArray[np.float64]:
        cos, sin = np.cos(self.canvas_angle), np.sin(self.canvas_angle)
        return np.array([[cos, sin], [-sin, cos]])
