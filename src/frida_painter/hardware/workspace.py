"""Where things stand around the robot, in metres of its frame: canvas, paint wells, water, rag, and the bounds."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Workspace:
    """The place in which a robot paints.

    lower, upper: corners of the box that the tip never leaves; canvas_origin: the canvas's
    bottom-left corner on its surface; canvas_angle: radians from the robot's x axis to the canvas's
    lower edge; wells: the tip's place in each paint well; water, rag: likewise; rag_width: how far
    one wipes along x; hover: height of the tip above things while it travels; painting_speed,
    travel_speed: m/s; home: where the tip waits while the camera looks, None where the robot knows
    a home of its own.
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

    @property
    def top(self) -> float:
        """Robot z of the highest thing that stands there, metres."""
        return max(place[2] for place in (self.canvas_origin, *self.wells, self.water, self.rag))

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
