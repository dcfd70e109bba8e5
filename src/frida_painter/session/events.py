"""What happens during a session, told as it happens: for progress bars, films and pages."""

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor

from frida_painter.palette import Palette
from frida_painter.plan import Plan
from frida_painter.session.timetable import Timetable
from frida_painter.strokes import Strokes


@dataclass(frozen=True)
class PlanningStep:
    """The planner made one iteration of `of`; `phase` is "plan" or "replan"; strokes: as they stood then."""

    phase: str
    iteration: int
    of: int
    loss: float
    strokes: Strokes | None = None


@dataclass(frozen=True)
class Planned:
    """A plan is there for all strokes not yet painted.

    done: strokes painted so far; expected [3, H, W]: the canvas after the plan; loss_before,
    loss_after: the objective with the plan as it was and as it is (before the first plan: of the
    bare canvas).
    """

    plan: Plan
    done: int
    expected: Tensor
    loss_before: float
    loss_after: float


@dataclass(frozen=True)
class Scheduled:
    """How long the robot takes for the strokes that are left, `done` being painted; told whenever the plan changes."""

    timetable: Timetable
    done: int


@dataclass(frozen=True)
class PaintsWanted:
    """The palette is settled; painting begins when its wells are filled."""

    palette: Palette


@dataclass(frozen=True)
class Dipped:
    """The brush took paint from a well; `cleaned` says whether it was rinsed and wiped before."""

    paint: int
    cleaned: bool


@dataclass(frozen=True)
class StrokePainted:
    """Stroke number `done` (from 1) of `of` is on the canvas; `color` is its sRGB."""

    done: int
    of: int
    color: tuple[float, float, float]


@dataclass(frozen=True)
class StrokeLeftOut:
    """Whoever paints by hand left stroke number `done` (from 1) of `of` out; it counts, and is not on the canvas."""

    done: int
    of: int


@dataclass(frozen=True)
class TimelapseFrame:
    """A photograph for the film, rectified, [3, H, W]."""

    photograph: Tensor
    done: int
    of: int
    color: tuple[float, float, float]


@dataclass(frozen=True)
class Looked:
    """The painter looked: the rectified photograph, what it expected to see [3, H, W] each, strokes so far."""

    photograph: Tensor
    expected: Tensor
    done: int


@dataclass(frozen=True)
class Resumed:
    """A painting that broke off goes on: the plan of all its strokes, of which `done` are on the canvas.

    expected [3, H, W]: the canvas after the plan, as far as it can be told before the next look.
    """

    plan: Plan
    done: int
    expected: Tensor


@dataclass(frozen=True)
class Paused:
    """Nothing moves until a person answers: the arm is aside and the brush clean; `reason` is a sentence."""

    reason: str
    done: int


@dataclass(frozen=True)
class Stopped:
    """A person asked to stop; `done` strokes are on the canvas."""

    done: int


Event = (
    PlanningStep
    | Planned
    | Scheduled
    | PaintsWanted
    | Dipped
    | StrokePainted
    | StrokeLeftOut
    | TimelapseFrame
    | Looked
    | Resumed
    | Paused
    | Stopped
)
Notify = Callable[[Event], None]
