"""Reach: what a robot can answer whose arm does not get everywhere in its workspace."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from frida_painter.hardware.workspace import Point


class Reach(Protocol):
    """Whoever knows the arm, by inverse kinematics; asked before anything moves."""

    def reachable(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the tip can be at each place [k, 3], metres of the robot's frame, brush as it is held: [k]."""


@dataclass(frozen=True)
class ArmLength:
    """The reach of an arm of which only this is known: how near to its shoulder, and how far, its tip gets, metres."""

    shoulder: Point
    nearest: float
    farthest: float

    def reachable(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each place [k, 3] lies between the two spheres: [k]."""
        away = np.linalg.norm(position - np.array(self.shoulder), axis=1)
        return (away >= self.nearest) & (away <= self.farthest)
