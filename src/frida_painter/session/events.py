"""The one language in which anything is told of a painting or a calibration, as it happens and afterwards.

There are two sorts of events. A `Moment` carries plans and pixels and is told inside the process that paints. A
`Written` event is plain: it has a JSON form, `record` and `events_of`, under the name of its class, and stands in the
journal, in the feed of the page, or in both. Pictures appear in it by the names of their files. Listeners hear both.

This module loads neither torch nor the planner, for the page's process reads events and holds neither.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, get_args

from pydantic import TypeAdapter

from frida_painter.session.old_events import renewed
from frida_painter.session.page_events import PageEvent

if TYPE_CHECKING:
    from torch import Tensor

    from frida_painter.palette import Palette
    from frida_painter.plan import Plan
    from frida_painter.planning.forecast import SimilarityForecast
    from frida_painter.session.timetable import Timetable
    from frida_painter.strokes import Strokes


# Moments: what carries plans and pixels.


@dataclass(frozen=True)
class PlanningStep:
    """The planner made one iteration of `of`; `phase` is "plan" or "replan".

    parts: the strokes as they stood then, in painting order: the brush, and what it paints.
    """

    phase: str
    iteration: int
    of: int
    loss: float
    parts: tuple[tuple[str, Strokes], ...] = ()


@dataclass(frozen=True)
class Planned:
    """A plan is there for all strokes not yet painted.

    done: strokes painted so far; expected [3, H, W]: the canvas after the plan; loss_before,
    loss_after: the objective with the plan as it was and as it is (before the first plan: of the
    bare canvas), on average over paintings of the plan; forecast: how near to its photograph the painting
    will come, None where it has none.
    """

    plan: Plan
    done: int
    expected: Tensor
    loss_before: float
    loss_after: float
    forecast: SimilarityForecast | None = None

    @property
    def gain(self) -> float:
        """By which share of what was missing the plan comes nearer to the goal than the one before."""
        return 1 - self.loss_after / self.loss_before if self.loss_before > 0 else 0.0


@dataclass(frozen=True)
class Scheduled:
    """How long the robot takes for the strokes that are left, `done` being painted; told whenever the plan changes."""

    timetable: Timetable
    done: int


@dataclass(frozen=True)
class GroundWanted:
    """The canvas is bare; painting begins when it is toned in this colour, sRGB."""

    color: tuple[float, float, float]


@dataclass(frozen=True)
class PaintsWanted:
    """The paints of the next strokes are settled; painting goes on when their wells are filled."""

    palette: Palette


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


# Written events of a painting session: the journal has them all, the page some.


@dataclass(frozen=True)
class PaintingBegun:
    """A painting was begun, by these settings; rests_on: hashes, by name, of what else decides how it is painted.

    by, process, program: who painted, with which process and version.
    """

    settings: dict[str, Any]
    rests_on: dict[str, str]
    by: str = ""
    process: int = 0
    program: str = ""


@dataclass(frozen=True)
class SessionResumed:
    """A person had the painting resumed, `done` strokes being on the canvas.

    in_doubt: the stroke of which nothing tells whether it was painted; decision: "repaint" or "skip" for it.
    """

    done: int
    in_doubt: int | None = None
    decision: str = ""
    by: str = ""
    process: int = 0
    program: str = ""


@dataclass(frozen=True)
class PlanAdopted:
    """From stroke `done` + 1 on, painting goes by the plan of all strokes with this digest.

    It is told again after a look that left the plan as it was: what is known of the canvas is newer then.
    photograph: the file of that which it was made for; error, information: the placement, as it was known; depths,
    lower, touch_information: at which heights brushes touch, as TouchHeights has it; earlier versions did not know.
    """

    plan: str
    done: int
    photograph: str | None
    error: tuple[float, float, float]
    information: tuple[tuple[float, ...], ...]
    depths: dict[str, float] = field(default_factory=dict)
    lower: tuple[float, ...] = ()
    touch_information: tuple[tuple[float, ...], ...] = ()


@dataclass(frozen=True)
class MotionBegan:
    """The robot will now be told these motions, by their labels; stroke: the one that they paint, by which plan."""

    what: tuple[str, ...]
    stroke: int | None = None
    plan: str | None = None


@dataclass(frozen=True)
class Dipped:
    """The brush took paint from well number `paint`, from 0; `cleaned` says whether it was rinsed and wiped before."""

    paint: int
    cleaned: bool = False


@dataclass(frozen=True)
class StrokePainted:
    """Stroke number `done` (from 1) of `of` is on the canvas; `color` is its sRGB.

    Earlier versions did not write all of it down: then `of` is 0, and the color black.
    """

    done: int
    of: int = 0
    color: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Drying:
    """A layer dries, after `done` strokes, before the next one goes on it; told every minute until `left` is 0.

    seconds: that it takes in all; left: that it still takes. Of the robot's clock.
    """

    done: int
    seconds: float
    left: float


@dataclass(frozen=True)
class LayerBegun:
    """After `done` strokes layer number `layer` (from 1) begins or goes on; its brush and paints are there.

    first_paint: the number in the plan's palette, from 0, of the paint in the first well.
    """

    done: int
    layer: int
    brush: str
    first_paint: int = 0


@dataclass(frozen=True)
class BrushInHand:
    """The brush that the robot holds from now on: "" for none, None while it puts one back or takes one."""

    brush: str | None


@dataclass(frozen=True)
class TouchCorrected:
    """After a look at stroke `done` a brush is sent `lower` metres lower than its record says, below 0 higher."""

    brush: str
    lower: float
    done: int

    @property
    def sentence(self) -> str:
        """That, for a person."""
        if abs(self.lower) < 0.00005:
            return f"Marks of the {self.brush} brush are as they were sent, so it is sent as it was calibrated again."
        way, marks = ("higher", "thicker") if self.lower < 0 else ("lower", "thinner")
        return (
            f"Marks of the {self.brush} brush are {marks} than they were sent, so it is sent "
            f"{1000 * abs(self.lower):.1f} mm {way} than it was calibrated."
        )


@dataclass(frozen=True)
class LastLookDoubted:
    """All `done` strokes are on the canvas, and its last photograph is not as it should be; `reason` is a sentence."""

    reason: str
    done: int

    @property
    def sentence(self) -> str:
        """That, for a person."""
        return f"All {self.done} strokes are painted, and the last photograph may not show them well: {self.reason}"


@dataclass(frozen=True)
class StrokeLeftOut:
    """Whoever paints by hand left stroke number `done` (from 1) of `of` out; it counts, and is not on the canvas."""

    done: int
    of: int = 0


@dataclass(frozen=True)
class Photographed:
    """A photograph was taken by which something is decided; None where there was no room to keep it.

    captured_at: s of the robot's clock; sequence: the camera's number; light: of the room, [3, terms]; content: sha256
    of the file, None where there is none, and in journals of earlier programs.
    """

    photograph: str | None
    captured_at: float
    sequence: int
    light: list[list[float]] | None
    content: str | None = None


@dataclass(frozen=True)
class Paused:
    """Nothing moves until a person answers: the arm is aside and the brush clean; `reason` is a sentence.

    turn: whether that is because it is the person's turn to paint.
    """

    reason: str
    done: int = 0
    turn: bool = False


@dataclass(frozen=True)
class Stopped:
    """A person asked to stop; `done` strokes are on the canvas, None where nothing was being painted."""

    done: int | None = None


@dataclass(frozen=True)
class Failed:
    """The work broke off; `reason` is a sentence."""

    reason: str


@dataclass(frozen=True)
class Finished:
    """All strokes are done, `done` of them; robot_seconds: of the robot's clock, in this run."""

    done: int
    robot_seconds: float = 0.0


