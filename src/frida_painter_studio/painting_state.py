"""State of a painting from its first request to the last stroke, and its one status.

The state is computed from the painting's events alone. Its status also says what the events cannot know: if a process
is at work on the painting, and if its files are there. Every view of the studio shows this status.
"""

import shutil
from dataclasses import asdict, dataclass, field
from datetime import datetime
from typing import Any, Literal, Self, cast

from frida_painter.easel.kinds import JOURNAL
from frida_painter.session import events, making_events, person_events
from frida_painter.session.events import PauseCause, Written
from frida_painter_studio.pace import WorkTimes
from frida_painter_studio.studio_folder import PaintingFolder, working

# Status of a painting: one function of its state and of the facts.

_VANISHED = "The {}'s process ended in the middle of its work, without saying why."
_LITTLE_ROOM = 64 * 2**20  # bytes


@dataclass(frozen=True)
class Truth:
    """Facts about a painting that its events cannot tell.

    working: True if a process holds the painting's lock. Only this process can move the robot.
    here: True if the painting's folder exists, with its events.
    begun: True if the painting has a journal, from which it can be resumed.
    room: True if the disk has room.
    """

    working: bool
    here: bool = True
    begun: bool = True
    room: bool = True

    @classmethod
    def of(cls, folder: PaintingFolder) -> Self:
        """Returns the facts about a painting, or about the calibration."""
        try:
            room = shutil.disk_usage(folder.path.parent).free >= _LITTLE_ROOM
        except OSError:
            room = True
        # A painter may write a last picture after its folder was deleted, but no feed.
        here = folder.path.is_dir() and (folder.feed.is_file() or not folder.painting.exists())
        return cls(working(folder), here, (folder.painting / JOURNAL).is_file(), room)

    @property
    def suspicion(self) -> str:
        """Sentence about the probable cause of a process that ended without a word."""
        if not self.room:
            return "The studio's disk is full: make room first."
        return "It may have been killed, or the machine had too little memory or was switched off."

    def explain(self, ended: bool, said: str, remedy: str) -> str:
        """Returns the sentences for a process that ended without an event; "" if it works or told its end.

        said, remedy: sentences before and after the probable cause
        """
        return "" if self.working or ended else f"{said} {self.suspicion} {remedy}"


Stage = Literal[
    "waiting", "planning", "plan stopped", "plan failed", "planned", "queued",
    "preparing", "mixing", "painting", "drying", "replanning", "paused", "finishing", "finished", "stopped", "failed",
    "lost",
]  # fmt: skip


@dataclass(frozen=True)
class Status:
    """Status of a painting, the same on every view.

    stage: "waiting" and "queued" wait to be planned and to be painted; "lost" has no folder any more. The others say
    what is being done, or how it ended.
    trouble: sentence about what went wrong, and what to do; "" if nothing did.
    resumable: True if the painting can be continued.
    working: True if a process works, which may hold the robot.
    """

    stage: Stage
    working: bool
    trouble: str = ""
    resumable: bool = False


def tell_status(state: "PaintingState", truth: Truth) -> Status:
    """Returns the status of a painting: the only place where it is decided."""
    stage, trouble = _find_stage(state, truth), state.trouble
    resumable = stage in ("stopped", "failed") and truth.begun and not truth.working
    if stage == "lost":
        held = "Its painter still works, and may move the robot: press Stop."
        trouble = f"The folder of this painting was deleted. {held if truth.working else 'Nothing of it is left.'}"
    elif not trouble and stage == "failed":
        kept = "What is painted is kept." if resumable else "Nothing was painted yet."
        trouble = f"{_VANISHED.format('painter')} {truth.suspicion} {kept}"
    elif not trouble and stage in ("planned", "plan failed") and _plan_statuses(state, truth)[-1:] != ["stopped"]:
        vanished = any(plan.status == "planning" for plan in state.plans.values())
        trouble = f"{_VANISHED.format('planner')} {truth.suspicion}" if vanished else ""
    return Status(stage, truth.working, trouble, resumable)


