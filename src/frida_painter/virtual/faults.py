"""What can go wrong in the studio, on demand; nothing does unless it is asked for."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Bump:
    """Somebody knocks against the canvas with the first motion after `before_touch` contacts with it.

    shift: metres in the canvas's plane; turn: radians about the canvas's centre.
    """

    before_touch: int
    shift: tuple[float, float]
    turn: float = 0.0


@dataclass(frozen=True)
class LostFocus:
    """The camera is out of focus in the photographs `first` to `last` (None: for good).

    blur: standard deviation of what a point becomes, share of the photograph's width; 0.005 are 8 of
    1600 pixels.
    """

    first: int
    last: int | None = None
    blur: float = 0.005

    def concerns(self, photograph: int) -> bool:
        """Whether that photograph is out of focus."""
        return self.first <= photograph and (self.last is None or photograph <= self.last)


@dataclass(frozen=True)
class LightChange:
    """The light is another one from the photograph `first` on, until the next change.

    gain: of the three bands, against the light that the studio was opened with (a cloud: all below
    1; the evening's lamp: less blue); lean: how much brighter than the middle the photograph's
    (right, lower) edge is, share of the light there.
    """

    first: int
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    lean: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class InSight:
    """A person's hand, or the glare of a lamp, lies over the canvas in the photographs `first` to `last`.

    place: of the palm, or of the middle of the glare, (across, down) as shares of the photograph.
    """

    what: Literal["hand", "glare"]
    first: int
    last: int | None = None
    place: tuple[float, float] = (0.55, 0.5)

    def concerns(self, photograph: int) -> bool:
        """Whether it is in that photograph."""
        return self.first <= photograph and (self.last is None or photograph <= self.last)


@dataclass(frozen=True)
class FailedMotion:
    """Motion number `motion` ends at its waypoint `waypoint` with the robot's error `code`."""

    motion: int
    waypoint: int
    code: int


@dataclass(frozen=True)
class Faults:
    """Faults by number, counted from 0 since the studio was opened.

    dropped_touches: contacts with the canvas in which the brush does not quite reach it;
    bumps: knocks against the canvas; stale_photographs: captures in which the camera hands out
    the photograph before; stuck_motions: motions that end half way, as the report tells;
    lying_motions: likewise, but only the pose tells; slow_motions: motions that take ten times as
    long; failed_motions: motions that end with an error; protective_stops: motions half way along
    which the robot meets with resistance and stops by itself; hanging_motions: motions whose call
    never returns; dead_from_motion: the robot is lost from that motion on (RobotDisconnected);
    unknown_pose: the robot does not know where it is; dry_dips: dips into a well that is empty
    then; lost_focus, light_changes, in_sight: what happens to the camera, to the lamps and between
    camera and canvas; frozen_photographs: captures in which the camera gives the picture before as a
    new one; failed_photographs: captures in which it does not answer (CameraError).
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
        """How much that photograph is blurred, share of its width; 0 where it is in focus."""
        return max((lost.blur for lost in self.lost_focus if lost.concerns(photograph)), default=0.0)

    def light_of(self, photograph: int) -> LightChange:
        """The light in which that photograph is taken."""
        so_far = [change for change in self.light_changes if change.first <= photograph]
        return max(so_far, key=lambda change: change.first, default=LightChange(0))


NO_FAULTS = Faults()
