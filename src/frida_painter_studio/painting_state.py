"""State of a painting for the page: plans and jobs from its feed, and the painting itself from its journal.

The status is one function of both and of two facts that they cannot know: a process works on the painting, and its
files are there. Every view of the studio shows this status.
"""

import shutil
from contextlib import suppress
from dataclasses import dataclass, field, fields, is_dataclass, replace
from datetime import datetime
from typing import Any, Literal, Self, cast

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import JOURNAL
from frida_painter.errors import ConfigError
from frida_painter.session import events
from frida_painter.session.events import Event
from frida_painter.session.fold import ENDS, Doing, PaintingState
from frida_painter_studio.form import SETTINGS
from frida_painter_studio.pace import WorkTimes
from frida_painter_studio.studio_folder import PaintingFolder, QueuedJob, working

_VANISHED = "The {}'s process ended in the middle of its work, without saying why."
_LITTLE_ROOM = 64 * 2**20  # bytes
_MAX_LOOKS = 200


def plain(value: Any, place: str = "") -> Any:
    """Returns a record, with the records in it, as plain values under the same names.

    place: path that no page shows; sentences name "its folder" instead.
    """
    if is_dataclass(value):
        return {one.name: plain(getattr(value, one.name), place) for one in fields(value) if not one.metadata}
    if isinstance(value, dict):
        return {name: plain(one, place) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one, place) for one in value]
    return value.replace(place, "its folder") if place and isinstance(value, str) else value


@dataclass(frozen=True)
class Truth:
    """Facts about a painting that its events cannot tell.

    working: True if a process works on the painting. Only this process can move the robot.
    here: True if the painting's folder exists, with its events.
    begun: True if the studio can resume the painting from its journal.
    room: True if the disk has room.
    queued: job for which the painting waits in the studio's queue, None if it does not wait.
    """

    working: bool
    here: bool = True
    begun: bool = True
    room: bool = True
    queued: QueuedJob | None = None

    @classmethod
    def of(cls, folder: PaintingFolder, queued: QueuedJob | None) -> Self:
        """Returns the facts about a painting, or about the calibration.

        queued: as in `Truth`, found before: a job that leaves the queue has the lock of its worker by then.
        """
        try:
            room = shutil.disk_usage(folder.path.parent).free >= _LITTLE_ROOM
        except OSError:
            room = True
        # A painter may write a last picture after its folder was deleted, but no feed.
        begun = (folder.painting / JOURNAL).is_file()
        there = folder.feed.is_file() or folder.is_of_terminal or not folder.painting.exists()
        return cls(working(folder), folder.path.is_dir() and there, begun, room, queued)

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


@dataclass
class PlanState:
    """State of one plan.

    status: "waiting", "planning", "ready", "failed" or "stopped". The other fields: as the worker reports them.
    said: progress in words, before that in numbers.
    beside: True for a plan that was ordered together with the one before it.
    """

    number: int
    wish: dict[str, Any]
    status: str = "planning"
    share: float = 0.0
    left: float | None = None
    said: str = ""
    growing: str | None = None
    made: dict[str, Any] | None = None
    beside: bool = False


