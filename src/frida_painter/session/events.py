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
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, get_args

from pydantic import TypeAdapter

from frida_painter.session.old_events import renewed

if TYPE_CHECKING:
    from torch import Tensor

    from frida_painter.palette import Palette
    from frida_painter.plan import Plan
    from frida_painter.planning.forecast import SimilarityForecast
    from frida_painter.strokes import Strokes


# How long painting takes at the robot: what it is spent on, and when each stroke is done.

DRYING = 1200.0
"""Seconds that a layer is let dry before the next one goes on it, unless somebody says otherwise.

Winsor & Newton ("Understanding drying times for acrylic paints") give 10 to 20 minutes for thin films of Galeria and
20 to 30 for thin films of Professional Acrylic.
"""


@dataclass(frozen=True)
class Timetable:
    """Seconds of the robot's clock that painting takes.

    strokes: on the canvas; dips; washing: rinses and wipes; changes: of brushes at the rack;
    travel: between all of these; looks: going
    aside and coming back; drying: of layers before the next one; after: seconds from the beginning until each
    stroke is painted.
    """

    strokes: float = 0.0
    dips: float = 0.0
    washing: float = 0.0
    changes: float = 0.0
    travel: float = 0.0
    looks: float = 0.0
    drying: float = 0.0
    after: tuple[float, ...] = ()

    @property
    def total(self) -> float:
        """Seconds for everything."""
        return self.strokes + self.dips + self.washing + self.changes + self.travel + self.looks + self.drying

    def after_drying(self, seconds: float) -> Timetable:
        """The same where the canvas dries for so many seconds before anything else."""
        return replace(self, drying=self.drying + seconds, after=tuple(seconds + done for done in self.after))


# Written events that only the page is told: of plans, of what it shows of a painting, and of calibrating.


@dataclass(frozen=True)
class PlanRequested:
    """A person asked for plan number `plan`; wish: the request, as the page sent it."""

    plan: int
    wish: dict[str, Any]


@dataclass(frozen=True)
class PlanningProgress:
    """How far planning is, in [0, 1], and how many seconds it still takes; plan: its number, None in a painting."""

    share: float
    left: float
    plan: int | None = None


@dataclass(frozen=True)
class PlanPreview:
    """A picture of a plan that is being made; plan: its number, None in a painting."""

    picture: str
    plan: int | None = None


@dataclass(frozen=True)
class PlanMade:
    """Plan number `plan` is ready, after `seconds`.

    nearer: by which share of the bare canvas's distance it comes nearer to the goal; prefix: of the names of its
    pictures; frames: after how many strokes there is one; palette: its paints; mixtures: how they are mixed.
    """

    plan: int
    nearer: float
    seconds: float
    prefix: str
    frames: list[int]
    strokes: int
    palette: list[dict[str, Any]]
    mixtures: list[dict[str, Any]]


@dataclass(frozen=True)
class Queued:
    """Plan number `plan` waits for others; job: "plan" where it is to be made, "paint" where it is to be painted."""

    plan: int
    job: str


@dataclass(frozen=True)
class Dequeued:
    """Plan number `plan` waits no longer: it was begun, or else a person took it out."""

    plan: int
    begun: bool


@dataclass(frozen=True)
class RestReplanned:
    """What was left was planned again after `done` strokes; gain: as of Planned; the rest as of PlanMade."""

    done: int
    gain: float
    prefix: str
    frames: list[int]
    strokes: int
    palette: list[dict[str, Any]]


@dataclass(frozen=True)
class PaintingStarted:
    """A person had plan number `plan` painted, of `of` strokes."""

    plan: int
    of: int


@dataclass(frozen=True)
class TakenUp:
    """A person had a painting that broke off gone on with; `done` strokes are painted."""

    done: int


@dataclass(frozen=True)
class Mixing:
    """The wells are being filled."""


@dataclass(frozen=True)
class TimeLeft:
    """Seconds until the last stroke, as they are forecast now."""

    seconds: float


@dataclass(frozen=True)
class PhotographShown:
    """A photograph of the canvas after `done` strokes."""

    picture: str
    done: int


@dataclass(frozen=True)
class LookShown:
    """Pictures of a look after `done` strokes: what was seen, what was expected, and the difference."""

    done: int
    seen: str
    expected: str
    difference: str


@dataclass(frozen=True)
class Considering:
    """The painter does what a person asked for in a pause."""


@dataclass(frozen=True)
class WentOn:
    """A pause is over."""


@dataclass(frozen=True)
class Turns:
    """Robot and person take turns of so many strokes; 0: they do not."""

    strokes: int


@dataclass(frozen=True)
class Remark:
    """Why something could not be done as it was asked for."""

    sentence: str


@dataclass(frozen=True)
class Finishing:
    """Nothing moves any more; film, page and exports are being made."""


@dataclass(frozen=True)
class PaintingKept:
    """All that is kept of a painting is in its folder; whether a film, and one of the arm, is among it."""

    film: bool
    arm: bool = False


@dataclass(frozen=True)
class Asked:
    """A person is asked something, as web/painter.py describes it."""

    question: dict[str, Any]


@dataclass(frozen=True)
class Answered:
    """The question was answered."""


@dataclass(frozen=True)
class Rests:
    """The worker has ended."""


# Written events of a calibration.


@dataclass(frozen=True)
class CalibrationStarted:
    """A person had these procedures begun, in this order."""

    what: list[str]


@dataclass(frozen=True)
class CalibrationStatus:
    """How each procedure stands: its name, when it was done, why it is to be repeated, whether it is old."""

    easel: str
    procedures: list[dict[str, Any]]


@dataclass(frozen=True)
class ProcedureBegan:
    """A procedure is led now."""

    name: str


@dataclass(frozen=True)
class ProcedureProgress:
    """How far a procedure is, in words."""

    words: str


@dataclass(frozen=True)
class ProcedureFound:
    """What a procedure found, and a picture of it if there is one."""

    name: str
    sentence: str
    picture: str | None = None


PageEvent = (
    PlanRequested | PlanningProgress | PlanPreview | PlanMade | RestReplanned | PaintingStarted | TakenUp | Mixing
    | TimeLeft | PhotographShown | LookShown | Considering | WentOn | Turns | Remark | Finishing | PaintingKept | Asked
    | Answered | Rests | Queued | Dequeued
    | CalibrationStarted | CalibrationStatus | ProcedureBegan | ProcedureProgress | ProcedureFound
)  # fmt: skip


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
