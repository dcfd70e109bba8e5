"""What can go wrong in the studio, on demand; nothing does unless it is asked for."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Bump:
    """Somebody knocks against the canvas with the first motion after `before_touch` contacts with it.

    shift: metres in the canvas's plane; turn: radians about the canvas's centre.
    """

    before_touch: int
    shift: tuple[float, float]
    turn: float = 0.0


@dataclass(frozen=True)
class Faults:
    """Faults by number, counted from 0 since the studio was opened.

    dropped_touches: contacts with the canvas in which the brush does not quite reach it;
    bumps: knocks against the canvas; stale_photographs: captures in which the camera hands out
    the photograph before; stuck_motions: motions that end half way, as the pose tells;
    dead_from_motion: the robot is lost from that motion on (RobotError).
    """

    dropped_touches: frozenset[int] = frozenset()
    bumps: tuple[Bump, ...] = ()
    stale_photographs: frozenset[int] = frozenset()
    stuck_motions: frozenset[int] = frozenset()
    dead_from_motion: int | None = None


NO_FAULTS = Faults()
