"""Protocols of robots and cameras, with the workspace, reach, timing, waypoints and frames that they use."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

# Layout around the robot, in metres of its frame: canvas, paint wells, water, rag and bounds.

Point = tuple[float, float, float]


@dataclass(frozen=True)
class BrushRack:
    """Rack with forks for brushes, each open to one side. A fork holds a brush more firmly than the robot's hand.

    places: position of the tip of each brush in its fork, by the brush's name
    slide: x and y from the fork to the point at which the brush is clear of it, metres
    lift: metres that the hand rises to be clear of a brush
    """

    places: Mapping[str, Point]
    slide: tuple[float, float]
    lift: float

    def front(self, brush: str) -> Point:
        """Returns the position of a brush's tip when the brush is clear of its fork, at the same height."""
        x, y, z = self.places[brush]
        return x + self.slide[0], y + self.slide[1], z


@dataclass(frozen=True)
class Workspace:
    """Layout of a robot's workspace: canvas, paint and tools. Lengths in metres of the robot's frame.

    lower, upper: corners of the box that the tip never leaves
    canvas_origin: the canvas's bottom-left corner on its surface
    canvas_angle: radians from the robot's x axis to the canvas's lower edge
    wells: position of the tip in each paint well
    water, rag: position of the tip in the water and on the rag
    rag_width: length of a wipe along x
    hover: height of the tip above objects while it travels
    painting_speed, travel_speed: m/s
    home: position of the tip while the camera looks; None if the robot has its own
    rack: of the brushes; None if a person changes them
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
        """Robot z of the highest object in the workspace, metres."""
        things = [self.canvas_origin[2], self.water[2], self.rag[2], *(well[2] for well in self.wells)]
        if self.rack is not None:  # the empty hand passes over a brush in its fork
            things += [place[2] + self.rack.lift for place in self.rack.places.values()]
        return max(things)

    def to_robot(self, position: NDArray[np.float64], height: NDArray[np.float64]) -> NDArray[np.float64]:
        """Converts canvas metres [k, 2] and robot heights [k] to the robot's frame [k, 3]."""
        return np.c_[position @ self._turn + np.array(self.canvas_origin[:2]), height]

    def to_canvas(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Converts positions in the robot's frame [k, 3] to canvas metres [k, 2], as seen from above."""
        return (position[:, :2] - np.array(self.canvas_origin[:2])) @ self._turn.T

    @property
    def _turn(self) -> NDArray[np.float64]:
        cos, sin = np.cos(self.canvas_angle), np.sin(self.canvas_angle)
        return np.array([[cos, sin], [-sin, cos]])


# Reach of a robot whose arm does not get to every point of its workspace.


class Reach(Protocol):
    """Reach of an arm, by inverse kinematics or by its length; checked before anything moves."""

    def reachable(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns True for each position [k, 3] in the robot's frame (m) that the tip reaches with its brush: [k]."""


@dataclass(frozen=True)
class ArmLength:
    """Reach of an arm of known length: nearest and farthest distance of the tip from the shoulder, metres."""

    shoulder: Point
    nearest: float
    farthest: float

    def reachable(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns True for each position [k, 3] between the two spheres: [k]."""
        away = np.linalg.norm(position - np.array(self.shoulder), axis=1)
        return (away >= self.nearest) & (away <= self.farthest)


# Timing of a path: the tip goes no faster than motors can start and stop.
# The tip stays on the path. It slows down before corners and stops in sharp ones, as a controller in "exact path"
# mode does. Its speeds are found by one pass forward and one backward over the path (as in Bobrow, Dubowsky and
# Gibson, "Time-Optimal Control of Robotic Manipulators Along Specified Paths", IJRR 1985, for limits of speed and
# acceleration only).

# The tip stops in a corner sharper than _SHARP (radians). In a blunter one its velocity jumps by at most _JUMP (m/s).
_SHARP = np.radians(50)
_JUMP = 0.02
_FINE = 0.002
_SHORTEST = 1e-7


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

    def _ramp(
        self, fine: NDArray[np.float64], fastest: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Returns for each point of a fine-grained path: metres from the start, speed, and seconds from the start."""
        along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))]
        pace = _feasible(along, fastest, self.acceleration)
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


def _feasible(along: NDArray[np.float64], fastest: NDArray[np.float64], acceleration: float) -> NDArray[np.float64]:
    """Returns speeds that are at most `fastest` and reachable from one another under the acceleration."""
    gain = (2 * acceleration * np.diff(along)).tolist()
    square = (fastest**2).tolist()
    for k, more in enumerate(gain):
        square[k + 1] = min(square[k + 1], square[k] + more)
    for k in range(len(gain) - 1, -1, -1):
        square[k] = min(square[k], square[k + 1] + gain[k])
    return np.sqrt(square)


@dataclass(frozen=True)
class Waypoints:
    """Path of the brush's tip.

    label: purpose of the motion in messages ("stroke 12", "dip into well 3")
    position: waypoints [k, 3] in metres of the robot's frame, z up
    speed: m/s
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
    """Result of a motion.

    started_at, finished_at: seconds of the robot's own clock
    reached: final position of the tip [3], metres
    left_out: True if a person who paints by hand chose not to make the motion
    """

    label: str
    started_at: float
    finished_at: float
    reached: NDArray[np.float64]
    left_out: bool = False


class Robot(Protocol):
    """Driver of a robot. It knows nothing of painting. Raises RobotError and its subclasses.

    If the controller states its serial number, the driver has it as `serial_number` once connected.
    """

    def connect(self) -> None:
        """Connects to the robot. A failed attempt leaves nothing open and may be repeated."""

    def home(self) -> MotionReport:
        """Moves to the home position, from which the camera sees the whole canvas."""

    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres."""

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Moves the tip along the waypoints and returns when it has arrived."""

    def stop(self) -> None:
        """Stops at once, over a separate channel; may be called from any thread."""

    def close(self) -> None:
        """Disconnects from the robot."""


# Cameras: each gives a photograph that is newer than a given moment.


@dataclass(frozen=True)
class Frame:
    """Photograph with its time and number.

    image: [rows, columns, 3] uint8 sRGB
    captured_at: seconds of the robot's clock
    sequence: number of the photograph
    """

    image: NDArray[np.uint8]
    captured_at: float
    sequence: int


class Camera(Protocol):
    """Driver of a camera. Raises CameraError and its subclasses."""

    def connect(self) -> None:
        """Connects to the camera. A failed attempt leaves nothing open and may be repeated."""

    def capture(self, newer_than: float) -> Frame:
        """Returns a photograph taken after `newer_than` (s). Raises StaleFrame if there is none."""

    def close(self) -> None:
        """Disconnects from the camera."""


@runtime_checkable
class LiveCamera(Camera, Protocol):
    """Camera that always has a picture to watch, like a webcam."""

    def glance(self) -> NDArray[np.uint8]:
        """Returns the current picture [rows, columns, 3] sRGB, for display only. Raises CameraError."""
