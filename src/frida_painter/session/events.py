"""Events of a painting or a calibration: the one form in which they are reported, both live and afterwards.

There are two sorts of events. A `Moment` carries plans and pixels and stays inside the painting process. A `Written`
event is plain data with a JSON form (`record`, `events_of`), named after its class. It stands in the journal, in the
feed of the studio page, or in both, and names pictures by their files. Listeners receive both sorts:

    >>> import frida_painter as fp
    >>> def hear(event):
    ...     if isinstance(event, fp.events.StrokePainted):
    ...         print(event.done)
    >>> spec = fp.RunSpec.of(goal=[{"image": "photo.jpg"}], canvas="12x9cm", strokes=2, replans=0, render_height=64)
    >>> with fp.PaintingRun(spec, listeners=[hear]) as run:
    ...     painting = run.simulate()
    1
    2

This module loads neither torch nor the planner, because the web process reads events.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Literal

from pydantic import TypeAdapter

from frida_painter.session import making_events as making_events
from frida_painter.session import setup_events as setup_events
from frida_painter.session.event import Event as Event
from frida_painter.session.event import Moment as Moment
from frida_painter.session.event import Written as Written
from frida_painter.session.person_events import GoalChanged as GoalChanged
from frida_painter.session.person_events import PersonPaintShown as PersonPaintShown
from frida_painter.session.person_events import PersonStrokeBegan as PersonStrokeBegan
from frida_painter.session.person_events import PersonStrokePainted as PersonStrokePainted
from frida_painter.session.person_events import RegionProtected as RegionProtected
from frida_painter.session.person_events import RequestTaken as RequestTaken

if TYPE_CHECKING:
    from torch import Tensor

    from frida_painter.palette import Palette
    from frida_painter.plan import Plan
    from frida_painter.planning.forecast import SimilarityForecast
    from frida_painter.strokes import Strokes


# Duration of painting at the robot: its parts, and the time at which each stroke is done.

DRYING = 1200.0
"""Default drying time in seconds between two layers.

