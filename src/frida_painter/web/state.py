"""What a painting looks like from outside: everything the page shows of it, folded from the feed and nothing else."""

from dataclasses import asdict, dataclass, field
from typing import Any

from frida_painter.session.events import (
    BrushInHand,
    Dipped,
    Drying,
    Failed,
    GoalChanged,
    LastLookDoubted,
    LayerBegun,
    Paused,
    RegionProtected,
    Stopped,
    StrokeLeftOut,
    StrokePainted,
    TouchCorrected,
    Written,
)
from frida_painter.session.page_events import (
    Answered,
    Asked,
    Considering,
    Dequeued,
    Finishing,
    LookShown,
    Mixing,
    PaintingKept,
    PaintingStarted,
    PhotographShown,
    PlanMade,
    PlanningProgress,
    PlanPreview,
    PlanRequested,
    Queued,
    Remark,
    RestReplanned,
    TakenUp,
    TimeLeft,
    Turns,
    WentOn,
)

_MOST_LOOKS = 200


@dataclass
class PlanState:
    """One plan: status is "waiting", "planning", "ready", "failed" or "stopped"; the rest as the worker tells it."""

    number: int
    wish: dict[str, Any]
    status: str = "planning"
    share: float = 0.0
    left: float | None = None
    growing: str | None = None
    nearer: float = 0.0
    made: dict[str, Any] | None = None


@dataclass
class PaintState:
    """The painting itself; status: "preparing", "mixing", "painting", "drying", "planning", "paused", "finishing",
    "finished", "stopped" or "failed"; dries: seconds for which the paint still dries, 0 where nothing waits for it.

    plan: the number it was painted from; held: whether it waits for a person, also while it does what they asked for
    in the pause; turn: whether it is the person's turn; turns: strokes after which it is, 0 where nobody takes turns;
    region: what is protected; remark: what could not be done as it was asked; wish: as it was changed in the middle;
    brush: the one in the hand, "" where none is; first_paint: the plan's number, from 0, of what is in the
    first well; paint: which the brush carries, from 0; dips: into each paint so far; since_dip: strokes since
    the last one;
    looks: what was seen, expected and planned again, in order, each with `why`: "region", "only", "freed", "goal" or
    "asked" where a person wanted it, "" for one of the painter's own; film, arm, kept: whether there is a film, one
    of a simulated arm at work, and all else that is kept of a painting.
    """

    plan: int
    of: int
    status: str = "preparing"
    done: int = 0
    left: float | None = None
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
    turn: bool = False
    turns: int = 0
    region: dict[str, Any] | None = None
    remark: str = ""
    wish: dict[str, Any] | None = None
    why: str = ""  # for what the next look is
    film: bool = False
    arm: bool = False
    kept: bool = False


@dataclass
class PaintingState:
    """A painting from the first request to the last stroke.

    title, seen: version of this state; working: whether a process is at work; trouble: the last
    sentence about what went wrong, until something else is begun; question: what a person is asked, as
    web/asking.py tells; queued: "plan" or "paint" where that waits in the studio's queue, else "".
    """

    plans: dict[int, PlanState] = field(default_factory=dict)
    painting: PaintState | None = None
    trouble: str = ""
    stopped: bool = False
    queued: str = ""
    question: dict[str, Any] | None = None
    version: int = 0

    def hear(self, event: Written) -> None:
        """Takes note of an event; one that does not concern it changes nothing."""
        self.version += 1
        match event:
            case PlanRequested(number, wish):
                self._forget_trouble()
                self.plans[number] = PlanState(number, wish)
            case PlanningProgress(plan=int(number)) | PlanPreview(plan=int(number)) | PlanMade(plan=number):
                if number in self.plans:
                    _hear_plan(self.plans[number], event)
            case Queued(plan, job):
                self.queued = job
                if job == "plan" and plan in self.plans:
                    self.plans[plan].status = "waiting"
            case Dequeued(plan, begun):
                self.queued = ""
                if plan in self.plans and self.plans[plan].status == "waiting":
                    self.plans[plan].status = "planning" if begun else "stopped"
            case Asked(question):
                self.question = question
            case Answered():
                self.question = None
            case PaintingStarted(plan, of):
                self._forget_trouble()
                self.painting = PaintState(plan, of)
            case Failed(reason):
                self.trouble = reason
                self._end("failed")
            case Stopped():
                self.stopped = True
                self._end("stopped")
            case _ if self.painting is not None:
                if isinstance(event, TakenUp):
                    self._forget_trouble()
                _hear_painting(self.painting, event)
                if isinstance(event, PaintingKept) and self.stopped:
                    self.painting.status = "stopped"
            case _:
                pass

    def shown(self, working: bool) -> dict[str, Any]:
        """All of it as plain values. A worker that is gone without a word has met an accident."""
        shown = {
            "version": self.version,
            "working": working,
            "stopped": self.stopped,
            "trouble": self.trouble,
            "queued": self.queued,
            "question": self.question if working else None,
            "plans": [asdict(plan) for plan in self.plans.values()],
            "painting": None if self.painting is None else asdict(self.painting),
        }
        if not working and not self.trouble and not self.stopped and self._unfinished():
            shown["trouble"] = "The painter stopped in the middle of its work, without saying why; is the disk full?"
        return shown

    @property
    def stage(self) -> str:
        """In a word, for the gallery."""
        if self.painting is not None:
            return self.painting.status
        if self.queued == "plan":
            return "waiting"
        return "planned" if any(plan.status == "ready" for plan in self.plans.values()) else "planning"

    def _unfinished(self) -> bool:
        planning = any(plan.status == "planning" for plan in self.plans.values())
        return planning or (self.painting is not None and self.painting.status not in _ENDS)

    def _forget_trouble(self) -> None:
        self.trouble, self.stopped, self.question = "", False, None

    def _end(self, how: str) -> None:
        for plan in self.plans.values():
            if plan.status == "planning":
                plan.status = how
        if self.painting is not None and self.painting.status not in _ENDS:
            self.painting.status = how