def _find_stage(state: "PaintingState", truth: Truth) -> Stage:
    if not truth.here:
        return "lost"
    if state.painting is not None:
        status = state.painting.status
        if not truth.working and status not in _ENDS:
            return "failed"
        return "replanning" if status == "planning" else cast(Stage, status)
    if state.queued:
        return "waiting" if state.queued == "plan" else "queued"
    found = _plan_statuses(state, truth)
    if found[-1:] == ["planning"]:
        return "planning"
    if "ready" in found:
        return "planned"
    return "plan stopped" if found[-1:] == ["stopped"] else "plan failed"


def _plan_statuses(state: "PaintingState", truth: Truth) -> list[str]:
    return [plan_status(plan, state, truth) for plan in state.plans.values()]


def plan_status(plan: "PlanState", state: "PaintingState", truth: Truth) -> str:
    """Returns the status of a plan; a planner that ended without a word has failed."""
    if plan.status != "planning" or truth.working:
        return plan.status
    return "stopped" if state.stopped else "failed"


# State of a painting, computed from its events.

_MAX_LOOKS = 200


@dataclass
class PlanState:
    """State of one plan.

    status: "waiting", "planning", "ready", "failed" or "stopped". The other fields: as the worker reports them.
    said: progress in words, before that in numbers.
    """

    number: int
    wish: dict[str, Any]
    status: str = "planning"
    share: float = 0.0
    left: float | None = None
    said: str = ""
    growing: str | None = None
    nearer: float = 0.0
    made: dict[str, Any] | None = None


@dataclass
class PaintState:
    """State of the painting process.

    status: "preparing", "mixing", "painting", "drying", "planning", "paused", "finishing", "finished", "stopped" or
    "failed".
    said: progress in words while it is being prepared.
    dries: seconds that the paint still dries, 0 if nothing waits for it.
    plan: number of its plan.
    held: True in a pause, also while a command is performed there.
    reason, cause: of the last pause.
    turns: strokes of the robot's turn, 0 without turns.
    game: minutes of the robot's turn, turn policy, and what becomes of the person's paint.

    region: protected region.
    remark: reason why a command could not be done as asked.
    wish: request of a changed goal.
    making: words of the pictures that are being made, which begin from the canvas; None if none are.
    proposed: pictures to choose one from; None if there are none.
    brush: brush in the hand, "" for none.
    first_paint: palette number, from 0, of the paint in the first well.
    paint: palette number of the paint on the brush, from 0.
    dips: number of dips into each paint.
    since_dip: strokes since the last dip.

    looks: looks in order: seen, expected and replanned. Each has a reason `why`: "region", "only", "freed", "goal"
    or "asked" for a person's command, else ""; and `found`, a picture that outlines what a person painted, if any.
    person: brushes and wells for a person who paints through the page, and the number of their strokes; None if
    nobody can.
    film, arm, kept: True if there is a film, a film of a simulated arm, and all other results.
    painters: True if the results tell who painted what.
    """

    plan: int
    of: int
    status: str = "preparing"
    done: int = 0
    left: float | None = None
    said: str = ""
    dries: float = 0.0
    share: float = 0.0
    photograph: str | None = None
    growing: str | None = None
    brush: str = ""
    first_paint: int = 0
    paint: int | None = None
    dips: dict[int, int] = field(default_factory=dict)
    since_dip: int = 0
    reason: str = ""
    looks: list[dict[str, Any]] = field(default_factory=list)
    replanned: dict[str, Any] | None = None
    held: bool = False
    cause: PauseCause | None = None
    turns: int = 0
    game: dict[str, Any] = field(default_factory=lambda: {"minutes": 0.0, "policy": "alternate", "keep": "welcome"})
    region: dict[str, Any] | None = None
    remark: str = ""
    wish: dict[str, Any] | None = None
    making: str | None = None
    proposed: making_events.PicturesMade | None = None
    why: str = ""  # reason of the next look
    person: dict[str, Any] | None = None
    film: bool = False
    arm: bool = False
    kept: bool = False
    painters: bool = False


