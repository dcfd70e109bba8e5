"""State of a painting: one fold of its events, the same while it is painted and afterwards.

Everything about a painting is read from here: the progress at the terminal, the time left, the figures of its results,
the studio's page, and the state that a resumed painting begins from. Entries of a newer program are only counted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Literal, Self

from frida_painter.easel.kinds import JOURNAL
from frida_painter.errors import StorageError
from frida_painter.session import events
from frida_painter.session.events import Event, events_of, time_of
from frida_painter.session.time_left import RemainingTime, measure_step
from frida_painter.system import storage
from frida_painter.system.storage import count_of

FORMAT = "frida-painter journal"
VERSION = 3

Doing = Literal[
    "preparing", "mixing", "painting", "drying", "planning", "paused", "finishing", "finished", "stopped", "failed"
]
ENDS: tuple[Doing, ...] = ("finished", "stopped", "failed")
KEPT = {"kept": True}
"""Metadata of fields that resuming and results need, and that no page shows."""


@dataclass
class Sittings:
    """Sittings of a painting, and what its journal tells of itself.

    version: number of events.
    count, seconds, last: number of sittings, time spent in them, and time of the last event.
    settings, rests_on: settings, and hashes of all other inputs.
    missing: number of records lost at the journal's end. unknown: number of entries of a newer program.
    """

    version: int = 0
    count: int = 0
    seconds: float = 0.0
    last: datetime | None = None
    settings: dict[str, Any] = field(default_factory=dict)
    rests_on: dict[str, str] = field(default_factory=dict)
    missing: int = 0
    unknown: int = 0

    @property
    def unknown_sentence(self) -> str:
        """Sentence for a person about entries of a newer program; "" if there are none."""
        places = count_of(self.unknown, "place")
        return f"What a newer program wrote in {places} of this journal was skipped." if self.unknown else ""


@dataclass
class StrokeProgress:
    """Progress of the strokes.

    doing: what is done, or how it ended.
    painted, of: number of the last stroke that is done, and of all.
    in_doubt: stroke that was begun and not ended, None if there is none.
    given_up: strokes before `painted` that are not on the canvas, because a person left them out or gave them up.
    drying, dried_at: last event of drying, and when it was written.
    pace: seconds that people wait per second of drying.
    """

    doing: Doing = "preparing"
    painted: int = 0
    of: int = 0
    in_doubt: int | None = None
    given_up: list[int] = field(default_factory=list)
    drying: events.Drying | None = None
    dried_at: datetime | None = field(default=None, metadata=KEPT)
    pace: float = 1.0

    @property
    def left_out(self) -> frozenset[int]:
        """Indices in the plan, from 0, of the strokes that were given up."""
        return frozenset(number - 1 for number in self.given_up)

    def wet(self, now: datetime | None = None) -> float | None:
        """Returns the seconds that the last layer still dries; None if drying did not begin.

        now: current time. None: nothing has dried since the painting broke off, as in a simulated studio.
        """
        if self.drying is None or self.drying.done != self.painted:
            return None
        since = self.dried_at
        passed = 0.0 if now is None or since is None else max(0.0, (now - since).total_seconds())
        return max(0.0, self.drying.left - passed)


@dataclass
class BrushState:
    """Brush and paints of the robot.

    held: brush in the hand of a robot with a rack, as in BrushInHand.
    name: of the brush that paints.
    first_paint, paint: paint in the first well, and paint on the brush, from 0.
    since_dip: strokes since the last dip.
    dips, cleanings: numbers of dips into each paint, and of cleanings between paints.
    touch: latest correction of each brush's height, in words.
    """

    held: str | None = ""
    name: str = ""
    first_paint: int = 0
    paint: int | None = None
    since_dip: int = 0
    dips: dict[int, int] = field(default_factory=dict)
    cleanings: int = 0
    touch: dict[str, str] = field(default_factory=dict)


@dataclass
class PlanningState:
    """Plans of the painting, and its remaining time.

    adopted: plans that were followed, in order.
    phases, forecasts: loss curves of all plans by their names, and forecasts of the similarity (expected, least and
    most dB), each after a number of strokes.
    replanned: the last plan of the rest that has pictures.
    growing: newest picture of the plan that is being made.
    expected_seconds: robot time of the whole painting, as first expected.
    time, curve: remaining time, and loss curve of the plan that is being made.
    """

    adopted: list[events.PlanAdopted] = field(default_factory=list, metadata=KEPT)
    phases: list[tuple[str, list[tuple[int, float]]]] = field(default_factory=list, metadata=KEPT)
    forecasts: list[tuple[int, tuple[float, float, float]]] = field(default_factory=list, metadata=KEPT)
    replanned: events.Planned | None = None
    growing: str | None = None
    expected_seconds: float | None = None
    time: RemainingTime = field(default_factory=RemainingTime, metadata=KEPT)
    curve: list[tuple[int, float]] = field(default_factory=list, metadata=KEPT)


@dataclass(frozen=True)
class LookState:
    """Look at the canvas after `done` strokes.

    pictures: as in Looked.
    why: "region", "only", "freed", "goal" or "asked" if a person's command led to it, else "".
    planned: plan of the rest that followed, without its pictures; None if the old one was kept.
    touch: sentences about brushes that are sent lower or higher since.
    found: picture that outlines what a person painted.
    """

    done: int
    pictures: dict[str, str]
    why: str = ""
    planned: events.Planned | None = None
    touch: tuple[str, ...] = ()
    found: str = ""


@dataclass
class Pictures:
    """Pictures of the canvas.

    photograph: the newest one that people see.
    looks: in order.
    light: light of the room at the last look, None before the first one.
    count, files: number of photographs for a decision, and the sha256 of all their files.
    last: file of the last one, None if there is none.
    assumed: file of the last picture of a canvas that nobody looks at; None after a person's picture of it.
    pictured: number of strokes in the last picture that a person took.
    """

    photograph: str | None = None
    looks: list[LookState] = field(default_factory=list)
    light: list[list[float]] | None = field(default=None, metadata=KEPT)
    count: int = 0
    files: dict[str, str | None] = field(default_factory=dict, metadata=KEPT)
    last: str | None = None
    assumed: str | None = None
    pictured: int = 0

    def add_to_look(self, **facts: Any) -> None:
        """Adds facts to the last look, if there is one."""
        if self.looks:
            self.looks[-1] = replace(self.looks[-1], **facts)


@dataclass
class Wishes:
    """Wishes of people, in force or open.

    goals: changes of the goal, in order.
    request: what a person asked for in a pause and was not done; empty if nothing is owed.
    proposed: pictures that were made in the last pause, from which nobody has chosen; None if there are none.
    region: event of the protected region, None if nothing is protected.
    turns: turns that were agreed on.
    pause: the last pause. paused: True in a pause, also while a command is performed there.
    why: reason of the next look, as in LookState.
    """

    goals: list[events.NewGoal] = field(default_factory=list)
    request: dict[str, Any] = field(default_factory=dict)
    proposed: events.MadePictures | None = None
    region: events.DrawnRegion | None = None
    turns: events.Turns = field(default_factory=lambda: events.Turns(0))
    pause: events.Paused | None = None
    paused: bool = False
    why: str = ""

    @property
    def goal(self) -> str:
        """Folder of the changed goal, "" before a change."""
        return self.goals[-1].folder if self.goals else ""


@dataclass
class People:
    """People: their open question, the last remark to them, and their strokes.

    question: open question, in the form of together.asking; None if there is none.
    remark: reason why a command could not be done as asked.
    may_paint: brushes and wells for a person who paints through this program; None if nobody can.
    strokes: strokes of a person, in order; of the last one, the end may be unknown.
    painted, seen, released: numbers of the person's last stroke that is certainly on the canvas, at the last look, and
    when they last ended a protection.
    """

    question: dict[str, Any] | None = None
    remark: str = ""
    may_paint: events.PersonMayPaint | None = None
    strokes: list[events.StrokeOfPerson] = field(default_factory=list, metadata=KEPT)
    painted: int = 0
    seen: int = 0
    released: int = 0

    @property
    def in_doubt(self) -> events.StrokeOfPerson | None:
        """The person's stroke that was begun and not ended; None if there is none."""
        return self.strokes[-1] if len(self.strokes) > self.painted else None


