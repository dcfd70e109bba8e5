"""What every robot can do: be connected, follow waypoints with the tip of its brush, stop."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

# Where things stand around the robot, in metres of its frame: canvas, paint wells, water, rag, and the bounds.

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


# Reach: what a robot can answer whose arm does not get everywhere in its workspace.


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


# When an arm's tip is where on a path of waypoints: no faster than motors can start and stop.
#
# The tip stays on the path: it slows down before corners, and stops in sharp ones, as a controller in
# "exact path" mode does. Speeds between are found by one pass forward and one backward over the path
# (as in Bobrow, Dubowsky and Gibson, "Time-Optimal Control of Robotic Manipulators Along Specified
# Paths", IJRR 1985, for limits of speed and acceleration alone).

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


@dataclass(frozen=True)
class Waypoints:
    """A path of the brush's tip: position [k, 3] in metres of the robot's frame (z up), at `speed` m/s.

    label says in messages what the motion is for ("stroke 12", "dip into well 3").
    """

    label: str
    position: NDArray[np.float64]
    speed: float

    @property
    def length(self) -> float:
        """Length of the path in metres."""
        return float(np.linalg.norm(np.diff(self.position, axis=0), axis=1).sum())


@dataclass(frozen=True)
class MotionReport:
    """What was really done: times in seconds of the robot's own clock, and where the tip ended [3], metres.

    left_out: whether nothing was done, because a person who paints by hand chose so.
    """

    label: str
    started_at: float
    finished_at: float
    reached: NDArray[np.float64]
    left_out: bool = False


class Robot(Protocol):
    """A driver: thin, without any knowledge of painting. Raises RobotError and its kinds.

    One whose controller states its serial number says it, once connected, as `serial_number`.
    """

    def connect(self) -> None:
        """Reaches the robot; a failed attempt leaves nothing open and may be repeated."""

    def home(self) -> MotionReport:
        """Goes where the camera sees the whole canvas."""

    def pose(self) -> NDArray[np.float64]:
        """Where the tip is now, [3] metres."""

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Moves the tip along the waypoints and returns when it has arrived."""

    def stop(self) -> None:
        """Stops at once, on a channel of its own; may be called from any thread."""

    def close(self) -> None:
        """Lets go of the robot."""


# What every camera can do: give a photograph that is newer than a given moment.


@dataclass(frozen=True)
class Frame:
    """A photograph: image [rows, columns, 3] uint8 sRGB, when it was taken (s, the robot's clock), its number."""

    image: NDArray[np.uint8]
    captured_at: float
    sequence: int


class Camera(Protocol):
    """A driver. Raises CameraError and its kinds."""

    def connect(self) -> None:
        """Reaches the camera; a failed attempt leaves nothing open and may be repeated."""

    def capture(self, newer_than: float) -> Frame:
        """A photograph taken after `newer_than` (s). Raises StaleFrame where there is none."""

    def close(self) -> None:
        """Lets go of the camera."""


@runtime_checkable
class LiveCamera(Camera, Protocol):
    """A camera that always has a picture, like a webcam, for people to watch."""

    def glance(self) -> NDArray[np.uint8]:
        """The picture that it has now, [rows, columns, 3] sRGB; nothing is decided by it. Raises CameraError."""
