"""A motion as an EiBotBoard wants it: small straight pieces in whole steps and milliseconds, with soft ends."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frida_painter.hardware.robot import Waypoints

STEPS_PER_MM = 80
"""Of AxiDraws at a sixteenth of a motor's step: 2032 per inch."""
_PIECE = 0.001  # metres
_LONGEST = 0.05  # seconds: what the board does after a stop is no more than the piece that it is at
_SLOWEST = 0.004  # m/s, where a path begins and ends


@dataclass(frozen=True)
class Move:
    """A piece of a motion: steps (right, towards you) in so many seconds, with the tip at a height (m) at its end."""

    waypoint: int
    steps: tuple[int, int]
    seconds: float
    height: float


def moves(here: NDArray[np.float64], waypoints: Waypoints, approach: float, acceleration: float) -> Iterator[Move]:
    """The pieces from `here` [3], metres, to the first waypoint at `approach` m/s and on through all of them.

    Each way between two stands begins and ends slowly and gains `acceleration` m/s2 in between. Steps
    are counted from the zero of the robot's frame, so that rounding never adds up.
    """
    at = _steps(here)
    path = np.concatenate([here[None], waypoints.position])
    level = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1)  # [k]
    for first, last in _ways(level):
        walked = np.r_[0, np.cumsum(level[first:last])]
        speed = np.array([approach if index == 0 else waypoints.speed for index in range(first, last)])
        for index in range(first, last):
            start, end = walked[index - first], walked[index - first + 1]
            count = max(1, math.ceil((end - start) / _PIECE))
            for piece in range(count):
                low, high = (start + (end - start) * (piece + part) / count for part in (0, 1))
                middle = (low + high) / 2
                pace = min(speed[index - first], math.sqrt(2 * acceleration * min(middle, walked[-1] - middle)))
                share = (piece + 1) / count
                place = path[index] + share * (path[index + 1] - path[index])
                there = _steps(place)
                steps = (there[0] - at[0], there[1] - at[1])
                seconds = (high - low) / max(pace, _SLOWEST) if high > low else 0.0
                yield from _split(Move(index, steps, seconds, float(place[2])))
                at = there


def _ways(level: NDArray[np.float64]) -> Iterator[tuple[int, int]]:
    """Runs [first, last) of segments between two stands: those that only rise or sink stand alone."""
    first = 0
    for index, length in enumerate(level):
        if index == 0 or length < 1e-9 or level[index - 1] < 1e-9:
            if index > first:
                yield first, index
            first = index
    yield first, len(level)


def _split(move: Move) -> Iterator[Move]:
    """The same move in parts that none last longer than a stop may wait."""
    count = max(1, math.ceil(move.seconds / _LONGEST))
    done = (0, 0)
    for part in range(1, count + 1):
        now = (round(move.steps[0] * part / count), round(move.steps[1] * part / count))
        yield Move(move.waypoint, (now[0] - done[0], now[1] - done[1]), move.seconds / count, move.height)
        done = now


def _steps(place: NDArray[np.float64]) -> tuple[int, int]:
    """Steps to the right and towards you of a place in the robot's frame (y away from you)."""
    return round(1000 * STEPS_PER_MM * float(place[0])), round(-1000 * STEPS_PER_MM * float(place[1]))
