"""What carries the brush's tip in the studio: an arm gets a way to go, and tells the way it really went."""

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from frida_painter.hardware.timing import Timing

# In its own pace an arm heeds a stop this often, s.
_SLICE = 0.005


@dataclass(frozen=True)
class Way:
    """What an arm is asked to do: a polyline [k, 3] in metres from where the tip is.

    The first piece, towards the first waypoint, is gone at `travel_speed` m/s, the others at `speed`.
    label says in messages what it is for.
    """

    label: str
    path: NDArray[np.float64]
    speed: float
    travel_speed: float

    def to_waypoint(self, number: int) -> "Way":
        """What of it leads to waypoint `number`; the first point of the path is where the tip was."""
        return replace(self, path=self.path[: number + 2])

    def when(self) -> NDArray[np.float64]:
        """Seconds after the start [k] at which each point is reached by a tip that always has its full speed."""
        legs = np.linalg.norm(np.diff(self.path, axis=0), axis=1) / self.speeds()
        return np.concatenate([[0.0], np.cumsum(legs)])

    def speeds(self) -> NDArray[np.float64]:
        """The speed asked for [k - 1] on each piece, m/s."""
        return np.r_[self.travel_speed, np.full(len(self.path) - 2, self.speed)]


@dataclass(frozen=True)
class Course:
    """What the tip really did: its places [n, 3] in metres, how many seconds that took, whether it was stopped.

    An arm with joints also tells, for each of these places, where the tip was meant to be at that
    moment, and the angles of its joints [n, joints] (rad); these moments are then evenly spaced.
    """

    places: NDArray[np.float64]
    seconds: float
    stopped: bool = False
    meant: NDArray[np.float64] | None = None
    angles: NDArray[np.float64] | None = None


class Watcher(Protocol):
    """Whoever looks on while an arm works."""

    def open(self) -> None:
        """Gets ready, before anything moves."""

    def watch(self, course: Course) -> None:
        """Sees a motion that has just been made, with what it left on the canvas."""

    def close(self) -> None:
        """Has seen enough."""


class Nobody:
    """Looks on where nobody does."""

    def open(self) -> None:
        """Needs nothing."""

    def watch(self, course: Course) -> None:
        """Sees nothing."""

    def close(self) -> None:
        """Nothing was seen."""


class Arm(Protocol):
    """An arm of the studio; it knows nothing of painting, and time only passes in it while it moves."""

    def connect(self, tip: NDArray[np.float64]) -> None:
        """Takes its posture with the tip there [3], or as it was remembered. Raises RobotError where it cannot."""

    def move(self, way: Way, stopped: threading.Event, pace: float) -> Course:
        """Goes that way, each second of it in `pace` seconds of the world's, 0 as fast as can be computed.

        Once `stopped` is set it brakes at once, and the course ends where it came to rest. Raises
        WorkspaceViolation, without moving, where it cannot go that way.
        """

    def state(self) -> Sequence[float]:
        """All that the next motion follows from, beside where the tip is; empty where nothing does."""

    def remember(self, state: Sequence[float]) -> None:
        """Takes up, when it is connected next, from that state."""

    def close(self) -> None:
        """Lets go of what `connect` took."""


class FreeArm:
    """Carries the tip exactly along its way, as no real arm does.

    timing: how it starts and stops; None: it always has the speed asked for.
    """

    def __init__(self, timing: Timing | None = None) -> None:
        self._timing = timing

    def connect(self, tip: NDArray[np.float64]) -> None:
        """There is nothing to be done."""

    def move(self, way: Way, stopped: threading.Event, pace: float) -> Course:
        """Goes that way; where it takes no time there is none to be stopped in."""
        path, when = self._schedule(way)
        if pace > 0:
            began = time.monotonic()
            while (gone := (time.monotonic() - began) / pace) < when[-1]:
                if stopped.wait(min(_SLICE, (when[-1] - gone) * pace)):
                    return _until((time.monotonic() - began) / pace, path, when)
        return Course(path, float(when[-1]))

    def state(self) -> Sequence[float]:
        """Nothing beside the tip."""
        return ()

    def remember(self, state: Sequence[float]) -> None:
        """There is nothing to be remembered."""

    def close(self) -> None:
        """There is nothing to let go of."""

    def _schedule(self, way: Way) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Points [k, 3] of the way, and when (s) [k] the tip is there."""
        if self._timing is None:
            return way.path, way.when()
        places = self._timing.places(way.path, way.speeds())
        return places, np.asarray(np.arange(len(places)) * self._timing.period, np.float64)


def _until(seconds: float, path: NDArray[np.float64], when: NDArray[np.float64]) -> Course:
    """What of a path, whose points are reached at `when`, is done by a stop after that time."""
    seconds = min(seconds, float(when[-1]))
    done = when < seconds
    here = [np.interp(seconds, when, column) for column in path.T]
    return Course(np.concatenate([path[done], [here]]), seconds, stopped=True)