@dataclass
class End:
    """End of a painting, or of its last sitting.

    finished: True if the painting is complete. robot_seconds: robot time of a finished painting.
    stopped: True if a person stopped the last sitting. trouble: sentence about the last error.
    results: names of the results that there are; None before they are kept.
    """

    finished: bool = False
    robot_seconds: float = 0.0
    stopped: bool = False
    trouble: str = ""
    results: tuple[str, ...] | None = None


def require_journal(folder: Path) -> None:
    """Raises StorageError if the folder holds no journal of a painting."""
    if not storage.exists(folder / JOURNAL):
        raise StorageError(
            f"{storage.abridge(folder)} is not the folder of a painting: it holds no journal; give one that does."
        )


def _require_beginning(first: dict[str, Any], folder: Path) -> None:
    """Raises StorageError, or ValueError for a damaged one, unless the record begins a journal of this version."""
    if first.get("format") != FORMAT:
        raise StorageError(f"{folder} holds a journal that is not a painting's; give the folder of a painting.")
    if first.get("version") != VERSION:
        older = first.get("version") in (1, 2)
        finish = "finish it with frida-painter 0.3" if older else "resume it with the program that began it"
        raise StorageError(
            f"{folder} holds a journal of version {first.get('version')!r}; this program reads version {VERSION}: "
            f"{finish}."
        )
    if not isinstance(events_of(first)[-1], events.PaintingBegun):
        raise ValueError("the painting's beginning")