@dataclass
class PaintingState:
    """State of a painting from the first request to the last stroke.

    trouble: sentence about the last error, until other work begins.
    stopped: True after a stop.
    queued: "plan" or "paint" if this job waits in the studio's queue, else "".
    question: open question, in the form of painter.py.
    version: number that grows with every event.
    times: what its work took.
    """

    plans: dict[int, PlanState] = field(default_factory=dict)
    painting: PaintState | None = None
    trouble: str = ""
    stopped: bool = False
    queued: str = ""
    question: dict[str, Any] | None = None
    version: int = 0
    times: WorkTimes = field(default_factory=WorkTimes)

    def hear(self, event: Written, at: datetime | None = None) -> None:
        """Updates the state by an event, written at that time; other events change nothing."""
        self.version += 1
        if at is not None:
            self.times.hear(event, at)
        match event:
            case events.PlanRequested(number, wish):
                self._end_plans("stopped" if self.stopped else "failed")
                self._forget_trouble()
                self.plans[number] = PlanState(number, wish)
            case events.PlanningProgress() | events.PlanPreview() | events.PlanMade() if event.plan is not None:
                if event.plan in self.plans:
                    _hear_plan(self.plans[event.plan], event)
            case events.Queued(plan, job):
                self.queued = job
                if job == "plan" and plan in self.plans:
                    self.plans[plan].status = "waiting"
            case events.Dequeued(plan, begun):
                self.queued = ""
                if plan in self.plans and self.plans[plan].status == "waiting":
                    self.plans[plan].status = "planning" if begun else "stopped"
            case events.ProcedureProgress(words) if self.painting is None:
                for each in self.plans.values():
                    each.said = words if each.status == "planning" else ""
            case events.Asked(question):
                self.question = question
            case events.Answered():
                self.question = None
            case events.PaintingStarted(plan, of):
                self._forget_trouble()
                self.painting = PaintState(plan, of)
            case events.Failed(reason):
                self.trouble = reason
                self._end("failed")
            case events.Stopped():
                self.stopped = True
                self._end("stopped")
            case _ if self.painting is not None:
                if isinstance(event, events.TakenUp):
                    self._forget_trouble()
                _hear_painting(self.painting, event)
                if isinstance(event, events.PaintingKept) and self.stopped:
                    self.painting.status = "stopped"
            case _:
                pass

    def to_plain(self, truth: Truth) -> dict[str, Any]:
        """Returns the state with its status as plain values."""
        status = tell_status(self, truth)
        plans = [asdict(plan) | {"status": plan_status(plan, self, truth)} for plan in self.plans.values()]
        painting = None if self.painting is None else asdict(self.painting)
        if painting is not None and not truth.working and painting["status"] not in _ENDS:
            painting |= {"status": "failed", "left": None}
        return {
            "version": self.version,
            **asdict(status),
            "stopped": self.stopped,
            "queued": self.queued,
            "question": self.question if truth.working else None,
            "plans": plans,
            "painting": painting,
        }

    def _forget_trouble(self) -> None:
        self.trouble, self.stopped, self.question = "", False, None

    def _end_plans(self, how: str) -> None:
        for plan in self.plans.values():
            if plan.status == "planning":
                plan.status = how

    def _end(self, how: str) -> None:
        self._end_plans(how)
        if self.painting is not None and self.painting.status not in _ENDS:
            self.painting.status = how


def _hear_plan(plan: PlanState, event: events.PlanningProgress | events.PlanPreview | events.PlanMade) -> None:
    match event:
        case events.PlanningProgress(share, left):
            plan.share, plan.left, plan.said = share, left, ""
        case events.PlanPreview(picture):
            plan.growing = picture
        case events.PlanMade():
            plan.status, plan.share, plan.left, plan.nearer = "ready", 1.0, None, event.nearer
            plan.made = {name: getattr(event, name) for name in _MADE}


