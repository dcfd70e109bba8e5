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
_SITTINGS = frozenset({events.PaintingBegun, events.SessionResumed})
_DOING: dict[type[Event], Doing] = {
    events.SessionResumed: "preparing",
    events.Dipped: "painting",
    events.StrokePainted: "painting",
    events.StrokeLeftOut: "painting",
    events.Looked: "planning",
    events.PlanningStep: "planning",
    events.Planned: "painting",
    events.Paused: "paused",
    events.WentOn: "painting",
}


@dataclass(frozen=True)
class LookState:
    """Look at the canvas.

    told: the look, with the files of its pictures.
    why: "region", "only", "freed", "goal" or "asked" if a person's command led to it, else "".
    planned: plan of the rest that followed; None if the old one was kept.
    touch: sentences about brushes that are sent lower or higher since.
    found: picture that outlines what a person painted.
    """

    told: events.Looked
    why: str = ""
    planned: events.Planned | None = None
    touch: tuple[str, ...] = ()
    found: str = ""


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
    """State of a painting.

    version: number of events.
    doing: what is done, or how it ended.
    runs: sittings. seconds: time spent in them. last: time of the last event.
    stopped: True if a person stopped the last sitting. trouble: sentence about the last error.

    settings, rests_on: settings, and hashes of all other inputs.
    plannings: adopted plans, in order.
    painted, of: number of the last stroke that is done, and of all.
    in_doubt: stroke that was begun and not ended, None if there is none.
    given_up: strokes before `painted` that are not on the canvas, because a person left them out or gave them up.

    drying: last event of drying, and when it was written.
    pace: seconds that people wait per second of drying.
    light: light of the room at the last look, None before the first one.
    held: brush in the hand of a robot with a rack, as in BrushInHand.

    photographed: number of photographs for a decision.
    last_photograph: its file, None if there is none.
    assumed: file of the last picture of a canvas that nobody looks at; None after a person's picture of it.
    pictured: number of strokes in the last picture that a person took.
    photographs: sha256 of all files of photographs.
    dips, cleanings: numbers of dips into each paint, and of cleanings between paints.
    finished: True if the painting is complete. robot_seconds: robot time of a finished painting.
    missing: number of records lost at the journal's end. unknown: number of entries of a newer program.

    goals: changes of the goal, in order.
    request: what a person asked for in a pause and was not done; empty if nothing is owed.
    proposed: pictures that were made in the last pause, from which nobody has chosen; None if there are none.
    region: event of the protected region, None if nothing is protected.
    turns: turns that were agreed on.

    person: strokes of a person, in order; of the last one, the end may be unknown.
    person_painted, person_seen, person_released: numbers of the person's last stroke that is certainly on the canvas,
    at the last look, and when they last ended a protection.
    may_paint: brushes and wells for a person who paints through this program; None if nobody can.
    question: open question, in the form of together.asking; None if there is none.
    pause: the last pause. paused: True in a pause, also while a command is performed there.
    remark: reason why a command could not be done as asked.

    looks, phases, forecasts: looks, loss curves of all plans by their names, and forecasts of the similarity (expected,
    least and most dB), each after a number of strokes.
    replanned: the last plan of the rest that has pictures.
    expected_seconds: robot time of the whole painting, as first expected.
    touch: latest correction of each brush's height, in words.

    photograph, growing: newest pictures of the canvas and of the plan that is being made.
    brush, first_paint, paint: brush in the hand, paint in the first well, and paint on the brush, from 0.
    since_dip: strokes since the last dip.
    results: names of the results that there are; None before they are kept.
    time: remaining time.
    """

    version: int = 0
    doing: Doing = "preparing"
    runs: int = 0
    seconds: float = 0.0
    last: datetime | None = None
    stopped: bool = False
    trouble: str = ""

    settings: dict[str, Any] = field(default_factory=dict)
    rests_on: dict[str, str] = field(default_factory=dict)
    plannings: list[events.PlanAdopted] = field(default_factory=list)
    painted: int = 0
    of: int = 0
    in_doubt: int | None = None
    given_up: list[int] = field(default_factory=list)
    drying: tuple[events.Drying, datetime | None] | None = None
    pace: float = 1.0
    light: list[list[float]] | None = None
    held: str | None = ""
    photographed: int = 0
    last_photograph: str | None = None
    assumed: str | None = None
    pictured: int = 0
    photographs: dict[str, str | None] = field(default_factory=dict)
    dips: dict[int, int] = field(default_factory=dict)
    cleanings: int = 0
    finished: bool = False
    robot_seconds: float = 0.0
    missing: int = 0
    unknown: int = 0

    goals: list[events.NewGoal] = field(default_factory=list)
    request: dict[str, Any] = field(default_factory=dict)
    proposed: events.MadePictures | None = None
    region: events.DrawnRegion | None = None
    turns: events.Turns = field(default_factory=lambda: events.Turns(0))
    person: list[events.StrokeOfPerson] = field(default_factory=list)
    person_painted: int = 0
    person_seen: int = 0
    person_released: int = 0
    may_paint: events.PersonMayPaint | None = None
    question: dict[str, Any] | None = None
    pause: events.Paused | None = None
    paused: bool = False
    remark: str = ""

    looks: list[LookState] = field(default_factory=list)
    phases: list[tuple[str, list[tuple[int, float]]]] = field(default_factory=list)
    forecasts: list[tuple[int, tuple[float, float, float]]] = field(default_factory=list)
    replanned: events.Planned | None = None
    expected_seconds: float | None = None
    touch: dict[str, str] = field(default_factory=dict)
    photograph: str | None = None
    growing: str | None = None
    brush: str = ""
    first_paint: int = 0
    paint: int | None = None
    since_dip: int = 0
    results: tuple[str, ...] | None = None
    time: RemainingTime = field(default_factory=RemainingTime)
    _curve: list[tuple[int, float]] = field(default_factory=list)
    _why: str = ""  # reason of the next look

    @property
    def left_out(self) -> frozenset[int]:
        """Indices in the plan, from 0, of the strokes that were given up."""
        return frozenset(number - 1 for number in self.given_up)

    @property
    def unknown_sentence(self) -> str:
        """Sentence for a person about entries of a newer program; "" if there are none."""
        places = count_of(self.unknown, "place")
        return f"What a newer program wrote in {places} of this journal was skipped." if self.unknown else ""

    @property
    def goal(self) -> str:
        """Folder of the changed goal, "" before a change."""
        return self.goals[-1].folder if self.goals else ""

    @property
    def person_in_doubt(self) -> events.StrokeOfPerson | None:
        """The person's stroke that was begun and not ended; None if there is none."""
        return self.person[-1] if len(self.person) > self.person_painted else None

    @property
    def is_pictured(self) -> bool:
        """True if a person's picture, taken without a camera, shows the finished canvas."""
        return self.finished and 0 < self.pictured == self.painted

    @property
    def is_making(self) -> str | None:
        """Words of the pictures that are being made, which begin from the canvas; None if none are."""
        return str(self.request.get("words", "")) if self.request.get("kind") == "propose" else None

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
                if not self.version:
                    _require_beginning(written, folder)
                at = time_of(written)
                for event in events_of(written):
                    self.hear(event, at)
                    yield event
        if not self.version:
            _require_beginning({}, folder)

    def hear(self, event: Event, at: datetime | None = None) -> None:
        """Updates the state by an event that was written at that time."""
        self.version += 1
        kind = type(event)
        if kind is events.Unknown:
            self.unknown += 1
            return
        sitting = kind in _SITTINGS
        if at is not None:
            # A sitting that goes on looks before it is noted, and its work is told before that.
            begins = sitting or (isinstance(event, events.Scheduled) and event.seconds is None)
            if not (begins or self.finished or self.last is None):
                self.seconds += measure_step(self.last.timestamp(), at.timestamp())
            self.last = at
        self.runs += sitting
        if self.doing not in ENDS or kind is events.SessionResumed:
            self.doing = _DOING.get(kind, self.doing)
        self.time.hear(event, 0.0 if self.last is None else self.last.timestamp())
        if not (self._hear_strokes(event, at) or self._hear_plans_and_looks(event) or self._hear_person(event)):
            self._hear_sitting(event)

    def _hear_sitting(self, event: Event) -> None:
        match event:
            case events.PaintingBegun(settings, rests_on):
                self.settings, self.rests_on = settings, rests_on
            case events.SessionResumed(decision=decision):
                self.decide(repaint=decision == "repaint")
                self.trouble, self.stopped, self.paused, self.results, self.question = "", False, False, None, None
                self._curve, self.growing = [], None
            case events.Stopped(reason):
                self.stopped, self.trouble = self.stopped or not reason, reason or self.trouble
                self.doing = self.doing if self.doing in ENDS else event.how
            case events.Began("results"):
                self.doing = "finishing"
            case events.Finished(robot_seconds=robot_seconds):
                self.finished, self.robot_seconds = True, robot_seconds
            case events.ResultFound("results", detail=there):
                self.results = tuple(name for name, is_there in there.items() if is_there)
                self.doing = "failed" if self.trouble else "stopped" if self.stopped else "finished"

    def _hear_strokes(self, event: Event, at: datetime | None) -> bool:
        """Returns True if it is such an event, as the next two do."""
        match event:
            case events.MotionBegan(stroke=None):
                pass
            case events.PaintsWanted(ground=False) if self.doing not in ENDS:
                self.doing = "mixing"
            case events.MotionBegan(stroke=int(stroke)):
                self.in_doubt, self.proposed, self.paused = stroke, None, False
                self.doing = "painting" if self.doing == "paused" else self.doing  # at the terminal nobody tells it
            case events.StrokePainted(done, of) | events.StrokeLeftOut(done, of):
                self.painted, self.of, self.in_doubt = done, of or self.of, None
                self.since_dip += isinstance(event, events.StrokePainted)
                self.given_up += [done] if isinstance(event, events.StrokeLeftOut) else []
            case events.Dipped(well, cleaned):
                self.paint, self.since_dip = self.first_paint + well, 0
                self.dips = {**self.dips, self.paint: self.dips.get(self.paint, 0) + 1}  # a page may show the old one
                self.cleanings += cleaned
            case events.Drying():
                self.drying = event, at
                if self.pace and self.doing not in ENDS:
                    self.doing = "drying"
            case events.LayerBegun(brush=brush, first_paint=first):
                self.brush, self.first_paint, self.paint = brush, first, None
            case events.BrushInHand(brush):
                self.held, self.brush = brush, brush or ""
            case _:
                return False
        return True

    def _hear_plans_and_looks(self, event: Event) -> bool:
        match event:
            case events.PlanAdopted():
                self.plannings.append(event)
            case events.PlanningStep(iteration=iteration, loss=loss, picture=picture):
                self._curve.append((iteration, loss))
                self.growing = picture or self.growing
            case events.Planned():
                self._hear_planned(event)
            case events.Scheduled(done, strokes, seconds=seconds, pace=pace):
                self.of, self.pace = strokes or self.of, pace
                if done == 0 or self.expected_seconds is None:
                    self.expected_seconds = seconds
            case events.TimelapseFrame(picture=str(picture)):
                self.photograph = picture
            case events.Looked(pictures=pictures):
                self.looks.append(LookState(event, self._why))
                self._why, self.growing, self.remark = "", None, ""
                self.photograph = pictures.get("seen", self.photograph)
            case events.Remark(sentence, "touch" | "last look", brush):
                self.touch |= {brush: sentence} if brush else {}
                self._add_to_look(touch=(*self.looks[-1].touch, sentence) if self.looks else ())
            case events.ResultFound("found", picture):
                self._add_to_look(found=picture)
            case events.CanvasPicture(picture, by="renderer"):
                self.assumed = picture
            case events.CanvasPicture(picture, done, by, content, light):
                if by == "person":
                    self.pictured, self.assumed, self.last_photograph = done, None, None
                else:
                    self.light, self.person_seen = light, self.person_painted
                self.photographed += 1
                if picture is not None:
                    self.last_photograph, self.photographs[picture] = picture, content
            case _:
                return False
        return True

    def _hear_planned(self, planned: events.Planned) -> None:
        done = planned.done
        self.phases.append((f"after {done} strokes" if done else f"plan for {planned.strokes} strokes", self._curve))
        self._curve, self.growing, self.remark = [], None, ""
        if planned.similarity is not None:
            self.forecasts.append((done, planned.similarity))
        if planned.shown:
            self.replanned = planned
        if self.looks and self.looks[-1].told.done == done and self.looks[-1].planned is None:
            self._add_to_look(planned=planned)

    def _add_to_look(self, **facts: Any) -> None:
        if self.looks:
            self.looks[-1] = replace(self.looks[-1], **facts)

    def _hear_person(self, event: Event) -> bool:
        match event:
            case events.Paused():
                self.pause, self.paused, self._why = event, True, ""
            case events.WentOn():
                self.paused, self.proposed, self.remark = False, None, ""
            case events.Remark(sentence, ""):
                self.remark = sentence
            case events.CommandTaken(command):
                self.request = command
                if command:
                    self._why = "asked"
                if self.doing not in ENDS:
                    self.doing = "planning" if command else "paused" if self.paused else self.doing
            case events.CommandDone(events.Turns() as turns):
                self.turns = turns
            case events.CommandDone(events.DrawnRegion(drawing, only) as region):
                self.region = None if drawing is None else region
                self._why = "freed" if drawing is None else "only" if only else "region"
                self.person_released = self.person_painted if drawing is None else self.person_released
            case events.CommandDone(events.NewGoal() as goal):
                self.goals, self.proposed, self._why = [*self.goals, goal], None, "goal"
            case events.CommandDone(events.MadePictures() as made):
                self.request, self.proposed = {}, made
                self.doing = "paused" if self.paused and self.doing not in ENDS else self.doing
            case events.Asked(question):
                self.question = question
            case events.PersonMayPaint():
                self.may_paint = event
            case events.StrokeOfPerson(number, painted=painted):
                self.person = [*self.person[: number - 1], event]
                self.person_painted, self.remark = (number, "") if painted else (self.person_painted, self.remark)
            case _:
                return False
        return True

    def wet(self, now: datetime | None = None) -> float | None:
        """Returns the seconds that the last layer still dries; None if drying did not begin.

        now: current time. None: nothing has dried since the painting broke off, as in a simulated studio.
        """
        if self.drying is None or self.drying[0].done != self.painted:
            return None
        drying, noted = self.drying
        passed = 0.0 if now is None or noted is None else max(0.0, (now - noted).total_seconds())
        return max(0.0, drying.left - passed)

    def decide(self, *, repaint: bool) -> None:
        """Decides about the stroke in doubt, if there is one: it is painted again, or given up."""
        if self.in_doubt is not None and not repaint:
            self.painted = self.in_doubt
            self.given_up.append(self.in_doubt)
        self.in_doubt = None
