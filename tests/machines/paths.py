"""Paths for drivers to follow, and what every driver must keep to."""

import numpy as np

from frida_painter.hardware.robot import Waypoints


def a_stroke(label: str = "stroke 7", speed: float = 0.06, points: int = 31) -> Waypoints:
    """30 mm of a bent stroke that comes down, presses and lifts."""
    along = np.linspace(0, 1, points)
    path = np.c_[0.1 + 0.03 * along, 0.05 + 0.004 * np.sin(np.pi * along), 0.002 - 0.004 * np.sin(np.pi * along)]
    above = path[[0, -1]] + (0, 0, 0.01)
    return Waypoints(label, np.concatenate([above[:1], path, above[1:]]), speed)


NOT_PATHS = [
    np.zeros((0, 3)),
    np.zeros((4, 2)),
    np.zeros(3),
    np.array([[0.0, 0.0, np.nan]]),
    np.array([[np.inf, 0, 0]]),
]
