"""Faults of the studio, for tests; none happens unless it is requested."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Bump:
    """Knock against the canvas, at the first motion after `before_touch` contacts with it.

    shift: metres in the canvas's plane.
    turn: radians about the canvas's centre.
    """

    before_touch: int
    shift: tuple[float, float]
    turn: float = 0.0


class _OfPhotographs:
    first: int
    last: int | None

    def concerns(self, photograph: int) -> bool:
        """Returns True if the fault is in that photograph."""
        return self.first <= photograph and (self.last is None or photograph <= self.last)


@dataclass(frozen=True)
class LostFocus(_OfPhotographs):
    """Blur of the photographs `first` to `last` (None: all later ones).

    blur: standard deviation of the blur, share of the photograph's width; 0.005 is 8 of 1600 pixels.
    """

    first: int
    last: int | None = None
    blur: float = 0.005


@dataclass(frozen=True)
class LightChange:
    """Change of the light from the photograph `first` on, until the next change.

    gain: factor of the three channels, relative to the first light of the studio. A cloud: all below 1; an evening
    lamp: less blue.
    lean: additional brightness of the photograph's (right, lower) edge, share of the light in the middle.
    """

    first: int
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    lean: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class InSight(_OfPhotographs):
    """Hand or glare over the canvas in the photographs `first` to `last` (None: all later ones).

    place: position of the palm or of the glare's middle, (across, down) as shares of the photograph.
    """

    what: Literal["hand", "glare"]
    first: int
    last: int | None = None
    place: tuple[float, float] = (0.55, 0.5)


@dataclass(frozen=True)
class FailedMotion:
    """Error of motion `motion`: it ends at its waypoint `waypoint` with the robot's error `code`."""

    motion: int
    waypoint: int
    code: int


@dataclass(frozen=True)
class Faults:
    """Faults of the studio by number, counted from 0 since the studio was opened.

    dropped_touches: contacts in which the brush does not reach the canvas.
    bumps: knocks against the canvas.
    dry_dips: dips into an empty well.

    stuck_motions: motions that end half way; the report says so.
    lying_motions: motions that end half way; only the pose says so.
    slow_motions: motions that take ten times as long.
    failed_motions: motions that end with an error.
    protective_stops: motions that meet resistance half way; the robot then stops by itself.
    hanging_motions: motions whose call never returns.
    dead_from_motion: number of the motion from which the robot no longer answers (RobotDisconnected).
    unknown_pose: True if the robot does not know its pose.

    stale_photographs: captures that return the last photograph again.
    frozen_photographs: captures that return the last picture as a new photograph.
    failed_photographs: captures that the camera does not answer (CameraError).
    lost_focus, light_changes, in_sight: faults of focus, light and view.
    """

    dropped_touches: frozenset[int] = frozenset()
    bumps: tuple[Bump, ...] = ()
    stale_photographs: frozenset[int] = frozenset()
    stuck_motions: frozenset[int] = frozenset()
    lying_motions: frozenset[int] = frozenset()
    slow_motions: frozenset[int] = frozenset()
    failed_motions: tuple[FailedMotion, ...] = ()
    protective_stops: frozenset[int] = frozenset()
    hanging_motions: frozenset[int] = frozenset()
    dead_from_motion: int | None = None
    unknown_pose: bool = False
    dry_dips: frozenset[int] = frozenset()
    lost_focus: tuple[LostFocus, ...] = ()
    light_changes: tuple[LightChange, ...] = ()
    in_sight: tuple[InSight, ...] = ()
    frozen_photographs: frozenset[int] = frozenset()
    failed_photographs: frozenset[int] = frozenset()

    def blur_of(self, photograph: int) -> float:
        """Returns the blur of that photograph, share of its width; 0 if it is sharp."""
        return max((lost.blur for lost in self.lost_focus if lost.concerns(photograph)), default=0.0)

    def light_of(self, photograph: int) -> LightChange:
        """Returns the light of that photograph."""
        so_far = [change for change in self.light_changes if change.first <= photograph]
        return max(so_far, key=lambda change: change.first, default=LightChange(0))


NO_FAULTS = Faults()


# Placement of the canvas, which is a little off on every easel.


@dataclass(frozen=True)
class PlacementError:
    """Offset of the canvas from the place where the robot expects it.

    shift: metres along the canvas's x and y.
    turn: radians counter-clockwise about its centre.
    """

    shift: tuple[float, float]
    turn: float

    @classmethod
    def sample(cls, random: np.random.Generator) -> "PlacementError":
        """Returns a usual error: about 2 mm in a random direction, and a turn of about 0.4 degrees."""
        direction, size = random.uniform(0, 2 * math.pi), random.uniform(0.0015, 0.0025)
        turn = math.radians(random.uniform(0.3, 0.5)) * random.choice((-1, 1))
        return cls((size * math.cos(direction), size * math.sin(direction)), float(turn))

    def displace(self, position: NDArray[np.float64], center: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns canvas positions [k, 2] with the error."""
        return (position - center) @ self._rotation() + center + self.shift

    def undone(self, position: NDArray[np.float64], center: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns canvas positions [k, 2] without the error."""
        return (position - center - self.shift) @ self._rotation().T + center

    def _rotation(self) -> NDArray[np.float64]:
        cos, sin = math.cos(self.turn), math.sin(self.turn)
        return np.array([[cos, sin], [-sin, cos]])
