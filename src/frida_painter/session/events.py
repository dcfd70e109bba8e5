"""Events of a painting, a plan or a calibration. Listeners hear the same events that are written down.

An event is named after its class and has a JSON form (`record`, `events_of`), in which it stands in the journal of a
painting or in the feed of a job. Fields that carry plans and pixels are live: only listeners in the painting process
have them, and pictures are named by their files. `PaintingState` (fold.py) folds the events of a painting.

    >>> import frida_painter as fp
    >>> def hear(event):
    ...     if isinstance(event, fp.events.StrokePainted):
    ...         print(event.done)
    >>> spec = fp.RunSpec.of(goal=[{"image": "photo.jpg"}], canvas="12x9cm", strokes=2, replans=0, render_height=64)
    >>> with fp.PaintingRun(spec, listeners=[hear]) as run:
    ...     painting = run.simulate()
    1
    2
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, dataclass_transform

from pydantic import Field, TypeAdapter

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from torch import Tensor

    from frida_painter.strokes.plan import Plan
    from frida_painter.strokes.strokes import Strokes

    Bytes = NDArray[np.uint8]
else:  # the web process reads events, and loads neither torch nor the planner
    Bytes = Tensor = Plan = Strokes = Any  # live fields are never read from a record


@dataclass_transform(frozen_default=True)
@dataclass(frozen=True)
class Event:
    """Something that happens in a painting, a plan or a calibration; every class of events is a frozen dataclass.

    In a journal it is shown to others, and may be lost if the machine fails.
    """

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True)(cls)

    def without_live(self) -> Self:
        """Returns the event without its live fields, as a record tells it."""
        return replace(self, **dict.fromkeys(_live_fields(kind_of(type(self)))))


class Durable(Event):
    """Event that a resumed painting needs: it is on the disk before the painting goes on."""


def live() -> Any:
    """Returns the default of a field that only listeners in the painting process have."""
    return field(default=None, metadata={"live": True}, repr=False)


class Unknown(Event):
    """Entry of a newer program, of an unknown kind or with a field that is unknown in the event after it."""


# Any work: a plan, a painting's process, a calibration, the setup of a machine, the teaching of a stroke, the making of
# pictures. `what` tells the job or the result, and `detail` has more for the page.


class Began(Event):
    """A job or a step of one has begun: "plan", "paint", "resume", "results", "calibration", "procedure" and others.

    "results": the robot no longer moves; film, page and exports of a painting are being made.

    name: of the step; "beside" for a plan that was ordered together with the one before.
    plan: number of the plan that it is about, 0 for none.
    detail: request, or other facts.
    """

    what: str
    name: str = ""
    plan: int = 0
    detail: dict[str, Any] = field(default_factory=dict)


class Advanced(Event):
    """Progress of a job: in words, as a share of it in [0, 1] with the seconds left, or as a picture."""

    words: str = ""
    share: float | None = None
    left: float | None = None
    picture: str | None = None


class ResultFound(Event):
    """Result of a job or a step: "plan", "procedure", "status", "machine", "family", "results" and others.

    "refused": `name` says why a painting is not resumed. "found": picture `name` outlines what a person painted.
    """

    what: str
    name: str = ""
    plan: int = 0
    detail: dict[str, Any] = field(default_factory=dict)


class Asked(Event):
    """Question to a person, in the form of together.asking; None after the answer."""

    question: dict[str, Any] | None


class Remark(Event):
    """Sentence for a person, such as the reason why a request could not be done as asked.

    about: "touch" if `brush` is sent lower or higher from now on, "last look" if the last photograph may not show the
    finished canvas well, else "".
    """

    sentence: str
    about: Literal["", "touch", "last look"] = ""
    brush: str = ""


class Stopped(Event):
    """Work ended before its end: a person stopped it or gave it up, or it failed; `reason` is then a sentence."""

    reason: str = ""

    @property
    def how(self) -> Literal["stopped", "failed"]:
        """Way in which the work ended."""
        return "failed" if self.reason else "stopped"


# Sittings of a painting, its plans and its time.


class PaintingBegun(Durable):
    """A painting began with these settings, as plain values.

    rests_on: hashes, by name, of the other inputs of the painting: goal, calibration and brush.
    by, process, program: painter, process number and program version.
    """

    settings: dict[str, Any]
    rests_on: dict[str, str]
    by: str = ""
    process: int = 0
    program: str = ""


class SessionResumed(Durable):
    """A person resumed the painting; `done` strokes are on the canvas.

    in_doubt: stroke that was begun but may not be painted, or None.
    decision: "repaint" or "skip" for that stroke.
    by, process, program: painter, process number and program version.
    plan: of all strokes; None if there was none yet.
    expected [3, H, W]: canvas after the plan, as far as it is known before the next look.
    """

    done: int
    in_doubt: int | None = None
    decision: str = ""
    by: str = ""
    process: int = 0
    program: str = ""
    plan: Plan | None = live()
    expected: Tensor | None = live()


class Scheduled(Event):
    """Expected work after `done` strokes, at the beginning of a sitting and for each new plan.

    strokes: of the painting; 0 if nobody knows how many a person will ask for.
    looks: numbers of painted strokes at the looks on the way.
    replanning, planning: iterations of a replan at a look, and of the first plan if it is not made yet.

    seconds: of the robot's clock for the rest; None if it is not planned yet.
    drying: seconds of these in which layers dry.
    after: number of strokes of the rest, seconds until they are painted, and seconds of these in which a layer dries,
    for some of the strokes; between them the seconds grow evenly.
    pace: seconds that people wait per second of drying: 1 at a real easel, 0 in a studio that need not wait.
    """

    done: int
    strokes: int
    looks: tuple[int, ...] = ()
    replanning: int = 0
    planning: int = 0
    seconds: float | None = None
    drying: float = 0.0
    after: tuple[tuple[int, float, float], ...] = ()
    pace: float = 1.0


class PlanningStep(Event):
    """The planner made iteration `iteration` of `of`.

    phase: "plan" or "replan".
    picture: file of the plan so far, if one was drawn.
    parts: brush and current strokes of each part, in painting order.
    """

    phase: str
    iteration: int
    of: int
    loss: float
    picture: str = ""
    parts: tuple[tuple[str, Strokes], ...] = live()


class PlanAdopted(Durable):
    """Painting follows the plan with this digest, which has all strokes, from stroke `done` + 1 on.

    It is reported again after a look that kept the plan, with the newer placement.
    photograph: file of the photograph that the plan was made for.
    error, information: placement at that time.
    depths, lower, touch_information: touch heights, as in TouchHeights.
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


