"""Jobs of the studio beside paintings: calibration, setup of a machine, teaching a stroke, making pictures from words.

Each is a request of the page, a worker that does it, and a feed. Its state is computed from its feed alone.
"""

from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass, field
from datetime import datetime
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import AfterValidator, Field, model_validator

from frida_painter.session import events
from frida_painter.session.events import Event
from frida_painter.system.storage import file_name
from frida_painter_studio.painting_state import Truth
from frida_painter_studio.picture_choosing import MAX_MAKINGS
from frida_painter_studio.studio_folder import Brush, CanvasSides
from frida_painter_together.inbox import KeptRequest, MakingOrder

# Requests of the page; the worker reads them from the job's folder.

Procedure = Literal["canvas", "robot", "color", "brush", "strokes"]
PROCEDURES: tuple[Procedure, ...] = get_args(Procedure)
StepName = Literal["canvas", "touch", "surface", "paint", "trace", "strokes"]
"""Names of the steps, as in procedures/workspace.py, which the web process must not load."""
_MIN_MARKS, _MAX_MARKS = 10, 60
_MAX_POINTS = 400  # of a mark; the page sends only those that it needs
_Place = Annotated[float, Field(ge=-1000, le=1000)]
_Press = Annotated[float, Field(ge=0, le=1)]
_Seconds = Annotated[float, Field(ge=0, le=600)]
_Mark = Annotated[list[tuple[_Place, _Place, _Press, _Seconds]], Field(min_length=1, max_length=_MAX_POINTS)]


class CalibrationRequest(KeptRequest, CanvasSides):
    """Request for a calibration.

    what: procedures, in order.
    brush, width, height, seed: brush, canvas in mm and seed of a simulated easel.
    count: number of strokes in the strokes procedure.
    """

    _name = "what is to be calibrated"

    what: tuple[Procedure, ...] = Field(min_length=1, max_length=5)
    brush: Brush = "broad"
    seed: int = Field(0, ge=0, le=2**31 - 1)
    count: int = Field(60, ge=20, le=1000)

    @model_validator(mode="after")
    def _once_and_in_order(self) -> Self:
        if list(self.what) != [name for name in PROCEDURES if name in self.what]:
            raise ValueError("Each procedure is done once, in the order canvas, robot, color, brush, strokes.")
        return self


class SetupRequest(KeptRequest):
    """Request for the setup of a machine.

    easel: name of the setup that goes on; None to choose a machine.
    width, height: of the canvas in mm; None to mark three corners.
    brush: in the holder; None for the fine one, or that of the setup that goes on.
    step: the one to repeat.
    anew: True to begin from the start, even if a setup of this machine was left.
    """

    _name = "the machine to set up"

    easel: str | None = Field(None, pattern=r"^[A-Za-z0-9][A-Za-z0-9 _-]{0,60}$")
    width: float | None = Field(None, ge=50, le=2000)
    height: float | None = Field(None, ge=50, le=2000)
    brush: Brush | None = None
    step: StepName | None = None
    anew: bool = False

    @model_validator(mode="after")
    def _has_both_sides(self) -> Self:
        if (self.width is None) != (self.height is None):
            raise ValueError("Give both sides of the canvas, or none: three corners are then marked.")
        return self


def _require_file_name(name: str) -> str:
    if name != file_name(name):
        raise ValueError(f"No file can be named {name!r} on Windows; give the family another name.")
    return name


class TeachingRequest(KeptRequest):
    """Request to learn a stroke family from marks.

    name: of the family.
    brush: that paints it.
    marks: points (x, y, press, seconds) of each, in mm, y up.
    count: strokes that the virtual studio paints to learn from; 0 for none.
    """

    _name = "the stroke to teach"

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9-]{0,29}$"), AfterValidator(_require_file_name)]
    brush: Brush = "fine"
    marks: list[_Mark] = Field(min_length=_MIN_MARKS, max_length=_MAX_MARKS)
    count: int = Field(40, ge=0, le=200)


# States, computed from feeds.


