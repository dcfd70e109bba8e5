"""Journal of a painting: every stroke, motion, plan and photograph, so that another process can resume it.

An entry is on the disk before the painting continues. A stroke is noted before the robot gets it and again when it
is done, so that after a crash at most one stroke is in doubt. The session therefore writes these entries by direct
calls and can pause if they fail. Less important entries reach the journal like any listener.
"""

import contextlib
import getpass
import os
import socket
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import images, storage
from frida_painter.easel.kinds import JOURNAL
from frida_painter.errors import StorageError
from frida_painter.event_log import EventLog
from frida_painter.hardware.robot import Frame
from frida_painter.perception.flatfield import FlatField
from frida_painter.plan import Plan
from frida_painter.planning.placement import Placement, TouchHeights
from frida_painter.session.choreography import Action
from frida_painter.session.events import (
    BrushInHand,
    CanvasPicture,
    Dipped,
    Drying,
    Event,
    Failed,
    Finished,
    LastLookDoubted,
    MotionBegan,
    PaintingBegun,
    Paused,
    Photographed,
    PlanAdopted,
    SessionResumed,
    StrokeLeftOut,
    StrokePainted,
    Written,
    events_of,
    record,
    time_of,
)
from frida_painter.session.making_events import PicturesMade
from frida_painter.session.person_events import (
    GoalChanged,
    PersonStrokeBegan,
    PersonStrokePainted,
    RegionProtected,
    RequestTaken,
)

# History from a journal: progress, plan and the stroke in doubt.

FORMAT = "frida-painter journal"
VERSION = 2


@dataclass(frozen=True)
class Planning:
    """Plan that was adopted, or kept after a look.

    digest: digest of the plan.
    done: number of painted strokes at that time.
    photograph: file of the photograph that it was made for.
    placement: placement at that time.
    answers: True if its rest answers a person, and is not on the way to the goal.
    """

    digest: str
    done: int
    photograph: str | None
    placement: Placement
    answers: bool = False


