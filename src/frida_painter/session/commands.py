"""What a person may tell a painting that is being painted; each command is done between two strokes, or in a pause."""

from dataclasses import dataclass
from typing import Literal

from frida_painter.errors import ConfigError

Kind = Literal["pause", "go on", "look", "leave out", "turns", "spare", "only", "free", "goal"]


@dataclass(frozen=True)
class Pause:
    """Finish the stroke, clean the brush, step aside and wait."""


@dataclass(frozen=True)
class GoOn:
    """The pause is over."""


@dataclass(frozen=True)
class LookAgain:
    """See what was made of the canvas, and plan the rest again."""


@dataclass(frozen=True)
class LeaveOut:
    """Leave out the last `count` strokes of the plan."""

    count: int


@dataclass(frozen=True)
class TakeTurns:
    """Paint `count` strokes, then it is the person's turn; 0: no turns any more."""

    count: int


@dataclass(frozen=True)
class Protect:
    """Keep clear of what was drawn under this number, or, where `only`, paint there alone."""

    record: int
    only: bool


@dataclass(frozen=True)
class Free:
    """Nothing is protected any more."""


@dataclass(frozen=True)
class ChangeGoal:
    """Go on towards the goal that was put down under this number; the paints stay."""

    record: int


PaintingCommand = Pause | GoOn | LookAgain | LeaveOut | TakeTurns | Protect | Free | ChangeGoal


def command(kind: str, *, count: int = 0, record: int = 0) -> PaintingCommand:
    """The command of a kind. Raises ConfigError where there is none such."""
    match kind:
        case "pause":
            return Pause()
        case "go on":
            return GoOn()
        case "look":
            return LookAgain()
        case "leave out":
            return LeaveOut(count)
        case "turns":
            return TakeTurns(count)
        case "spare" | "only":
            return Protect(record, only=kind == "only")
        case "free":
            return Free()
        case "goal":
            return ChangeGoal(record)
        case _:
            raise ConfigError(
                f"There is no command {kind[:40]!r}; there are pause, go on, look, leave out, turns, spare, only, "
                "free and goal."
            )