@dataclass(frozen=True)
class RegionProtected:
    """A person drew what no stroke may touch, or, where `only`, what alone may be painted.

    region: the drawing in the painting's folder, None where nothing is protected any more; picture: as the page has it.
    """

    region: str | None
    only: bool = False
    picture: str | None = None


@dataclass(frozen=True)
class GoalChanged:
    """A person wants something else from now on; goal: its folder in the painting's; wish: as the page has it."""

    goal: str
    wish: dict[str, Any]


Written = (
    PaintingBegun | SessionResumed | PlanAdopted | MotionBegan | Dipped | Drying | LayerBegun | BrushInHand
    | StrokePainted | StrokeLeftOut | Photographed | TouchCorrected | LastLookDoubted | Paused | Stopped | Failed
    | Finished | RegionProtected | GoalChanged | PageEvent
)  # fmt: skip
Moment = PlanningStep | Planned | Scheduled | GroundWanted | PaintsWanted | TimelapseFrame | Looked | Resumed
Event = Moment | Written
Notify = Callable[[Event], None]


def kind_of(event: type[Written]) -> str:
    """The name under which events of a class are written: stroke_painted for StrokePainted."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", event.__name__).lower()


KINDS: Mapping[str, type[Written]] = {kind_of(each): each for each in get_args(Written)}


def record(event: Written) -> dict[str, Any]:
    """The JSON form of an event that happens now. Raises TypeError for a moment, which has none."""
    if type(event) not in get_args(Written):
        raise TypeError(f"{type(event).__name__} carries what is not written down; tell what was made of it.")
    at = datetime.now(UTC).isoformat(timespec="milliseconds")
    return {"kind": kind_of(type(event)), "at": at, **asdict(event)}


def events_of(written: Mapping[str, Any]) -> list[Written]:
    """What a record tells, also one of an earlier version; nothing where its kind is not known.

    Raises ValueError where it lacks something, or has it of another type.
    """
    return [
        _adapter(each["kind"]).validate_python(dict(each)) for each in renewed(written) if each.get("kind") in KINDS
    ]


def time_of(written: Mapping[str, Any]) -> datetime:
    """When a record was written. Raises ValueError where it does not say so."""
    at = written.get("at")
    if isinstance(at, int | float):  # as earlier versions dated a feed
        return datetime.fromtimestamp(at, UTC)
    return datetime.fromisoformat(str(at))


@functools.cache
def _adapter(kind: str) -> TypeAdapter[Written]:
    return TypeAdapter(KINDS[kind])