class Planned(Event):
    """A plan for all unpainted strokes is ready.

    done: strokes painted so far.
    strokes: in the new plan.
    loss_before, loss_after: expected loss of the old and of the new plan; at first, of the bare canvas.
    similarity: expected, least and most PSNR in dB of the painting to its photograph; None without one.
    look: file of the picture of the finished painting, if a look led to this plan.
    shown: pictures and paints of the plan for the page, as `draw_plan` tells them.
    expected [3, H, W]: canvas after the plan.
    """

    done: int
    strokes: int
    loss_before: float
    loss_after: float
    similarity: tuple[float, float, float] | None = None
    look: str = ""
    shown: dict[str, Any] = field(default_factory=dict)
    plan: Plan = live()
    expected: Tensor = live()

    @property
    def gain(self) -> float:
        """Share of the old loss that the new plan removes."""
        return 1 - self.loss_after / self.loss_before if self.loss_before > 0 else 0.0


# Work of the robot and of the people who help it.


class PaintsWanted(Event):
    """Paints of the next strokes ("#rrggbb"); painting continues after a person has filled their wells.

    ground: True if a person is to tone the bare canvas in this one colour.
    """

    colors: tuple[str, ...]
    ground: bool = False


class MotionBegan(Durable):
    """The robot will now get motions with these labels.

    stroke: number of the stroke that they paint, or None.
    """

    what: tuple[str, ...]
    stroke: int | None = None


class Dipped(Durable):
    """The brush took paint from well number `paint`, from 0.

    cleaned: True if the brush was rinsed and wiped before.
    """

    paint: int
    cleaned: bool = False


class StrokePainted(Durable):
    """Stroke number `done` (from 1) of `of` is on the canvas; `color` is its sRGB.

    `of` is 0 and the colour is black if they are unknown.
    """

    done: int
    of: int = 0
    color: tuple[float, float, float] = (0.0, 0.0, 0.0)


