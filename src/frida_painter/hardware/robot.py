"""What every robot can do: be connected, follow waypoints with the tip of its brush, stop."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


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
