"""The path that the brush's tip follows while it paints one stroke."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import PlanError
from frida_painter.strokes import Strokes

END_THICKNESS = 0.2
"""How hard the brush is pressed where a stroke starts and ends (thickness, 0 to 1)."""
_SAMPLES = 129


@dataclass(frozen=True)
class Trajectory:
    """Points of a stroke in the order in which they are reached.

    position [k, 2] metres on the canvas; thickness [k] in [0, 1], linear in the brush's height.
    """

    position: NDArray[np.float64]
    thickness: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.thickness)

    @property
    def length(self) -> float:
        """Length of the path in metres."""
        return float(_distance(self.position).sum())


def pressure(fraction: NDArray[np.float64], thickness: float) -> NDArray[np.float64]:
    """Thickness [k] at fractions [k] of the curve: the cubic Bezier 0.2, h, h, 0.2 of the paper's brush heights."""
    ends = fraction**3 + (1 - fraction) ** 3
    return END_THICKNESS * ends + thickness * (1 - ends)


def trajectory(strokes: Strokes, index: int, step: float = 0.002) -> Trajectory:
    """The cubic Bezier of stroke `index` as points at most `step` metres apart, ends included.

    The points are evenly spaced along the arc, so that a robot of constant speed deposits paint
    evenly (paper, "Brush Stroke Model"). Raises PlanError where the stroke or the step is not finite.
    """
    if not 0 < step < math.inf:
        raise PlanError(f"A step of {step} m was given for the path of a stroke; it is above 0 and finite.")
    stroke = strokes[index : index + 1] if index >= 0 else strokes[index:][:1]
    if len(stroke) != 1:
        raise PlanError(f"Stroke {index} was asked for; the plan has strokes 0 to {len(strokes) - 1}.")
    fraction = np.linspace(0, 1, _SAMPLES)
    position = _path(stroke, fraction)
    if not np.isfinite(position).all() or not np.isfinite(float(stroke.thickness)):
        raise PlanError(f"Stroke {index} has a number that is not finite; plan it anew.")
    walked = np.r_[0, np.cumsum(_distance(position))]
    points = max(2, math.ceil(walked[-1] / step) + 1)
    even = np.interp(np.linspace(0, walked[-1], points), walked, fraction) if walked[-1] > 0 else np.array([0.0, 1.0])
    return Trajectory(_path(stroke, even), pressure(even, float(stroke.thickness)))


def _path(stroke: Strokes, fraction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points [k, 2] of the one stroke's Bezier at fractions [k] of its parameter."""
    x, y = (float(part) for part in stroke.position[0])
    angle, length, bend = float(stroke.angle), float(stroke.length), float(stroke.bend)
    along, aside = fraction * length, 3 * fraction * (1 - fraction) * bend
    cos, sin = math.cos(angle), math.sin(angle)
    return np.stack((x + cos * along - sin * aside, y + sin * along + cos * aside), -1)


def _distance(position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance from each point to the next, [k - 1]."""
    return np.linalg.norm(np.diff(position, axis=0), axis=1)