@dataclass
class JobState(ABC):
    """State of a job.

    question: open question, in the form of together.asking.
    progress: in words.
    trouble: sentence about the last error.
    ended: False from its beginning until it has said how it ended.
    version: number that grows with every event.

    name: of its folder, its routes, its topic and its first event, and the worker's name for it.
    request: form of its request.
    told: fields of its request that its first event tells.
    ends: names of the results that end it.
    process, remedy: words about a process that vanished.
    moves: "always" if it moves a machine at every easel, "easel" if it moves the studio's, "never".
    """

    name: ClassVar[str]
    request: ClassVar[type[KeptRequest]]
    told: ClassVar[tuple[str, ...]] = ()
    ends: ClassVar[tuple[str, ...]] = ()
    process: ClassVar[str]
    remedy: ClassVar[str]
    moves: ClassVar[Literal["always", "easel", "never"]] = "never"

    question: dict[str, Any] | None = None
    progress: str = ""
    trouble: str = ""
    stopped: bool = False
    ended: bool = True
    version: int = 0

    @classmethod
    def begin(cls, request: Any) -> events.Began:
        """Returns the first event of a requested job."""
        return events.Began(cls.name, detail=request.model_dump(mode="json", include=set(cls.told)))

    def hear(self, event: Event, at: datetime | None = None) -> None:
        """Updates the state by an event; other events change nothing."""
        self.version += 1
        match event:
            case events.Advanced(words):
                self.progress = words
            case events.Asked(question):
                self.question = question
            case events.Stopped(reason):
                self.trouble, self.stopped = reason or self.trouble, self.stopped or not reason
            case events.Began(what) if what == self.name:
                self.progress, self.trouble, self.stopped, self.ended, self.question = "", "", False, False, None
        found = isinstance(event, events.ResultFound) and event.what in self.ends
        if found or isinstance(event, events.Stopped | events.CommandDone):
            self.ended, self.question = True, None
        self._hear(event)

    def to_plain(self, truth: Truth) -> dict[str, Any]:
        """Returns the state as plain values; a process that ended without an event is reported as an error."""
        said = f"The process that {self.process} ended in the middle of its work, without saying why."
        return {
            "version": self.version,
            "working": truth.working,
            "question": self.question if truth.working else None,
            "progress": self.progress if truth.working else "",
            "stopped": self.stopped,
            "trouble": self.trouble or truth.explain(self.ended, said, self.remedy),
            **self._details(truth.working),
        }

    @abstractmethod
    def _hear(self, event: Event) -> None:
        """Updates the details of this kind of job."""

    def _details(self, working: bool) -> dict[str, Any]:
        """Returns the details of this kind of job as plain values."""
        return {}


@dataclass
class ProcedureState:
    """State of one procedure in this or the last calibration.

    status: "", "waiting", "busy", "done", "failed" or "stopped".
    sentence, picture: its result.
    dated: date of its entry in the record, None if there is none.
    fault: reason to repeat it.
    old: True if it is old.
    """

    name: str
    status: str = ""
    sentence: str = ""
    picture: str | None = None
    dated: str | None = None
    fault: str = ""
    old: bool = False


@dataclass
class CalibrationJob(JobState):
    """State of all procedures of an easel."""

    name, request, told = "calibration", CalibrationRequest, ("what",)
    process, remedy, moves = "calibrated", "Run the procedure again.", "easel"

    easel: str = ""
    procedures: dict[str, ProcedureState] = field(
        default_factory=lambda: {name: ProcedureState(name) for name in PROCEDURES}
    )

    def _hear(self, event: Event) -> None:
        named = getattr(event, "name", "")
        each = self.procedures.get(named, ProcedureState(named))  # another version may know more procedures
        match event:
            case events.Began(self.name, detail=detail):
                for known in self.procedures.values():
                    known.status = "waiting" if known.name in detail.get("what", ()) else ""
            case events.Began("procedure") if named in self.procedures:
                each.status, self.progress = "busy", ""
            case events.ResultFound("status", detail=stands):
                each.dated, each.fault = stands.get("dated"), stands.get("fault", "")
                self.easel, each.old = stands.get("easel", ""), stands.get("old", False)
            case events.ResultFound("procedure", detail=found):
                each.sentence, each.picture, each.status = found.get("sentence", ""), found.get("picture"), "done"
            case events.Stopped():
                for known in self.procedures.values():
                    known.status = {"busy": event.how, "waiting": ""}.get(known.status, known.status)
        self.ended = not any(known.status in ("waiting", "busy") for known in self.procedures.values())

    def _details(self, working: bool) -> dict[str, Any]:
        ended = {} if working else {"busy": "failed", "waiting": ""}
        procedures = [asdict(each) for each in self.procedures.values()]
        return {
            "easel": self.easel,
            "procedures": [each | {"status": ended.get(each["status"], each["status"])} for each in procedures],
        }