@dataclass
class History:
    """Progress of a painting, from its journal.

    settings, rests_on: values at the beginning of the painting.
    plannings: adopted or kept plans, in order.
    painted: number of strokes that are done or given up.
    in_doubt: number of the stroke that was begun and not ended.
    given_up: numbers of strokes that were skipped in doubt or left out by a person.
    drying: last event of a layer that dries on the canvas, and the time of its record.
    held: brush that a robot with a rack holds; "" for none, None if the painting broke off during a change.

    light: light at the last look, [3, terms].
    photographs: sha256 of each kept photograph, by file; None in journals of earlier versions.
    last_photograph: file of the last kept photograph.
    assumed: file of the last rendered canvas, if it is newer than every photograph.
    pictured: number of strokes in the last picture that a person took without a camera; 0 if there is none.
    looks, dips, cleanings, runs: their numbers.

    region: file of the region that a person drew, and True if only its inside may be painted; None without a
    region.
    goals: changes of the goal, in order.
    request: what a person asked for and the painter had not done yet; empty if there is nothing.
    proposed: pictures that a maker proposed in the last pause, from which nobody has chosen; None if there are none.

    person: strokes of a person, in order; of the last one, the end may be unknown.
    person_painted: number of the person's last stroke that is certainly on the canvas.
    person_seen: number of the person's last stroke at the last look.
    person_released: number of the person's last stroke when they last ended a protection.

    finished: True if the painting is complete.
    robot_seconds: robot time of a finished painting.
    seconds: time spent, without the breaks between runs.
    last: time of the last record.
    missing: number of records lost at the journal's end.
    """

    settings: dict[str, Any]
    rests_on: dict[str, str]
    plannings: list[Planning] = field(default_factory=list)
    painted: int = 0
    in_doubt: int | None = None
    drying: tuple[Drying, datetime] | None = None
    light: list[list[float]] | None = None
    held: str | None = ""
    looks: int = 0
    last_photograph: str | None = None
    assumed: str | None = None
    pictured: int = 0
    photographs: dict[str, str | None] = field(default_factory=dict)
    region: tuple[str, bool] | None = None
    goals: list[GoalChanged] = field(default_factory=list)
    request: dict[str, Any] = field(default_factory=dict)
    proposed: PicturesMade | None = None
    person: list[PersonStrokeBegan] = field(default_factory=list)
    person_painted: int = 0
    person_seen: int = 0
    person_released: int = 0
    dips: int = 0
    cleanings: int = 0
    runs: int = 0
    given_up: list[int] = field(default_factory=list)
    finished: bool = False
    seconds: float = 0.0
    last: datetime | None = None
    missing: int = 0
    robot_seconds: float = 0.0

    @property
    def left_out(self) -> frozenset[int]:
        """Indices in the plan, from 0, of the strokes that were given up."""
        return frozenset(number - 1 for number in self.given_up)

    @property
    def goal(self) -> str:
        """Folder of the changed goal, "" before a change."""
        return self.goals[-1].goal if self.goals else ""

    @property
    def person_in_doubt(self) -> PersonStrokeBegan | None:
        """The person's stroke that was begun and not ended; None if there is none."""
        return self.person[-1] if len(self.person) > self.person_painted else None

    @property
    def is_pictured(self) -> bool:
        """True if a person's picture, taken without a camera, shows the finished canvas."""
        return self.finished and 0 < self.pictured == self.painted

    @classmethod
    def of(cls, records: Iterable[dict[str, Any]], folder: Path) -> "History":
        """Returns the history from the records of a journal in `folder`.

        Raises StorageError if the journal is not a painting's, is of another version, or lacks something.
        """
        first, *others = records
        if first.get("format") != FORMAT:
            raise StorageError(f"{folder} holds a journal that is not a painting's; give the folder of a painting.")
        if first.get("version") == 1:
            raise StorageError(storage.refuse_first_version(f"The journal in {folder}"))
        if first.get("version") != VERSION:
            raise StorageError(
                f"{folder} holds a journal of version {first.get('version')!r}; this program reads version {VERSION}; "
                "resume it with the program that it was begun with, or a newer one."
            )
        with storage.understanding(folder / JOURNAL, "the journal of a painting"):
            (begun,) = events_of(first)
            if not isinstance(begun, PaintingBegun):
                raise ValueError("the painting's beginning")
            history = cls(begun.settings, begun.rests_on)
            for record in (first, *others):
                for event in events_of(record):
                    history._hear(event, time_of(record))
        return history

    def _hear(self, event: Written, at: datetime) -> None:
        if isinstance(event, PaintingBegun | SessionResumed):
            self.runs += 1
        elif self.last is not None:
            # The clock of the machine may have been set back meanwhile.
            self.seconds += max(0.0, (at - self.last).total_seconds())
        self.last = at
        match event:
            case SessionResumed(decision=decision):
                self.decide(repaint=decision == "repaint")
            case PlanAdopted(plan, done, photograph, error, information):
                touch = TouchHeights(event.depths, event.lower, event.touch_information)
                placement = Placement(error, information, touch)
                self.plannings.append(Planning(plan, done, photograph, placement, event.answers))
            case Photographed(photograph=photograph, light=light, content=content):
                self.looks += 1
                self.light = light
                if light is not None:
                    FlatField.of(light)  # or it is refused here, with all else of the journal
                self.person_seen = self.person_painted
                if photograph is not None:
                    self.last_photograph = photograph
                    self.photographs[photograph] = content
            case CanvasPicture(picture, done, seen=True, content=content):
                self.looks += 1
                self.pictured = done
                self.assumed = None
                if picture is not None:
                    self.last_photograph = picture
                    self.photographs[picture] = content
            case CanvasPicture(picture):
                self.assumed = picture
            case MotionBegan(stroke=int(stroke)):
                self.in_doubt, self.proposed = stroke, None
            case StrokePainted(done=done):
                self.painted, self.in_doubt = done, None
            case StrokeLeftOut(done=done):
                self.painted, self.in_doubt = done, None
                self.given_up.append(done)
            case Drying():
                self.drying = event, at
            case BrushInHand(brush):
                self.held = brush
            case Dipped(cleaned=cleaned):
                self.dips += 1
                self.cleanings += int(cleaned)
            case RegionProtected(region=region, only=only):
                self.region = None if region is None else (region, only)
                self.person_released = self.person_painted if region is None else self.person_released
            case GoalChanged():
                self.goals, self.proposed = [*self.goals, event], None
            case RequestTaken(request):
                self.request = request
            case PicturesMade():
                self.request, self.proposed = {}, event
            case PersonStrokeBegan(number):
                self.person = [*self.person[: number - 1], event]
            case PersonStrokePainted(number):
                self.person_painted = number
            case Finished(robot_seconds=robot_seconds):
                self.finished, self.robot_seconds = True, robot_seconds
            case _:
                pass

    def wet(self, now: datetime | None = None) -> float | None:
        """Returns the seconds that the last layer still dries; None if drying did not begin.

        now: current time. None: nothing has dried since the painting broke off, as in a simulated studio.
        """
        if self.drying is None or self.drying[0].done != self.painted:
            return None
        drying, noted = self.drying
        passed = 0.0 if now is None else max(0.0, (now - noted).total_seconds())
        return max(0.0, drying.left - passed)

    def decide(self, *, repaint: bool) -> None:
        """Decides about the stroke in doubt, if there is one: it is painted again, or given up."""
        if self.in_doubt is not None and not repaint:
            self.painted = self.in_doubt
            self.given_up.append(self.in_doubt)
        self.in_doubt = None