def _hear_plan(plan: PlanState, event: PlanningProgress | PlanPreview | PlanMade) -> None:
    match event:
        case PlanningProgress(share, left):
            plan.share, plan.left = share, left
        case PlanPreview(picture):
            plan.growing = picture
        case PlanMade():
            plan.status, plan.share, plan.left, plan.nearer = "ready", 1.0, None, event.nearer
            plan.made = {name: getattr(event, name) for name in _MADE}


def _hear_painting(painting: PaintState, event: Written) -> None:
    painting.status = _STATUS.get(type(event), painting.status)
    if isinstance(event, LookShown | WentOn | RestReplanned):
        painting.remark = ""
    if isinstance(event, Paused | WentOn | TakenUp):
        painting.held = isinstance(event, Paused)
    match event:
        case TakenUp(done):
            painting.done, painting.film, painting.kept = done, False, False
        case LayerBegun(brush=brush, first_paint=first):
            painting.brush, painting.first_paint, painting.paint = brush, first, None
        case BrushInHand(brush):
            painting.brush = brush or ""
        case Dipped(well):
            paint = painting.first_paint + well
            painting.paint, painting.since_dip = paint, 0
            painting.dips[paint] = painting.dips.get(paint, 0) + 1
        case Drying(left=seconds):
            painting.dries = seconds
        case StrokePainted(done, of) | StrokeLeftOut(done, of):
            painting.done, painting.of = done, of or painting.of
            painting.since_dip += isinstance(event, StrokePainted)
        case TimeLeft(seconds):
            painting.left = seconds
        case PhotographShown(picture):
            painting.photograph = picture
        case LookShown():
            painting.growing = None
            painting.looks = [*painting.looks[-_MOST_LOOKS:], {**asdict(event), "why": painting.why}]
            painting.why = ""
        case TouchCorrected() | LastLookDoubted() if painting.looks:
            told = [*painting.looks[-1].get("touch", []), event.sentence]
            painting.looks[-1] = {**painting.looks[-1], "touch": told}
        case Considering():
            painting.why = "asked"
        case PlanningProgress(share, left):
            painting.share, painting.left = share, left
        case PlanPreview(picture):
            painting.growing = picture
        case RestReplanned():
            painting.growing, painting.share = None, 0.0
            painting.replanned = {name: getattr(event, name) for name in _REPLANNED}
            if painting.looks and painting.looks[-1]["done"] == event.done and "gain" not in painting.looks[-1]:
                more = {"gain": event.gain, "plan": f"{event.prefix}plan.jpg"}
                painting.looks[-1] = {**painting.looks[-1], **more}
        case Paused(reason=reason, turn=turn):
            painting.reason, painting.turn, painting.why = reason, turn, ""
        case Turns(strokes):
            painting.turns = strokes
        case RegionProtected(only=only, picture=picture):
            painting.region = {"picture": picture, "only": only} if picture else None
            painting.why = ("only" if only else "region") if picture else "freed"
        case GoalChanged(wish=wish):
            painting.wish, painting.why = wish, "goal"
        case Remark(sentence):
            painting.remark = sentence
        case PaintingKept(film, arm):
            painting.film, painting.arm, painting.left, painting.kept = film, arm, 0.0, True
        case _:
            pass


_MADE = ("prefix", "frames", "strokes", "palette", "mixtures", "seconds")
_REPLANNED = ("prefix", "frames", "strokes", "palette", "done")
# What a painting is about after an event; after any other what it was before.
_STATUS: dict[type[Written], str] = {
    TakenUp: "preparing",
    Mixing: "mixing",
    Dipped: "painting",
    Drying: "drying",
    StrokePainted: "painting",
    StrokeLeftOut: "painting",
    LookShown: "planning",
    PlanningProgress: "planning",
    RestReplanned: "painting",
    Paused: "paused",
    Considering: "planning",
    WentOn: "painting",
    Finishing: "finishing",
    PaintingKept: "finished",
}
_ENDS = ("finished", "stopped", "failed")
