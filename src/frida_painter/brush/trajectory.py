"""The path that the brush's tip follows while it paints one stroke."""

import math

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import PlanError
from frida_painter.strokes import Strokes

END_THICKNESS = 0.2
"""How hard the brush is pressed where a stroke starts and ends (thickness, 0 to 1)."""
_SAMPLES = 513


def pressure(fraction: NDArray[np.float64], thickness: float) -> NDArray[np.float64]:
    """Thickness [k] at fractions [k] of the curve: the cubic Bezier 0.2, h, h, 0.2 of the paper's brush heights."""
    ends = fraction**3 + (1 - fraction) ** 3
    return END_THICKNESS * ends + thickness * (1 - ends)


def stroke_path(strokes: Strokes, index: int, step: float = 0.002) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The cubic Bezier of stroke `index` as points at most `step` metres apart, ends included.

    Returns the position [k, 2] in metres on the canvas and the thickness [k] in [0, 1], which is
    linear in the brush's height. The points are evenly spaced along the arc (paper, "Brush Stroke
    Model"). Raises PlanError where there is no such stroke, or it or the step is not finite.
    """
    if not 0 < step < math.inf:
        raise PlanError(f"A step of {step} m was given for the path of a stroke; it is above 0 and finite.")
    if not 0 <= index < len(strokes):
        raise PlanError(f"Stroke {index} was asked for; there are {len(strokes)}, and the first is stroke 0.")
    stroke = strokes[index : index + 1].to("cpu")
    fraction = np.linspace(0, 1, _SAMPLES)
    position = _points(stroke, fraction)
    if not np.isfinite(position).all() or not math.isfinite(float(stroke.thickness)):
        raise PlanError(f"Stroke {index} has a number that is not finite; plan it anew.")
    walked = np.r_[0, np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=1))]
    # The curve is measured by chords, which are a little shorter than it: a slightly smaller step keeps the promise.
    count = max(2, math.ceil(1.002 * walked[-1] / step) + 1)
    even = np.interp(np.linspace(0, walked[-1], count), walked, fraction) if walked[-1] > 0 else np.array([0.0, 1.0])
    return _points(stroke, even), pressure(even, float(stroke.thickness))


def _points(stroke: Strokes, fraction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points [k, 2] of the one stroke's Bezier at fractions [k] of its parameter."""
    x, y = (float(part) for part in stroke.position[0])
    angle, length, bend = float(stroke.angle), float(stroke.length), float(stroke.bend)
    along, aside = fraction * length, 3 * fraction * (1 - fraction) * bend
    cos, sin = math.cos(angle), math.sin(angle)
    return np.stack((x + cos * along - sin * aside, y + sin * along + cos * aside), -1)