class StrokeLeftOut(Durable):
    """A person who paints by hand left out stroke number `done` (from 1) of `of`.

    It counts, but is not on the canvas.
    """

    done: int
    of: int = 0


class Drying(Durable):
    """A layer dries after `done` strokes; reported every minute until `left` is 0.

    left: seconds by the robot's clock; people wait `Scheduled.pace` times as long.
    """

    done: int
    left: float


class LayerBegun(Durable):
    """Layer number `layer` (from 1) begins or goes on; its brush and paints are ready.

    first_paint: palette number, from 0, of the paint in the first well.
    """

    layer: int
    brush: str
    first_paint: int = 0


class BrushInHand(Durable):
    """The robot holds this brush from now on: "" for none, None during a change."""

    brush: str | None


# Looks at the canvas.


class CanvasPicture(Durable):
    """Picture of the canvas after `done` strokes that decides about the rest.

    picture: its file; None if there was no room to keep it.
    by: "camera" for a photograph with the table, "person" for a picture of the whole canvas that a person took,
    "renderer" for the painted strokes on an easel without a camera.
    content: sha256 of the file.
    light: light of the room, [3, terms], if a camera saw it.
    canvas [3, H, W]: the picture, but for a photograph.
    """

    picture: str | None
    done: int
    by: Literal["camera", "person", "renderer"] = "camera"
    content: str | None = None
    light: list[list[float]] | None = None
    canvas: Tensor = live()


class TimelapseFrame(Event):
    """Rectified photograph for the film, sRGB bytes [H, W, 3], and its file."""

    done: int
    of: int
    color: tuple[float, float, float]
    picture: str | None = None
    photograph: Bytes = live()


class Looked(Event):
    """The painter looked at the canvas after `done` strokes.

    pictures: files of the canvas as it was "seen" and "expected", and of their "difference"; empty if there was no
    room for them.
    photograph, expected [3, H, W]: rectified photograph, and the expected picture.
    """

    done: int
    pictures: dict[str, str] = field(default_factory=dict)
    photograph: Tensor = live()
    expected: Tensor = live()


# Pauses, and what a person does in them.

PauseCause = Literal["person", "button", "turn", "trouble"]
PEN_LIMITS: tuple[tuple[str, float, float], ...] = (
    ("place from the left", -1.0, 2.0), ("place from the top", -1.0, 2.0), ("press", 0.0, 1.0),
    ("tilt", 0.0, math.pi / 2), ("direction of its tilt", -100.0, 100.0), ("time", 0.0, 600.0),
)  # fmt: skip
"""Values of each point of a pen: name, least and greatest value; see together.turns.PenStroke."""


class Paused(Event):
    """The painting waits for a person; the arm is at home and the brush is clean. `reason` is a sentence.

    cause: "person" if a person asked for the pause, "button" if somebody pressed the machine's pause button, "turn" if
    it is the person's turn to paint, "trouble" if something is wrong.
    """

    reason: str
    done: int = 0
    cause: PauseCause = "trouble"


class WentOn(Event):
    """A pause has ended."""


class CommandTaken(Durable):
    """The painter does what a person asked for; if it breaks off meanwhile, a resumed painting does it.

    command: in the form of together.commands; empty if the last one is done, or was refused.
    """

    command: dict[str, Any]


@dataclass(frozen=True)
class Turns:
    """Robot and person take turns of this many strokes or minutes; 0: no turns.

    policy, keep: how the robot answers what the person painted; see together.policies.
    """

    strokes: int
    minutes: float = 0.0
    policy: str = "alternate"
    keep: Literal["welcome", "protect"] = "protect"
    kind: Literal["turns"] = "turns"


@dataclass(frozen=True)
class DrawnRegion:
    """A person drew a region: no stroke may touch it, or, with `only`, strokes may be only there.

    drawing: its file in `regions` of the painting's folder. None: nothing is protected any more.
    """

    drawing: str | None
    only: bool = False
    kind: Literal["region"] = "region"