_MAX_REMARKS = 6


@dataclass
class Setup(JobState):
    """State of the setup of a machine.

    stands: "title" and "robot" of the machine, its "easel", its "steps" ("name", "text" and "done" of each, in order),
    and its "table" ("lower", "upper", "canvas" (four corners), "wells", "water" and "rag", in millimetres of the
    robot's frame); None before a machine was chosen.
    step: name of the current step, "" before the first one.
    facts: what the controller told: "text" and "weight" of each ("fact", "warning" or "refusal").
    remarks: the newest sentences of the setup.
    written: files of the finished setup ("workspace", "record", and "sheet", a picture of it), and "commands" that
    use them ("about" and "command" of each).
    left: sentence about a setup that was left.
    """

    name, request, ends = "setup", SetupRequest, ("setup", "left")
    process, remedy, moves = "set up the machine", "Continue the setup.", "always"

    stands: dict[str, Any] | None = None
    step: str = ""
    facts: list[dict[str, str]] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    written: dict[str, Any] | None = None
    left: str = ""

    def _hear(self, event: Event) -> None:
        match event:
            case events.Began(self.name):
                self.step, self.facts, self.remarks, self.written, self.left = "", [], [], None, ""
            case events.Began("step", name):
                self.step, self.remarks = name, []
            case events.ResultFound("machine", detail=stands):
                self.stands = stands
            case events.ResultFound("facts", detail=told):
                self.facts = told.get("facts", [])
            case events.Remark(sentence):
                self.remarks = [*self.remarks, sentence][-_MAX_REMARKS:]
            case events.ResultFound("setup", detail=written):
                self.written = written
            case events.ResultFound("left", name):
                self.left = name

    def _details(self, working: bool) -> dict[str, Any]:
        told = {name: getattr(self, name) for name in ("stands", "facts", "remarks", "written", "left")}
        return {**told, "step": self.step if working else ""}


@dataclass
class Teaching(JobState):
    """State of teaching a stroke.

    family: name of the family that is being learned, or was learned last.
    taught: families that were learned here, by name: sentence, brush and picture of each.
    """

    name, request, told, ends = "teaching", TeachingRequest, ("name",), ("family",)
    process, remedy = "learned the stroke", "Teach it again."

    family: str = ""
    taught: dict[str, dict[str, str]] = field(default_factory=dict)

    def _hear(self, event: Event) -> None:
        match event:
            case events.Began(self.name, detail=asked):
                self.family = str(asked.get("name", ""))
            case events.ResultFound("family", name, detail=learned):
                self.taught[name] = learned

    def _details(self, working: bool) -> dict[str, Any]:
        return {"name": self.family, "taught": self.taught}


@dataclass
class Imagining(JobState):
    """State of making pictures from words.

    words, maker: of the making that is at work, or was last.
    makings: the last ones, in order.
    """

    name, request, told = "imagining", MakingOrder, ("words", "label")
    process, remedy = "made pictures", "Make them again."

    words: str = ""
    maker: str = ""
    makings: list[events.MadePictures] = field(default_factory=list)

    def _hear(self, event: Event) -> None:
        match event:
            case events.Began(self.name, detail=order):
                self.words, self.maker = str(order.get("words", "")), str(order.get("label", ""))
            case events.CommandDone(events.MadePictures() as made):
                self.makings = [*self.makings, made][-MAX_MAKINGS:]

    def _details(self, working: bool) -> dict[str, Any]:
        makings = [
            {**asdict(made), "pictures": [{name: one[name] for name in ("picture", "seed")} for one in made.pictures]}
            for made in self.makings
        ]  # without the files of this machine
        return {"words": self.words, "maker": self.maker, "makings": makings}


JOBS: dict[str, type[JobState]] = {job.name: job for job in (CalibrationJob, Setup, Teaching, Imagining)}
