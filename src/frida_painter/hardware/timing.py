"""Timing of a path: how fast a tip goes along it, from rest to rest, under the limits of its machine."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import ConfigError

# The tip goes no faster than motors can start and stop.
# The tip stays on the path. It slows down before corners and stops in sharp ones, as a controller in "exact path"
# mode does. Its speeds are found by one pass forward and one backward over the path (as in Bobrow, Dubowsky and
# Gibson, "Time-Optimal Control of Robotic Manipulators Along Specified Paths", IJRR 1985, for limits of speed and
# acceleration only).

# The tip stops in a corner sharper than _SHARP (radians). In a blunter one its velocity jumps by at most _JUMP (m/s).
_SHARP = np.radians(50)
_JUMP = 0.02
_FINE = 0.002
_SHORTEST = 1e-7
_LANDING = 0.001  # metres of a servo's step while it lowers the brush


@dataclass(frozen=True)
class Timing:
    """Limits on the motion of a tip.

    acceleration: greatest acceleration, m/s2
    smoothing: seconds over which changes of speed are spread
    period: seconds between two positions
    """

    acceleration: float
    smoothing: float
    period: float

    def places(self, path: NDArray[np.float64], speed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the tip's position [n, 3] at every period, from rest at the first to rest at the last waypoint.

        path: waypoints [k, 3] in metres
        speed: of each segment between them [k - 1], m/s
        """
        path, speed = _moving(path, speed)
        if len(speed) == 0:
            return path
        fine, fastest = _subdivide(path, speed)
        along, pace, moment = self._ramp(fine, fastest)
        reached = self._smooth(moment, along, pace)
        return np.stack([np.interp(reached, along, column) for column in fine.T], -1)

    def seconds(self, path: NDArray[np.float64], speed: NDArray[np.float64]) -> float:
        """Returns the duration of a path from rest to rest; the arguments are those of `places`."""
        path, speed = _moving(path, speed)
        if len(speed) == 0:
            return 0.0
        return float(self._ramp(*_subdivide(path, speed))[2][-1]) + self.smoothing

    def tell(self, fastest: float, rest: float) -> "AxisTiming":
        """Returns these limits as those of a machine with axes along x, y and z.

        fastest: m/s of the tip
        rest: seconds that a motion takes beyond its smoothing, until the tip is known to stand
        """
        gain = self.acceleration
        return AxisTiming(
            (fastest,) * 3, (gain,) * 3, jerk=(_JUMP,) * 3, along=gain, sharp=_SHARP, between=self.smoothing + rest
        )

    def _ramp(
        self, fine: NDArray[np.float64], fastest: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Returns for each point of a fine-grained path: metres from the start, speed, and seconds from the start."""
        along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))]
        pace = np.sqrt(_feasible(fastest**2, 2 * self.acceleration * np.diff(along)))
        # At constant acceleration, a segment takes its length over the mean of the speeds at its ends.
        return along, pace, np.r_[0.0, np.cumsum(2 * np.diff(along) / (pace[1:] + pace[:-1]))]

    def _smooth(
        self, moment: NDArray[np.float64], along: NDArray[np.float64], pace: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Returns the distance covered at every period. A moving average lets forces set in gradually."""
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
    """Returns path and speeds without segments of length 0; of a path without motion, only its end."""
    moving = np.linalg.norm(np.diff(path, axis=0), axis=1) > _SHORTEST
    if not moving.any():
        return path[-1:].copy(), speed[:0]
    return path[np.r_[True, moving]], speed[moving]


def _subdivide(
    path: NDArray[np.float64], speed: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the path with points at most _FINE apart, and the greatest speed at each; 0 if the tip stops there."""
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


def _feasible(square: NDArray[np.float64], reach: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the squares of speeds [k] that are at most `square` [k] and reachable from one another.

    reach: difference of the squares [k - 1] that an acceleration makes between two points: twice its product with
        their distance
    """
    most, gain = square.tolist(), reach.tolist()
    for k, more in enumerate(gain):
        most[k + 1] = min(most[k + 1], most[k] + more)
    for k in range(len(gain) - 1, -1, -1):
        most[k] = min(most[k], most[k + 1] + gain[k])
    return np.array(most)


@dataclass(frozen=True)
class ServoTiming:
    """Timing of a servo that raises and lowers the brush while the machine waits.

    speed: m/s of the servo
    lower, lift: greatest speed down and up, m/s; None for that of the servo: lowered in steps all the same, because
        a brush that falls makes blots, and lifted at once
    base, level: heights that differ are those with another whole number of `level` metres above `base`
    tick: seconds; the machine waits for multiples of it
    each: seconds that each setting of the servo takes besides the wait
    stops: True if the machine stands still at each waypoint at which the height changes
    """

    speed: float
    lower: float | None = None
    lift: float | None = None
    base: float = 0.0
    level: float = 1e-6
    tick: float = 0.001
    each: float = 0.0
    stops: bool = True

    def steps(self, before: float, height: float) -> list[tuple[float, float]]:
        """Returns the heights in metres that the servo is set to, each with the seconds of the wait after it."""
        far = abs(height - before)
        speed = (self.lower or self.speed) if height < before else self.lift
        count = 1 if speed is None else max(math.ceil(far / _LANDING - 1e-9), 1)
        seconds = max(far / count / (speed or self.speed), 0.0 if count > 1 else 0.01)
        wait = math.ceil(seconds / self.tick - 1e-6) * self.tick
        return [(before + (height - before) * k / count if k < count else height, wait) for k in range(1, count + 1)]

    def seconds(self, before: float, height: float) -> float:
        """Returns the duration of a change of the height."""
        return sum(wait + self.each for _, wait in self.steps(before, height))

    def changes(self, height: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns for heights [k] in metres between which of them [k - 1] the servo is set anew."""
        return np.asarray(np.diff(np.rint((height - self.base) / self.level)) != 0)


@dataclass(frozen=True)
class AxisTiming:
    """Limits on the motion of a machine, as its controller states them: greatest speed and acceleration of each axis.

    Default: three axes along x, y and z of the robot's frame.

    speed: m/s of each axis
    acceleration: m/s2 of each axis; infinite if an axis needs no time to change its speed
    axes: direction of each axis; the speed of an axis is the tip's velocity times this vector
    deviation: metres that a corner would be rounded by the centripetal acceleration that the tip may have in it
        (junction deviation of GRBL and Marlin); with 0 the tip stops in every corner
    jerk: m/s by which the speed of each axis may jump in a corner (Marlin's classic jerk), instead of a deviation
    along: greatest acceleration along the path, m/s2 (M204 of Marlin)
    between: seconds between two motions: the machine settles and is asked for its position

    servo: timing of a servo in place of the axis z; None without
    sharp: radians of a corner in which the tip stops, 0 to pi

    Raises ConfigError if a number is not allowed.
    """

    speed: tuple[float, ...]
    acceleration: tuple[float, ...]
    axes: tuple[tuple[float, float, float], ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    deviation: float = 0.0
    jerk: tuple[float, ...] | None = None
    along: float = math.inf
    between: float = 0.0
    servo: ServoTiming | None = None
    sharp: float = math.pi

    def __post_init__(self) -> None:
        lists = (self.speed, self.acceleration, self.speed if self.jerk is None else self.jerk)
        if any(len(numbers) != len(self.axes) for numbers in lists) or not all(
            number > 0 for numbers in (self.speed, self.acceleration) for number in numbers
        ):
            raise ConfigError(
                f"A machine with {len(self.axes)} axes was given the speeds {self.speed} m/s and the accelerations "
                f"{self.acceleration} m/s2; each axis needs one of both above 0."
            )
        if not (min(self.deviation, self.between, *(self.jerk or (0.0,))) >= 0 and self.along > 0 and self.sharp >= 0):
            raise ConfigError(
                f"A machine was given a deviation of {self.deviation} m, a jerk of {self.jerk} m/s, {self.along} m/s2 "
                f"along the path and {self.between} s between motions; none is below 0."
            )

    def limit_speeds(self, way: NDArray[np.float64], speed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the speeds [k] in m/s that the tip reaches on straight ways [k, 3] if `speed` [k] is wanted."""
        return np.minimum(speed, self._least(_unit(way), self.speed))

    def seconds(self, path: NDArray[np.float64], speed: NDArray[np.float64]) -> float:
        """Returns the duration of a path from rest to rest, without `between`.

        path: waypoints [k, 3] in metres
        speed: wanted on each segment between them [k - 1], m/s
        """
        if self.servo is None:
            return self._level_seconds(path, speed)
        if len(path) > 1:  # it goes to the first waypoint with the brush up
            top = max(path[0, 2], path[1, 2])
            path = np.r_[path[:1], [[*path[0, :2], top], [*path[1, :2], top]], path[1:]]
            speed = np.r_[speed[:1], speed[:1], speed]
        level = path * (1.0, 1.0, 0.0)
        here = np.linalg.norm(np.diff(level, axis=0), axis=1) <= _SHORTEST
        changes = self.servo.changes(path[:, 2])
        total, start = 0.0, 0
        for k in np.flatnonzero(changes & (here | self.servo.stops)).tolist():  # it rests at these
            total += self._level_seconds(level[start : k + 1], speed[start:k])
            total += self.servo.seconds(path[k, 2], path[k + 1, 2]) if here[k] else self.servo.each
            start = k
        return total + self._level_seconds(level[start:], speed[start:])

    def _level_seconds(self, path: NDArray[np.float64], speed: NDArray[np.float64]) -> float:
        path, speed = _moving(path, speed)
        if len(speed) == 0:
            return 0.0
        length = np.linalg.norm(np.diff(path, axis=0), axis=1)
        entry, peak, gain = self.ramps(path, speed)
        square = entry**2
        ramps = (2 * peak - entry[:-1] - entry[1:]) / gain
        ramped = np.where(np.isinf(gain), 0.0, (2 * peak**2 - square[:-1] - square[1:]) / (2 * gain))
        return float((ramps + np.maximum(length - ramped, 0.0) / peak).sum())

    def ramps(
        self, path: NDArray[np.float64], speed: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Returns the speeds of a motion from rest to rest: a ramp up, a constant speed and a ramp down per segment.

        path: waypoints [k, 3] in metres, each apart from the one before
        speed: wanted on each segment between them [k - 1], m/s

        Returns the speed at each waypoint [k] and the greatest on each segment [k - 1] in m/s, and the acceleration
        along it [k - 1] in m/s2.
        """
        vector = np.diff(path, axis=0)
        length, unit = np.linalg.norm(vector, axis=1), _unit(vector)
        fastest = self.limit_speeds(vector, speed)
        gain = np.minimum(self._least(unit, self.acceleration), self.along)  # m/s2 along each segment
        corner = np.minimum(self._corners(unit), np.minimum(fastest[1:], fastest[:-1]))
        square = _feasible(np.r_[0.0, corner**2, 0.0], 2 * gain * length)
        peak = np.minimum(fastest, np.sqrt(gain * length + (square[:-1] + square[1:]) / 2))
        return np.sqrt(square), peak, gain

    def _corners(self, unit: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the greatest speed in each corner between unit vectors [k, 3]: [k - 1], m/s."""
        turn = unit[1:] - unit[:-1]
        if self.jerk is not None:
            stops = (unit[1:] * unit[:-1]).sum(1) < math.cos(self.sharp)
            return np.where(stops, 0.0, self._least(turn, self.jerk))
        # A circle through both segments that leaves the corner by `deviation` is passed at this speed (S. Jeon,
        # "Improving Grbl: Cornering Algorithm", 2011).
        half = np.sqrt(np.clip((1 + (unit[1:] * unit[:-1]).sum(1)) / 2, 0, 1))  # sine of half the angle at the corner
        sharp, straight = half < 1e-3, half > 1 - 1e-6
        with np.errstate(divide="ignore", invalid="ignore"):
            radius = self.deviation * half / (1 - half)
            speed = np.sqrt(np.minimum(self._least(_unit(turn), self.acceleration), self.along) * radius)
        return np.where(sharp, 0.0, np.where(straight, np.inf, speed))

    def _least(self, vector: NDArray[np.float64], limit: tuple[float, ...]) -> NDArray[np.float64]:
        """Returns for each vector [k, 3] the factor [k] at which the first axis is at its limit."""
        share = np.abs(vector @ np.array(self.axes, np.float64).T)  # [k, axes]
        with np.errstate(divide="ignore"):
            return (np.array(limit, np.float64) / np.maximum(share, 1e-12)).min(1)


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-12)


def motion_seconds(timing: AxisTiming | None, path: NDArray[np.float64], speed: float) -> float:
    """Returns the duration of a motion through a path [k, 3] (m) at `speed` m/s, with the time between two motions.

    timing: limits of the machine; None if they are not known, then it always moves at full speed
    """
    if timing is None:
        return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) / speed
    return timing.seconds(path, np.full(len(path) - 1, speed)) + timing.between


# Limits of a machine's travel, as its controller tells them.


_TOLERANCE = 1e-5  # metres: controllers round to hundredths of a millimetre


@dataclass(frozen=True)
class TravelLimits:
    """Limits within which a machine keeps its tip by itself, as its controller tells them (soft limits, endstops).

    lower, upper: corners in metres of the robot's frame; infinite along an axis without a limit
    zero_known: False if only the distance between the corners can be trusted, because the zero is not known
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    zero_known: bool = True

    def describe(self, axis: int) -> str:
        """Returns the limits along an axis, as part of a sentence."""
        low, high = 1000 * self.lower[axis], 1000 * self.upper[axis]
        return f"{low:.1f} to {high:.1f} mm" if self.zero_known else f"{high - low:.1f} mm of travel"

    def beyond(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns True for each coordinate of positions [k, 3] (m) that is beyond the limits: [k, 3].

        If the zero is not known, all coordinates along an axis are beyond if together they need more travel than
        there is.
        """
        lower, upper = np.array(self.lower) - _TOLERANCE, np.array(self.upper) + _TOLERANCE
        if not self.zero_known:
            within = np.ptp(position, axis=0) <= upper - lower
            return np.broadcast_to(~within, position.shape)
        return ~((position >= lower) & (position <= upper))