def _hear_painting(painting: PaintState, event: Written) -> None:
    painting.status = _STATUS.get(type(event), painting.status)
    if isinstance(event, events.LookShown | events.WentOn | events.RestReplanned):
        painting.remark = ""
    if isinstance(event, events.Paused | events.WentOn | events.TakenUp):
        painting.held, painting.making = isinstance(event, events.Paused), None
    match event:
        case events.ProcedureProgress(words):
            painting.said = words
        case events.TakenUp(done):
            painting.done, painting.film, painting.kept = done, False, False
        case events.LayerBegun(brush=brush, first_paint=first):
            painting.brush, painting.first_paint, painting.paint = brush, first, None
        case events.BrushInHand(brush):
            painting.brush = brush or ""
        case events.Dipped(well):
            paint = painting.first_paint + well
            painting.paint, painting.since_dip = paint, 0
            painting.dips[paint] = painting.dips.get(paint, 0) + 1
        case events.Drying(left=seconds):
            painting.dries = seconds
        case events.StrokePainted(done, of) | events.StrokeLeftOut(done, of):
            painting.done, painting.of = done, of or painting.of
            painting.since_dip += isinstance(event, events.StrokePainted)
        case events.TimeLeft(seconds):
            painting.left = seconds
        case events.PhotographShown(picture):
            painting.photograph = picture
        case events.LookShown():
            painting.growing = None
            painting.looks = [*painting.looks[-_MAX_LOOKS:], {**asdict(event), "why": painting.why}]
            painting.why = ""
        case events.TouchCorrected() | events.LastLookDoubted() if painting.looks:
            told = [*painting.looks[-1].get("touch", []), event.sentence]
            painting.looks[-1] = {**painting.looks[-1], "touch": told}
        case events.Considering():
            painting.why = "asked"
        case events.PlanningProgress(share, left):
            painting.share, painting.left = share, left
        case events.PlanPreview(picture):
            painting.growing = picture
        case events.RestReplanned():
            painting.growing, painting.share = None, 0.0
            painting.replanned = {name: getattr(event, name) for name in _REPLANNED}
            if painting.looks and painting.looks[-1]["done"] == event.done and "gain" not in painting.looks[-1]:
                more = {"gain": event.gain, "plan": f"{event.prefix}plan.jpg"}
                painting.looks[-1] = {**painting.looks[-1], **more}
        case events.Paused(reason=reason, cause=cause):
            painting.reason, painting.cause, painting.why = reason, cause, ""
        case events.Turns(strokes):
            painting.turns = strokes
            painting.game = {"minutes": event.minutes, "policy": event.policy, "keep": event.keep}
        case person_events.RegionProtected(only=only, picture=picture):
            painting.region = {"picture": picture, "only": only} if picture else None
            painting.why = ("only" if only else "region") if picture else "freed"
        case person_events.GoalChanged(wish=wish):
            painting.wish, painting.why, painting.proposed = wish, "goal", None
        case making_events.MakingStarted(words):
            painting.making, painting.said = words, ""
        case making_events.PicturesMade():
            painting.making, painting.proposed = None, event
        case events.WentOn():
            painting.proposed = None
        case events.PersonMayPaint(brushes, wells):
            strokes = 0 if painting.person is None else painting.person["strokes"]
            painting.person = {"brushes": brushes, "wells": wells, "strokes": strokes}
        case person_events.PersonStrokePainted(number):
            painting.person = {"brushes": [], "wells": [], **(painting.person or {}), "strokes": number}
            painting.remark = ""
        case person_events.PersonPaintShown(picture) if painting.looks:
            painting.looks[-1] = {**painting.looks[-1], "found": picture}
        case events.Remark(sentence):
            painting.remark = sentence
        case events.PaintingKept(film, arm, painters):
            painting.film, painting.arm, painting.left, painting.kept = film, arm, 0.0, True
            painting.painters = painters
        case _:
            pass


_MADE = ("prefix", "frames", "strokes", "palette", "mixtures", "mixing", "remarks", "seconds")
_REPLANNED = ("prefix", "frames", "strokes", "palette", "done")
# Status of a painting after an event; other events do not change it.
_STATUS: dict[type[Written], str] = {
    events.TakenUp: "preparing",
    events.Mixing: "mixing",
    events.Dipped: "painting",
    events.Drying: "drying",
    events.StrokePainted: "painting",
    events.StrokeLeftOut: "painting",
    events.LookShown: "planning",
    events.PlanningProgress: "planning",
    events.RestReplanned: "painting",
    events.Paused: "paused",
    events.Considering: "planning",
    events.WentOn: "painting",
    events.Finishing: "finishing",
    events.PaintingKept: "finished",
}
_ENDS = ("finished", "stopped", "failed")