Winsor & Newton ("Understanding drying times for acrylic paints") give 10 to 20 minutes for thin films of Galeria
and 20 to 30 for thin films of Professional Acrylic.
"""


@dataclass(frozen=True)
class Timetable:
    """Duration of painting, in seconds of the robot's clock.

    strokes: on the canvas.
    dips: paint from the wells.
    washing: rinses and wipes.
    changes: brushes at the rack.
    travel: between all of these.
    looks: trips to the home position and back.
    drying: layers that dry before the next one.
    after: seconds from the beginning until each stroke is painted.
    dried: seconds of these in which a layer dries.
    """

    strokes: float = 0.0
    dips: float = 0.0
    washing: float = 0.0
    changes: float = 0.0
    travel: float = 0.0
    looks: float = 0.0
    drying: float = 0.0
    after: tuple[float, ...] = ()
    dried: tuple[float, ...] = ()

    @property
    def total(self) -> float:
        """Total seconds."""
        return self.strokes + self.dips + self.washing + self.changes + self.travel + self.looks + self.drying

    def after_drying(self, seconds: float) -> Timetable:
        """Returns the timetable with this drying time before everything else."""
        after, dried = (tuple(seconds + done for done in each) for each in (self.after, self.dried))
        return replace(self, drying=self.drying + seconds, after=after, dried=dried)


# Written events for the studio page only: of plans, of the display of a painting, and of calibration.


class PlanRequested(Written):
    """A person asked for plan number `plan`.

    wish: request of the page.
    """

    plan: int
    wish: dict[str, Any]


class PlanningProgress(Written):
    """Progress of planning.

    share: in [0, 1].
    left: seconds that planning still takes.
    plan: plan number, None during a painting.
    """

    share: float
    left: float
    plan: int | None = None


class PlanPreview(Written):
    """Picture of a plan that is being made.

    plan: plan number, None during a painting.
    """

    picture: str
    plan: int | None = None


class PlanMade(Written):
    """Plan number `plan` is ready, after `seconds`.

    nearer: share of the bare canvas's distance to the goal that the plan removes.
    prefix: beginning of the names of its pictures.
    frames: numbers of strokes for which there is a picture.
    palette: its paints.
    mixtures: recipes of the paints.
    mixing: changes of colours so that they can be mixed, in words for each filling of the wells.
    remarks: sentences about what it shows of the goal, and how.
    """

    plan: int
    nearer: float
    seconds: float
    prefix: str
    frames: list[int]
    strokes: int
    palette: list[dict[str, Any]]
    mixtures: list[dict[str, Any]]
    mixing: dict[str, str] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)


class Queued(Written):
    """Plan number `plan` waits for other jobs.

    job: "plan" if it waits to be made, "paint" if it waits to be painted.
    """

    plan: int
    job: str


class Dequeued(Written):
    """Plan number `plan` no longer waits.

    begun: True if its job began, False if a person removed it.
    """

    plan: int
    begun: bool


class RestReplanned(Written):
    """The rest was replanned after `done` strokes.

    gain: as in Planned. The other fields: as in PlanMade.
    """

    done: int
    gain: float
    prefix: str
    frames: list[int]
    strokes: int
    palette: list[dict[str, Any]]


class PaintingStarted(Written):
    """A person started the painting of plan number `plan`, with `of` strokes."""

    plan: int
    of: int


class TakenUp(Written):
    """A person resumed a painting; `done` strokes are painted."""

    done: int


class Mixing(Written):
    """The wells are being filled."""


class TimeLeft(Written):
    """Current forecast of the seconds until the last stroke."""

    seconds: float


class PhotographShown(Written):
    """Photograph of the canvas after `done` strokes."""

    picture: str
    done: int


class LookShown(Written):
    """Pictures of a look after `done` strokes: the seen canvas, the expected canvas and their difference."""

    done: int
    seen: str
    expected: str
    difference: str


class Considering(Written):
    """The painter works on a request that a person made in a pause."""


class WentOn(Written):
    """A pause has ended."""


class Turns(Written):
    """Robot and person take turns of this many strokes or minutes; 0: no turns.

    policy, keep: how the robot answers what the person painted; see together.policies.
    """

    strokes: int
    minutes: float = 0.0
    policy: str = "alternate"
    keep: str = "welcome"


class Remark(Written):
    """Reason why a request could not be done as asked."""

    sentence: str


class Finishing(Written):
    """The robot no longer moves; film, page and exports are being made."""


class PaintingKept(Written):
    """The folder of a painting is complete.

    film: True if it holds a film.
    arm: True if it holds a film of the arm.
    painters: True if it tells who painted what, because a person painted too.
    """

    film: bool
    arm: bool = False
    painters: bool = False


class Asked(Written):
    """Question to a person, in the form of frida_painter_studio/painter.py."""

    question: dict[str, Any]


class Answered(Written):
    """A person answered the question."""


class PersonMayPaint(Written):
    """A person may paint on the canvas now.

    brushes: name of each brush, and the widths of its marks in metres: `light` and `hard`.
    wells: paints in the wells, as "#rrggbb".
    """

    brushes: list[dict[str, Any]]
    wells: list[str]


class Rests(Written):
    """The worker has ended."""


# Written events of a calibration.


class CalibrationStarted(Written):
    """A person started these procedures, in this order."""

    what: list[str]


class CalibrationStatus(Written):
    """Status of each procedure: its name, its date, the reason to repeat it, and whether it is old."""

    easel: str
    procedures: list[dict[str, Any]]


class ProcedureBegan(Written):
    """A procedure has begun."""

    name: str


class ProcedureProgress(Written):
    """Progress of a procedure, in words."""

    words: str


class ProcedureFound(Written):
    """Result of a procedure, with a picture if there is one."""

    name: str
    sentence: str
    picture: str | None = None


class TeachingStarted(Written):
    """A person taught marks of a stroke; the family of this name is now learned."""

    name: str


class FamilyTaught(Written):
    """The family of this name was learned for a brush; `picture` is its sheet, for the page."""

    name: str
    brush: str
    sentence: str
    picture: str


# Moments: events that carry plans and pixels.


class PlanningStep(Moment):
    """The planner made iteration `iteration` of `of`.

    phase: "plan" or "replan".
    parts: brush and current strokes of each part, in painting order.
    """

    phase: str
    iteration: int
    of: int
    loss: float
    parts: tuple[tuple[str, Strokes], ...] = ()


class Planned(Moment):
    """A plan for all unpainted strokes is ready.

    done: strokes painted so far.
    expected [3, H, W]: canvas after the plan.
    loss_before, loss_after: expected loss of the old and of the new plan; at first, of the bare canvas.
    forecast: similarity of the painting to its photograph. None: the goal has no photograph.
    """

    plan: Plan
    done: int
    expected: Tensor
    loss_before: float
    loss_after: float
    forecast: SimilarityForecast | None = None

    @property
    def gain(self) -> float:
        """Share of the old loss that the new plan removes."""
        return 1 - self.loss_after / self.loss_before if self.loss_before > 0 else 0.0


class Scheduled(Moment):
    """Time that the robot takes for the remaining strokes after `done`; reported whenever the plan changes.

    pace: seconds that people wait per second of drying: 1 at a real easel, 0 in a studio that need not wait.
    """

    timetable: Timetable
    done: int
    pace: float = 1.0


class GroundWanted(Moment):
    """The canvas is bare; painting begins after a person has toned it in this colour, sRGB."""

    color: tuple[float, float, float]


class PaintsWanted(Moment):
    """The paints of the next strokes are known; painting continues after a person has filled their wells."""

    palette: Palette


class TimelapseFrame(Moment):
    """Rectified photograph for the film, [3, H, W]."""

    photograph: Tensor
    done: int
    of: int
    color: tuple[float, float, float]


class Looked(Moment):
    """The painter looked at the canvas after `done` strokes.

    photograph, expected [3, H, W]: rectified photograph, and the expected picture.
    """

    photograph: Tensor
    expected: Tensor
    done: int


class CanvasAssumed(Moment):
    """Nobody looked: the painter goes on as if the canvas after `done` strokes were this picture, [3, H, W]."""

    canvas: Tensor
    done: int


class Resumed(Moment):
    """A painting goes on with a plan of all its strokes; `done` of them are on the canvas.

    expected [3, H, W]: canvas after the plan, as far as it is known before the next look.
    """

    plan: Plan
    done: int
    expected: Tensor


# Written events of a painting session: all are in the journal, some on the page.


class PaintingBegun(Written):
    """A painting began with these settings.

    rests_on: hashes, by name, of the other inputs of the painting.
    by, process, program: painter, process number and program version.
    """

    settings: dict[str, Any]
    rests_on: dict[str, str]
    by: str = ""
    process: int = 0
    program: str = ""


class SessionResumed(Written):
    """A person resumed the painting; `done` strokes are on the canvas.

    in_doubt: stroke that was begun but may not be painted, or None.
    decision: "repaint" or "skip" for that stroke.
    by, process, program: painter, process number and program version.
    """

    done: int
    in_doubt: int | None = None
    decision: str = ""
    by: str = ""
    process: int = 0
    program: str = ""


class PlanAdopted(Written):
    """Painting follows the plan with this digest, which has all strokes, from stroke `done` + 1 on.

    It is reported again after a look that kept the plan, with the newer placement.
    photograph: file of the photograph that the plan was made for.
    error, information: placement at that time.
    depths, lower, touch_information: touch heights, as in TouchHeights; empty in records of earlier versions.
    answers: True if the rest answers a person, and is not on the way to the goal.
    """

    plan: str
    done: int
    photograph: str | None
    error: tuple[float, float, float]
    information: tuple[tuple[float, ...], ...]
    depths: dict[str, float] = field(default_factory=dict)
    lower: tuple[float, ...] = ()
    touch_information: tuple[tuple[float, ...], ...] = ()
    answers: bool = False


class MotionBegan(Written):
    """The robot will now get motions with these labels.

    stroke: number of the stroke that they paint, or None.
    plan: digest of that stroke's plan.
    """

    what: tuple[str, ...]
    stroke: int | None = None
    plan: str | None = None


class Dipped(Written):
    """The brush took paint from well number `paint`, from 0.

    cleaned: True if the brush was rinsed and wiped before.
    """

    paint: int
    cleaned: bool = False


class StrokePainted(Written):
    """Stroke number `done` (from 1) of `of` is on the canvas; `color` is its sRGB.

    `of` is 0 and the colour is black if they are unknown.
    """

    done: int
    of: int = 0
    color: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Drying(Written):
    """A layer dries after `done` strokes; reported every minute until `left` is 0.

    seconds, left: whole and remaining drying time: in the journal by the robot's clock, for listeners as people wait.
    """

    done: int
    seconds: float
    left: float


class LayerBegun(Written):
    """Layer number `layer` (from 1) begins or goes on after `done` strokes; its brush and paints are ready.

    first_paint: palette number, from 0, of the paint in the first well.
    """

    done: int
    layer: int
    brush: str
    first_paint: int = 0


class BrushInHand(Written):
    """The robot holds this brush from now on: "" for none, None during a change."""

    brush: str | None


class TouchCorrected(Written):
    """After a look at stroke `done`, a brush is sent `lower` metres lower than its record; below 0: higher."""

    brush: str
    lower: float
    done: int

    @property
    def sentence(self) -> str:
        """Sentence for a person."""
        if abs(self.lower) < 0.00005:
            return f"Marks of the {self.brush} brush are as they were sent, so it is sent as it was calibrated again."
        way, marks = ("higher", "thicker") if self.lower < 0 else ("lower", "thinner")
        return (
            f"Marks of the {self.brush} brush are {marks} than they were sent, so it is sent "
            f"{1000 * abs(self.lower):.1f} mm {way} than it was calibrated."
        )


class LastLookDoubted(Written):
    """All `done` strokes are painted, but the last photograph may not show them well; `reason` is a sentence."""

    reason: str
    done: int

    @property
    def sentence(self) -> str:
        """Sentence for a person."""
        return f"All {self.done} strokes are painted, and the last photograph may not show them well: {self.reason}"


class StrokeLeftOut(Written):
    """A person who paints by hand left out stroke number `done` (from 1) of `of`.

    It counts, but is not on the canvas.
    """

    done: int
    of: int = 0


class Photographed(Written):
    """A photograph for a decision was taken.

    photograph: its file; None if there was no room to keep it.
    captured_at: seconds of the robot's clock.
    sequence: number from the camera.
    light: light of the room, [3, terms].
    content: sha256 of the file. None without a file, and in journals of earlier versions.
    """

    photograph: str | None
    captured_at: float
    sequence: int
    light: list[list[float]] | None
    content: str | None = None


PauseCause = Literal["person", "button", "turn", "trouble"]


class CanvasPicture(Written):
    """Picture of the whole canvas after `done` strokes, without table, on an easel without a camera.

    picture: its file; None if there was no room to keep it.
    seen: True if a person took the picture, False if it is rendered from the painted strokes.
    content: sha256 of the file.
    """

    picture: str | None
    done: int
    seen: bool = False
    content: str | None = None


class Paused(Written):
    """The painting waits for a person; the arm is at home and the brush is clean. `reason` is a sentence.

    cause: "person" if a person asked for the pause, "button" if somebody pressed the machine's pause button, "turn" if
    it is the person's turn to paint, "trouble" if something is wrong.
    """

    reason: str
    done: int = 0
    cause: PauseCause = "trouble"


class Stopped(Written):
    """A person stopped; `done` strokes are on the canvas, None if nothing was being painted."""

    done: int | None = None


class Failed(Written):
    """The work failed; `reason` is a sentence."""

    reason: str


class Finished(Written):
    """All `done` strokes are done.

    robot_seconds: seconds of the robot's clock in this run.
    """

    done: int
    robot_seconds: float = 0.0


Notify = Callable[[Event], None]
"""Function that hears every event of a painting, such as each of the `listeners` of PaintingRun."""


def kind_of(event: type[Written]) -> str:
    """Returns the name of a class of events in records: stroke_painted for StrokePainted."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", event.__name__).lower()