PLAN = "plan.json"
PHOTOGRAPHS = "photographs"
A_PHOTOGRAPH = "a photograph of the canvas"


class Journal:
    """Writes the journal, the plan and the photographs into a painting's folder.

    book: file of the journal. None: nothing is written.
    Raises StorageError if an entry that resuming needs cannot be written; a photograph is left out instead.
    """

    def __init__(self, book: EventLog | None, looks: int = 0) -> None:
        self._book = book
        self._looks = looks
        self._photograph: str | None = None

    @classmethod
    def nowhere(cls) -> Self:
        """Returns a journal that writes nothing."""
        return cls(None)

    @classmethod
    def begin(cls, folder: Path, settings: dict[str, Any], rests_on: dict[str, str]) -> Self:
        """Returns the journal of a new painting.

        settings: settings of the painting, as plain values.
        rests_on: hashes, by name, of the other inputs (goal, calibration and brush), which are compared when it is
        resumed.
        """
        begun = record(PaintingBegun(settings, rests_on, **_who()))
        return cls(EventLog.begin(folder / JOURNAL, {"format": FORMAT, "version": VERSION, **begun}))

    @classmethod
    def reopen(cls, folder: Path) -> tuple[Self, History]:
        """Returns the journal of a painting that broke off, and its history.

        Raises StorageError if the folder has no journal, a damaged one, or one of another version.
        """
        if not storage.exists(folder / JOURNAL):
            raise StorageError(
                f"{storage.abridge(folder)} is not the folder of a painting: it holds no journal; give one that does."
            )
        book = EventLog(folder / JOURNAL)
        try:
            history = History.of(book.found, folder)
        except StorageError:
            book.close()
            raise
        history.missing = book.missing
        return cls(book, history.looks), history

    def close(self) -> None:
        """Closes the journal, so that another process can open it."""
        if self._book is not None:
            self._book.close()

    def record_resume(self, history: History, *, repaint: bool) -> None:
        """Notes that a person resumed the painting and decided about the stroke in doubt; updates `history`."""
        decision = "" if history.in_doubt is None else "repaint" if repaint else "skip"
        self.tell(SessionResumed(history.painted, history.in_doubt, decision, **_who()))
        history.decide(repaint=repaint)

    def record_plan(self, plan: Plan, done: int, placement: Placement, *, answers: bool = False) -> None:
        """Notes that painting follows this plan of all strokes from stroke `done` + 1 on, and saves the plan.

        answers: True if the rest answers a person. The note comes first, so that the journal knows every plan that the
        folder may hold.
        """
        self.record_kept_plan(plan, done, placement, answers=answers)
        if self._book is not None:
            plan.save(self._book.path.with_name(PLAN))

    def record_kept_plan(self, plan: Plan, done: int, placement: Placement, *, answers: bool = False) -> None:
        """Notes that painting still follows this plan after a look at stroke `done`, with the newer placement."""
        touch = placement.touch
        where = (placement.error, placement.information, dict(touch.depths), touch.lower, touch.information)
        self.tell(PlanAdopted(plan.digest, done, self._photograph, *where, answers=answers))

    def begins(self, action: Action, plan: Plan) -> None:
        """Notes that the robot will now get this action. Raises StorageError if there is no room to note its end."""
        if self._book is not None:
            self._book.require_reserve()
        what = tuple(motion.label for motion in action.motions)
        painted = action.done
        if isinstance(painted, StrokePainted):
            self.tell(MotionBegan(what, painted.done, plan.digest))
        else:
            self.tell(MotionBegan(what))

    def ends(self, done: Dipped | StrokePainted | StrokeLeftOut) -> None:
        """Notes that the robot has done an action, or that a person has left out a stroke."""
        self.tell(done)

    def record_look(self, frame: Frame, light: FlatField | None) -> None:
        """Notes a photograph for planning, and keeps it in the camera's pixels if there is room."""
        name = f"{PHOTOGRAPHS}/look-{self._looks:04d}.png"
        self._looks += 1
        content = self._keep(frame.image, name)
        light_now = None if light is None else light.logarithm.tolist()
        self.tell(Photographed(self._photograph, frame.captured_at, frame.sequence, light_now, content))

    def record_assumption(self, canvas: Tensor, done: int) -> None:
        """Notes the rendered canvas [3, H, W] after `done` strokes, and keeps its picture if there is room."""
        name = f"{PHOTOGRAPHS}/assumed-{done:06d}.png"
        content = self._keep(images.to_uint8(canvas), name)
        self.tell(CanvasPicture(self._photograph, done, content=content))

    def record_picture(self, canvas: Tensor, done: int) -> None:
        """Notes a person's picture of the canvas [3, H, W] after `done` strokes, and keeps it if there is room."""
        name = f"{PHOTOGRAPHS}/seen-{self._looks:04d}.png"
        self._looks += 1
        content = self._keep(images.to_uint8(canvas), name)
        self.tell(CanvasPicture(self._photograph, done, seen=True, content=content))

    def tell(self, event: Written) -> None:
        """Writes an event; it is on the disk when this returns."""
        if self._book is not None:
            self._book.append(record(event))

    def hear(self, event: Event) -> None:
        """Notes events that resuming does not need; they are left out if there is no room."""
        if isinstance(event, Paused | Failed | LastLookDoubted):
            with contextlib.suppress(StorageError):
                self.tell(event)

    def _keep(self, photograph: NDArray[np.uint8], name: str) -> str | None:
        """Saves a photograph, beside one of its name, and returns its sha256; None if it was not saved."""
        self._photograph = None
        if self._book is None:
            return None
        path = storage.find_unused(self._book.path.parent / name)
        try:
            images.save_exactly(photograph, path)
            content = storage.sha256(path, A_PHOTOGRAPH)
        except StorageError:
            return None
        self._photograph = f"{PHOTOGRAPHS}/{path.name}"
        return content


def _who() -> dict[str, Any]:
    """Returns the person's name and machine, the process number and the program version."""
    try:
        name = getpass.getuser()
    except (OSError, KeyError):
        name = str(os.getuid())
    return {"by": f"{name}@{socket.gethostname()}", "process": os.getpid(), "program": version("frida-painter")}