@dataclass(frozen=True)
class NewGoal:
    """A person changed the goal.

    folder: of the goal, in the painting's folder.
    wish: goals and goals of the start, as the page asked for them; empty if it did not.
    done: number of painted strokes.
    facts: descriptions of the goal, and of how its pictures were made.
    """

    folder: str
    wish: dict[str, Any]
    done: int = 0
    facts: tuple[str, ...] = ()
    kind: Literal["goal"] = "goal"


@dataclass(frozen=True)
class MadePictures:
    """A maker made pictures of words, to choose from.

    maker: label of the maker
    pictures: of each its file for the page, its file and folder of the making, and its seed; in a painting, the file is
    in the painting's folder, and a person chooses one in the pause, or goes on without
    best: index of the best one, by a rule that `rule` tells
    faults: sentences about pictures that were left out
    """

    words: str
    maker: str
    pictures: list[dict[str, Any]]
    best: int
    rule: str
    faults: list[str]
    kind: Literal["pictures"] = "pictures"


class CommandDone(Durable):
    """Result of a command: it is there, or in force from now on."""

    result: Annotated[Turns | DrawnRegion | NewGoal | MadePictures, Field(discriminator="kind")]


class PersonMayPaint(Event):
    """A person may paint on the canvas now.

    brushes: name of each brush, and the widths of its marks in metres: `light` and `hard`.
    wells: paints in the wells, as "#rrggbb".
    """

    brushes: list[dict[str, Any]]
    wells: list[str]


class StrokeOfPerson(Durable):
    """A person's stroke on the canvas of a simulated easel: told before it is painted, and again when it is.

    number: from 1, over the whole painting.
    stroke: as in hardware.easel.PersonStroke.
    color: sRGB of its paint.
    """

    number: int
    stroke: dict[str, Any]
    color: tuple[float, float, float]
    painted: bool = False


# End of a painting.


class Finished(Durable):
    """All `done` strokes are done.

    robot_seconds: seconds of the robot's clock in this run.
    """

    done: int
    robot_seconds: float = 0.0


Notify = Callable[[Event], None]
"""Function that hears every event of a painting, such as each of the `listeners` of PaintingRun."""


def kind_of(event: type[Event]) -> str:
    """Returns the name of a class of events in records: stroke_painted for StrokePainted."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", event.__name__).lower()


KINDS: Mapping[str, type[Event]] = {
    kind_of(each): each for each in (*Event.__subclasses__(), *Durable.__subclasses__()) if each is not Durable
}


def record(event: Event) -> dict[str, Any]:
    """Returns the JSON form of an event, without its live fields, with the current time."""
    at = datetime.now(UTC).isoformat(timespec="milliseconds")
    dropped, told = _live_fields(kind_of(type(event))), asdict(event.without_live())
    return {"kind": kind_of(type(event)), "at": at, **{name: told[name] for name in told if name not in dropped}}


def events_of(written: dict[str, Any]) -> list[Event]:
    """Returns the event of a record; before it, or in its place, `Unknown` if a newer program wrote more than is known.

    Raises ValueError if a resumed painting needs the event (`Durable`), and a field is missing or has a wrong type.
    """
    name = str(written.get("kind"))
    if name not in KINDS:
        return [Unknown()]
    read, known = _reader(name)
    try:
        event = read(written)
    except ValueError:
        if issubclass(KINDS[name], Durable):
            raise
        return [Unknown()]
    return [event] if known.issuperset(written) else [Unknown(), event]


def time_of(written: Mapping[str, Any]) -> datetime | None:
    """Returns the time at which a record was written; None without a valid one, with its offset from UTC."""
    try:
        at = datetime.fromisoformat(str(written.get("at")))
    except ValueError:
        return None
    return at if at.utcoffset() is not None and datetime.min.year < at.year < datetime.max.year else None


@functools.cache
def _reader(kind: str) -> tuple[Callable[[dict[str, Any]], Event], frozenset[str]]:
    """Returns the function that reads records of a kind, and all keys that they may have."""
    known = {"kind", "at", "format", "version", *(each.name for each in fields(KINDS[kind]))}
    return TypeAdapter(KINDS[kind]).validator.validate_python, frozenset(known)


@functools.cache
def _live_fields(kind: str) -> frozenset[str]:
    return frozenset(each.name for each in fields(KINDS[kind]) if each.metadata)