KINDS: Mapping[str, type[Written]] = {kind_of(each): each for each in Written.__subclasses__()}
_FORMER_KINDS = {"plan_wished": "plan_requested"}  # some feeds of 0.2


def record(event: Written) -> dict[str, Any]:
    """Returns the JSON form of an event, with the current time.

    Raises TypeError for a moment, which has no JSON form.
    """
    if not isinstance(event, Written):
        raise TypeError(f"{type(event).__name__} carries what is not written down; tell what was made of it.")
    at = datetime.now(UTC).isoformat(timespec="milliseconds")
    return {"kind": kind_of(type(event)), "at": at, **asdict(event)}


def events_of(written: Mapping[str, Any]) -> list[Written]:
    """Returns the event of a record; an empty list for an unknown kind.

    Raises ValueError if a field is missing or has a wrong type.
    """
    kind = _FORMER_KINDS.get(str(written.get("kind")), str(written.get("kind")))
    if kind == "paused" and "cause" not in written:  # records of 0.2 say `turn`, and of 0.3 `asked`
        cause = "turn" if written.get("turn") else "person" if written.get("asked") else "trouble"
        written = {**written, "cause": cause}
    return [_adapter(kind).validate_python(dict(written))] if kind in KINDS else []


def time_of(written: Mapping[str, Any]) -> datetime:
    """Returns the time at which a record was written. Raises ValueError if the record has no valid time."""
    return datetime.fromisoformat(str(written.get("at")))


@functools.cache
def _adapter(kind: str) -> TypeAdapter[Written]:
    return TypeAdapter(KINDS[kind])