@dataclass
class PaintingPage:
    """State of a painting from the first request to the last stroke.

    plans: by number.
    job: the last job that a person or the queue began here: "plan", "paint", "resume", or "" before any.
    plan: number of the plan that is painted.
    sittings: number of sittings before the job, so that it has begun if the painting has more of them.

    said: progress of the job in words.
    ended: "stopped" or "failed" if the job ended so.
    trouble: sentence about its last error, until another job begins.
    painting: state of the painting, from its journal.
    times: what its work took.
    place: path of the painting's folder, which no page shows.
    """

    plans: dict[int, PlanState] = field(default_factory=dict)
    job: str = ""
    plan: int = 0
    sittings: int = 0
    said: str = ""
    ended: Literal["", "stopped", "failed"] = ""
    trouble: str = ""
    painting: PaintingState = field(default_factory=PaintingState)
    times: WorkTimes = field(default_factory=WorkTimes)
    place: str = ""
    _heard: int = 0

    @property
    def version(self) -> int:
        """Number that grows with every event."""
        return self._heard + self.painting.sittings.version

    def hear(self, event: Event, at: datetime | None = None) -> None:
        """Updates the state by an event of the feed, written at that time; other events change nothing."""
        self._heard += 1
        if at is not None:
            self.times.hear(event, at)
        match event:
            case events.Began("plan", beside, number, detail):
                if not beside:
                    self._end_plans(self.ended or "failed")
                    self._begin("plan")
                self.plans[number] = PlanState(number, detail, beside=bool(beside))
            case events.Began("paint" | "resume" as job, plan=number, detail=detail):
                self._begin(job)
                self.plan, sittings = number, detail.get("sittings")
                self.sittings = sittings if isinstance(sittings, int) else 0
            case events.Advanced():
                self._hear_progress(event)
            case events.ResultFound("plan", plan=number, detail=detail) if number in self.plans:
                plan = self.plans[number]
                plan.status, plan.share, plan.left = "ready", 1.0, None
                plan.made = detail
            case events.ResultFound("refused", reason):  # a terminal was faster, and paints
                self.job, self.trouble = "", reason
            case events.Stopped(reason):
                self.ended, self.trouble = event.how, reason or self.trouble
                self._end_plans(event.how)
            case _:
                pass

    def hear_painting(self, event: Event, at: datetime | None = None) -> None:
        """Updates the state by an event of the journal, written at that time."""
        self.painting.hear(event, at)
        if isinstance(event, events.Advanced):
            self.said = event.words
        if at is not None:
            self.times.hear(event, at)

    def _hear_progress(self, progress: events.Advanced) -> None:
        if self.job != "plan":
            self.said = progress.words or self.said
        for plan in [plan for plan in self.plans.values() if plan.status == "planning"][:1]:
            plan.growing = progress.picture or plan.growing
            if progress.words:
                plan.said = progress.words
            elif progress.share is not None:
                plan.share, plan.left, plan.said = progress.share, progress.left, ""

    def _begin(self, job: str) -> None:
        self.job, self.said, self.trouble, self.ended = job, "", "", ""

    def _end_plans(self, how: str) -> None:
        for plan in self.plans.values():
            if plan.status == "planning":
                plan.status = how

    # Status: one function of the state and of the facts.

    def status(self, truth: Truth) -> Status:
        """Returns the status of the painting: the only place where it is decided."""
        refused = not self.job and not truth.working  # by a process that has ended since
        stage, trouble = self._find_stage(truth), "" if refused else self._end[1]
        if not trouble and self._is_taken_up:
            trouble = plain(self.painting.end.trouble, self.place)
        resumable = stage in ("stopped", "failed") and truth.begun and not truth.working
        if stage == "lost":
            held = "Its painter still works, and may move the robot: press Stop."
            trouble = f"The folder of this painting was deleted. {held if truth.working else 'Nothing of it is left.'}"
        elif not trouble and stage == "failed":
            kept = "What is painted is kept." if resumable else "Nothing was painted yet."
            trouble = f"{_VANISHED.format('painter')} {truth.suspicion} {kept}"
        elif not trouble and stage in ("planned", "plan failed") and self._plan_statuses(truth)[-1:] != ["stopped"]:
            vanished = any(plan.status == "planning" for plan in self.plans.values())
            trouble = f"{_VANISHED.format('planner')} {truth.suspicion}" if vanished else ""
        return Status(stage, truth.working, trouble, resumable)

    def _find_stage(self, truth: Truth) -> Stage:
        if not truth.here:
            return "lost"
        doing = self._find_doing(truth)
        if doing is not None:
            return "replanning" if doing == "planning" else cast(Stage, doing)
        if truth.queued:
            return "waiting" if truth.queued == "plan" else "queued"
        found = self._plan_statuses(truth)
        if found[-1:] == ["planning"]:
            return "planning"
        if "ready" in found:
            return "planned"
        return "plan stopped" if found[-1:] == ["stopped"] else "plan failed"

    @property
    def _is_taken_up(self) -> bool:
        """True if the painter of the last job has begun its sitting, or needs none, or if nobody ordered one here."""
        whole = self.painting.end.finished and self.painting.end.results is not None  # made again, without a sitting
        return whole or self.painting.sittings.count > self.sittings or self.job not in ("paint", "resume")

    @property
    def _end(self) -> tuple[str, str]:
        """End and trouble of the last job, which count no more if a terminal has gone on with the painting since."""
        gone_on = self.job in ("paint", "resume") and self.painting.sittings.count > self.sittings + 1
        return ("", "") if gone_on else (self.ended, self.trouble)

    def _find_doing(self, truth: Truth) -> Doing | None:
        """Returns what is done with the painting, or how it ended; None before a person began it."""
        painting, is_job, taken_up = self.painting, self.job in ("paint", "resume"), self._is_taken_up
        if not is_job and not painting.sittings.count:
            return None
        ended = cast(Doing, self._end[0])
        if (
            taken_up
            and painting.progress.doing in ENDS
            and (truth.working or not ended or painting.progress.doing == "finished")
        ):
            return painting.progress.doing
        if ended and is_job:
            return ended
        if not truth.working:
            return "failed"
        return painting.progress.doing if taken_up else "preparing"

    def _plan_statuses(self, truth: Truth) -> list[str]:
        return [self._plan_status(plan, truth) for plan in self.plans.values()]

    def _plan_status(self, plan: PlanState, truth: Truth) -> str:
        """Returns the status of a plan; a planner that ended without a word has failed."""
        if plan.status != "planning":
            return plan.status
        return "waiting" if truth.queued == "plan" else "planning" if truth.working else self.ended or "failed"

    def to_plain(self, truth: Truth) -> dict[str, Any]:
        """Returns the state with its status as plain values."""
        plans = [plain(replace(plan, status=self._plan_status(plan, truth))) for plan in self.plans.values()]
        doing, end = self._find_doing(truth), self.painting.end
        if self.painting.sittings.count and not plans:
            plans = [plain(self._describe_plan_of_terminal())]
        return {
            "version": self.version,
            **plain(self.status(truth)),
            "stopped": self._end[0] == "stopped" or (self.job != "plan" and end.stopped),
            "question": self.painting.people.question if truth.working else None,
            "plans": plans,
            "painting": None if doing is None else self._describe_painting(doing),
        }

    def _describe_plan_of_terminal(self) -> PlanState:
        """Returns the plan of a painting that was begun at the terminal, from its settings."""
        settings = self.painting.sittings.settings
        made: dict[str, Any] = {"prefix": "", "frames": [], "palette": [], "strokes": settings.get("strokes")}
        wish = {name: settings.get(name) for name in ("title", *SETTINGS)} | {"terms": [], "initial": []}
        with suppress(ConfigError):
            size = CanvasSize.parse(str(settings.get("canvas")))
            wish |= {"width": 1000 * size.width, "height": 1000 * size.height}
        return PlanState(0, wish, "ready", made=made)

    def _describe_painting(self, doing: Doing) -> dict[str, Any]:
        """Returns the painting as `PaintState` in tools/page/state.d.ts: its records, and what the last job adds."""
        state, planning = self.painting, self.painting.planning
        looks = [look for look in state.pictures.looks if look.pictures][-_MAX_LOOKS:]
        remark = state.people.remark or state.sittings.unknown_sentence
        shown = replace(
            state, pictures=replace(state.pictures, looks=looks), people=replace(state.people, remark=remark)
        )
        known = planning.adopted and doing not in ("preparing", "failed")
        left = 0.0 if state.end.results is not None else round(planning.time.remaining, 1) if known else None
        return {"plan": self.plan, "status": doing, "said": self.said, "left": left, **plain(shown, self.place)}