@dataclass
class PaintingState:
    """State of a painting. `tools/page/state.d.ts` names what the page reads of it."""

    sittings: Sittings = field(default_factory=Sittings, metadata=KEPT)
    progress: StrokeProgress = field(default_factory=StrokeProgress)
    brush: BrushState = field(default_factory=BrushState)
    planning: PlanningState = field(default_factory=PlanningState)
    pictures: Pictures = field(default_factory=Pictures)
    wishes: Wishes = field(default_factory=Wishes)
    people: People = field(default_factory=People)
    end: End = field(default_factory=End)

    @property
    def is_pictured(self) -> bool:
        """True if a person's picture, taken without a camera, shows the finished canvas."""
        return self.end.finished and 0 < self.pictures.pictured == self.progress.painted

    @classmethod
    def of_journal(cls, records: Iterable[dict[str, Any]], folder: Path) -> Self:
        """Returns the state from all records of the journal in `folder`. Raises StorageError as `hear_journal` does."""
        state = cls()
        deque(state.hear_journal(records, folder), maxlen=0)
        return state

    def hear_journal(self, records: Iterable[dict[str, Any]], folder: Path) -> Iterator[Event]:
        """Updates the state by the next records of the journal in `folder`; yields each event once it is heard.

        Raises StorageError if the journal is not a painting's, is of another version, or lacks something.
        """
        with storage.understanding(folder / JOURNAL, "the journal of a painting"):
            for written in records:
                if not self.sittings.version:
                    _require_beginning(written, folder)
                at = time_of(written)
                for event in events_of(written):
                    self.hear(event, at)
                    yield event
        if not self.sittings.version:
            _require_beginning({}, folder)

    def hear(self, event: Event, at: datetime | None = None) -> None:
        """Updates the state by an event that was written at that time."""
        sittings = self.sittings
        sittings.version += 1
        if isinstance(event, events.Unknown):
            sittings.unknown += 1
            return
        if at is not None:
            # A sitting that goes on looks before it is noted, and its work is told before that.
            begins = isinstance(event, events.PaintingBegun | events.SessionResumed)
            first = isinstance(event, events.Scheduled) and event.seconds is None
            if not (begins or first or self.end.finished or sittings.last is None):
                sittings.seconds += measure_step(sittings.last.timestamp(), at.timestamp())
            sittings.last = at
        self.progress.doing = self._find_doing(event)
        self.planning.time.hear(event, 0.0 if sittings.last is None else sittings.last.timestamp())
        self._hear(event, at)

    def _find_doing(self, event: Event) -> Doing:
        """Returns what is done from this event on."""
        doing, paused = self.progress.doing, self.wishes.paused
        match event:
            case events.SessionResumed():
                return "preparing"
            case events.Began("results"):
                return "finishing"
            case events.ResultFound("results"):
                return "failed" if self.end.trouble else "stopped" if self.end.stopped else "finished"
            case _ if doing in ENDS:
                return doing
            case events.Stopped():
                return event.how
            case events.PaintsWanted(ground=False):
                return "mixing"
            case events.Drying() if self.progress.pace:
                return "drying"
            case events.MotionBegan(stroke=int()) if doing == "paused":  # at the terminal nobody tells its end
                return "painting"
            case events.CommandTaken(command):
                return "planning" if command else "paused" if paused else doing
            case events.CommandDone(events.MadePictures()) if paused:
                return "paused"
            case events.Paused():
                return "paused"
            case events.Looked() | events.PlanningStep():
                return "planning"
            case events.Planned() | events.WentOn() | events.Dipped() | events.StrokePainted() | events.StrokeLeftOut():
                return "painting"
        return doing

    def _hear(self, event: Event, at: datetime | None) -> None:
        """Updates the records by an event."""
        progress, brush, planning, pictures = self.progress, self.brush, self.planning, self.pictures
        wishes, people, end = self.wishes, self.people, self.end
        match event:
            case events.PaintingBegun(settings, rests_on):
                self.sittings.count += 1
                self.sittings.settings, self.sittings.rests_on = settings, rests_on
            case events.SessionResumed(decision=decision):
                self.sittings.count += 1
                if progress.in_doubt is not None and decision != "repaint":
                    progress.painted = progress.in_doubt
                    progress.given_up.append(progress.in_doubt)
                progress.in_doubt, planning.curve, planning.growing = None, [], None
                end.trouble, end.stopped, end.results = "", False, None
                wishes.paused, people.question = False, None
            # Plans and looks.
            case events.Scheduled(done, strokes, seconds=seconds, pace=pace):
                progress.of, progress.pace = strokes or progress.of, pace
                if done == 0 or planning.expected_seconds is None:
                    planning.expected_seconds = seconds
            case events.PlanAdopted():
                planning.adopted.append(event)
            case events.PlanningStep(iteration=iteration, loss=loss, picture=picture):
                planning.curve.append((iteration, loss))
                planning.growing = picture or planning.growing
            case events.Planned(done, strokes):
                name = f"after {done} strokes" if done else f"plan for {strokes} strokes"
                planning.phases.append((name, planning.curve))
                planning.forecasts += [] if event.similarity is None else [(done, event.similarity)]
                planning.curve, planning.growing, people.remark = [], None, ""
                planning.replanned = event if event.shown else planning.replanned
                if pictures.looks and pictures.looks[-1].done == done and pictures.looks[-1].planned is None:
                    pictures.add_to_look(planned=replace(event, shown={}))
            case events.Looked(done, found):
                pictures.looks.append(LookState(done, found, wishes.why))
                pictures.photograph = found.get("seen", pictures.photograph)
                planning.growing, people.remark, wishes.why = None, "", ""
            case events.Remark(sentence, "touch" | "last look", name):
                brush.touch |= {name: sentence} if name else {}
                pictures.add_to_look(touch=(*pictures.looks[-1].touch, sentence) if pictures.looks else ())
            case events.ResultFound("found", picture):
                pictures.add_to_look(found=picture)
            case events.TimelapseFrame(picture=str(picture)):
                pictures.photograph = picture
            case events.CanvasPicture(picture, by="renderer"):
                pictures.assumed = picture
            case events.CanvasPicture(picture, done, by, content, light):
                if by == "person":
                    pictures.pictured, pictures.assumed, pictures.last = done, None, None
                else:
                    pictures.light, people.seen = light, people.painted
                pictures.count += 1
                if picture is not None:
                    pictures.last, pictures.files[picture] = picture, content
            # The robot's strokes.
            case events.MotionBegan(stroke=int(stroke)):
                progress.in_doubt, wishes.paused, wishes.proposed = stroke, False, None
            case events.StrokePainted(done, of) | events.StrokeLeftOut(done, of):
                progress.painted, progress.of, progress.in_doubt = done, of or progress.of, None
                brush.since_dip += isinstance(event, events.StrokePainted)
                progress.given_up += [done] if isinstance(event, events.StrokeLeftOut) else []
            case events.Drying():
                progress.drying, progress.dried_at = event, at
            case events.Dipped(well, cleaned):
                brush.paint, brush.since_dip = brush.first_paint + well, 0
                brush.dips[brush.paint] = brush.dips.get(brush.paint, 0) + 1
                brush.cleanings += cleaned
            case events.LayerBegun(brush=name, first_paint=first):
                brush.name, brush.first_paint, brush.paint = name, first, None
            case events.BrushInHand(held):
                brush.held, brush.name = held, held or ""
            # People: questions, wishes, strokes.
            case events.Asked(question):
                people.question = question
            case events.Remark(sentence):
                people.remark = sentence
            case events.Paused():
                wishes.pause, wishes.paused, wishes.why = event, True, ""
            case events.WentOn():
                wishes.paused, wishes.proposed, people.remark = False, None, ""
            case events.CommandTaken(command):
                wishes.request, wishes.why = command, "asked" if command else wishes.why
            case events.CommandDone(events.Turns() as turns):
                wishes.turns = turns
            case events.CommandDone(events.DrawnRegion(None)):
                wishes.region, wishes.why, people.released = None, "freed", people.painted
            case events.CommandDone(events.DrawnRegion() as region):
                wishes.region, wishes.why = region, "only" if region.only else "region"
            case events.CommandDone(events.NewGoal() as goal):
                wishes.goals, wishes.proposed, wishes.why = [*wishes.goals, goal], None, "goal"
            case events.CommandDone(events.MadePictures() as made):
                wishes.request, wishes.proposed = {}, made
            case events.PersonMayPaint():
                people.may_paint = event
            case events.StrokeOfPerson(number, painted=painted):
                people.strokes = [*people.strokes[: number - 1], event]
                people.painted, people.remark = (number, "") if painted else (people.painted, people.remark)
            # The end.
            case events.Stopped(reason):
                end.stopped, end.trouble = end.stopped or not reason, reason or end.trouble
            case events.Finished(robot_seconds=robot_seconds):
                end.finished, end.robot_seconds = True, robot_seconds
            case events.ResultFound("results", detail=there):
                end.results = tuple(name for name, is_there in there.items() if is_there)
