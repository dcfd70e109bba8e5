"""When an arm's tip is where on a path of waypoints: no faster than motors can start and stop.

The tip stays on the path: it slows down before corners, and stops in sharp ones, as a controller in
"exact path" mode does. Speeds between are found by one pass forward and one backward over the path
(as in Bobrow, Dubowsky and Gibson, "Time-Optimal Control of Robotic Manipulators Along Specified
Paths", IJRR 1985, for limits of speed and acceleration alone).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# A corner sharper than this (radians) is a stop; in a blunter one the velocity jumps by at most _JUMP (m/s).
_SHARP = np.radians(50)
_JUMP = 0.02
_FINE = 0.002
_SHORTEST = 1e-7


@dataclass(frozen=True)
class Timing:
    """How a tip may move: acceleration (m/s2), smoothing (s) over which speed changes are spread, period (s)."""

    acceleration: float
    smoothing: float
    period: float

    def places(self, path: NDArray[np.float64], speed: NDArray[np.float64]) -> NDArray[np.float64]:
        """The tip's place [n, 3] at every period, from rest at the first to rest at the last waypoint.

        path: waypoints [k, 3] in metres; speed: of each of the pieces between them [k - 1], m/s.
        """
        path, speed = _moving(path, speed)
        if len(speed) == 0:
            return path
        fine, fastest = _fine_grained(path, speed)
        along, pace, moment = self._ramped(fine, fastest)
        reached = self._smoothed(moment, along, pace)
        return np.stack([np.interp(reached, along, column) for column in fine.T], -1)

    def seconds(self, path: NDArray[np.float64], speed: NDArray[np.float64]) -> float:
        """How long the tip takes for that path, from rest to rest; the arguments are those of `places`."""
        path, speed = _moving(path, speed)
        if len(speed) == 0:
            return 0.0
        return float(self._ramped(*_fine_grained(path, speed))[2][-1]) + self.smoothing

    def _ramped(
        self, fine: NDArray[np.float64], fastest: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Of every point of a fine-grained path: metres from its start, speed, and seconds from the start."""
        along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))]
        pace = _feasible(along, fastest, self.acceleration)
        # A step of constant acceleration takes its length over the mean of the speeds at its ends.
        return along, pace, np.r_[0.0, np.cumsum(2 * np.diff(along) / (pace[1:] + pace[:-1]))]

    def _smoothed(
        self, moment: NDArray[np.float64], along: NDArray[np.float64], pace: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Metres covered at every period, each averaged over the time around it, so that no force sets in at once."""
        width = max(1, round(self.smoothing / self.period))
        count = int(np.ceil(moment[-1] / self.period)) + 1
        time = np.arange(count) * self.period
        index = np.clip(np.searchsorted(moment, time, side="right") - 1, 0, len(moment) - 2)
        late = np.minimum(time, moment[-1]) - moment[index]
        rise = (pace[index + 1] - pace[index]) / (moment[index + 1] - moment[index])
        covered = along[index] + pace[index] * late + 0.5 * rise * late**2
        covered = np.r_[np.zeros(width - 1), covered, np.full(width, along[-1])]
        return np.clip(np.convolve(covered, np.full(width, 1 / width), "valid"), 0.0, along[-1])


def _moving(path: NDArray[np.float64], speed: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The path and its speeds without pieces that lead nowhere; of a path all of them, its end alone."""
    moving = np.linalg.norm(np.diff(path, axis=0), axis=1) > _SHORTEST
    if not moving.any():
        return path[-1:].copy(), speed[:0]
    return path[np.r_[True, moving]], speed[moving]


def _fine_grained(
    path: NDArray[np.float64], speed: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The path with points at most _FINE apart, and the greatest speed at each of them, 0 where the tip stops."""
    vector = np.diff(path, axis=0)
    length = np.linalg.norm(vector, axis=1)
    cosine = (vector[1:] * vector[:-1]).sum(1) / (length[1:] * length[:-1])
    turn = np.arccos(np.clip(cosine, -1, 1))
    jump = 2 * np.sin(turn / 2)
    at_corner = np.minimum(np.minimum(speed[1:], speed[:-1]), _JUMP / np.maximum(jump, 1e-9))
    at_corner = np.r_[0.0, np.where(turn > _SHARP, 0.0, at_corner)]
    points, fastest = [], []
    for start, way, metres, most, here in zip(path[:-1], vector, length, speed, at_corner, strict=True):
        count = max(2, int(np.ceil(metres / _FINE)))
        points.append(start + np.arange(count)[:, None] / count * way)
        fastest.append(np.r_[here, np.full(count - 1, most)])
    return np.concatenate([*points, path[-1:]]), np.concatenate([*fastest, [0.0]])


def _feasible(along: NDArray[np.float64], fastest: NDArray[np.float64], acceleration: float) -> NDArray[np.float64]:
    """Speeds that never exceed `fastest` and can be reached from one another under the acceleration."""
    gain = (2 * acceleration * np.diff(along)).tolist()
    square = (fastest**2).tolist()
    for k, more in enumerate(gain):
        square[k + 1] = min(square[k + 1], square[k] + more)
    for k in range(len(gain) - 1, -1, -1):
        square[k] = min(square[k], square[k + 1] + gain[k])
    return np.sqrt(square)
