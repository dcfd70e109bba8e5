"""The journal of a painting: every stroke, motion, plan and photograph, so that another process can go on.

What is in the journal is on the disk. A stroke is noted before the robot is told of it and again when
it is done, so that after any crash at most one stroke is in doubt. That is why the session calls the journal
itself for what must be on the disk before it goes on, and can pause where it cannot be; what is only good
to know the journal hears like any listener.
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
    Dipped,
    Drying,
    Event,
    Failed,
    Finished,
    GoalChanged,
    LastLookDoubted,
    MotionBegan,
    PaintingBegun,
    Paused,
    Photographed,
    PlanAdopted,
    RegionProtected,
    SessionResumed,
    StrokeLeftOut,
    StrokePainted,
    Written,
    events_of,
    record,
    time_of,
)
from frida_painter.session.old_events import renewed

# What a journal tells: how far a painting came, by which plan, and which stroke is in doubt.

FORMAT = "frida-painter journal"
VERSION = 2


@dataclass(frozen=True)
class Planning:
    """A plan that was adopted, or kept after a look: its digest, strokes painted then, photograph and placement."""

    digest: str
    done: int
    photograph: str | None
    placement: Placement


@dataclass
class History:
    """How far a painting came.

    settings, rests_on: as it was begun; plannings: the plans that were adopted or kept, in order; painted: strokes
    that are done or were given up; in_doubt: the number of the stroke that was begun and not ended;
    drying: the last word of a layer that dries on the canvas, and when it was written; light: of the last look,
    [3, terms]; held: the brush that a robot with a rack holds, "" for none, None where it broke off while it changed
    it; looks, dips, cleanings, runs: how many there were; photographs: the sha256 of those
    that were kept, by file, None where an earlier program took them; given_up:
    numbers of strokes in doubt that were skipped, and of those that a person left out; region: the file of
    what a person drew over the canvas, and whether only there it may be painted, None where nothing is
    protected; goal: the folder of the goal that it is painted towards since it was changed, "" before;
    finished: whether nothing is left to do, and robot_seconds: how long the robot took then; seconds: that were
    spent on it, pauses between runs left out; last: when the last record was written; missing: how many records
    the journal has lost at its end.
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
    photographs: dict[str, str | None] = field(default_factory=dict)
    region: tuple[str, bool] | None = None
    goal: str = ""
    dips: int = 0
    cleanings: int = 0
    runs: int = 0
    given_up: list[int] = field(default_factory=list)
    finished: bool = False
    seconds: float = 0.0
    last: datetime | None = None
    missing: int = 0
    robot_seconds: float = 0.0

    @classmethod
    def of(cls, records: Iterable[dict[str, Any]], folder: Path) -> "History":
        """The history that the records of a journal in `folder` tell. Raises StorageError where they tell none."""
        first, *others = records
        if first.get("format") != FORMAT:
            raise StorageError(f"{folder} holds a journal that is not a painting's; give the folder of a painting.")
        if first.get("version") not in range(1, VERSION + 1):
            raise StorageError(
                f"{folder} holds a journal of version {first.get('version')!r}; this program reads versions up to "
                f"{VERSION}; resume it with the program that it was begun with, or a newer one."
            )
        try:
            (begun,) = events_of(first)
            if not isinstance(begun, PaintingBegun):
                raise ValueError("the painting's beginning")
            history = cls(begun.settings, begun.rests_on)
            for record in (first, *others):
                for event in events_of(record):
                    history._hear(event, time_of(record))
        except (KeyError, TypeError, ValueError) as cause:
            raise StorageError(
                f"The journal in {folder} lacks something ({cause!r}); take an undamaged copy."
            ) from cause
        return history

    def _hear(self, event: Written, at: datetime) -> None:
        if isinstance(event, PaintingBegun | SessionResumed):
            self.runs += 1
        elif self.last is not None:
            # The clock of the machine may have been set back in between.
            self.seconds += max(0.0, (at - self.last).total_seconds())
        self.last = at
        match event:
            case SessionResumed(decision=decision):
                self.decide(repaint=decision == "repaint")
            case PlanAdopted(plan, done, photograph, error, information):
                touch = TouchHeights(event.depths, event.lower, event.touch_information)
                self.plannings.append(Planning(plan, done, photograph, Placement(error, information, touch)))
            case Photographed(photograph=photograph, light=light, content=content):
                self.looks += 1
                self.light = light
                if photograph is not None:
                    self.last_photograph = photograph
                    self.photographs[photograph] = content
            case MotionBegan(stroke=int(stroke)):
                self.in_doubt = stroke
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
            case GoalChanged(goal=goal):
                self.goal = goal
            case Finished(robot_seconds=robot_seconds):
                self.finished, self.robot_seconds = True, robot_seconds
            case _:
                pass

    def wet(self, now: datetime | None = None) -> float | None:
        """Seconds that the last layer still dries; None where it did not begin to.

        now: the time, None where nothing has dried since the painting broke off, as in a simulated studio.
        """
        if self.drying is None or self.drying[0].done != self.painted:
            return None
        drying, noted = self.drying
        passed = 0.0 if now is None else max(0.0, (now - noted).total_seconds())
        return max(0.0, drying.left - passed)

    def decide(self, *, repaint: bool) -> None:
        """Settles the stroke in doubt, if there is one: it is painted again, or given up."""
        if self.in_doubt is not None and not repaint:
            self.painted = self.in_doubt
            self.given_up.append(self.in_doubt)
        self.in_doubt = None


def renewed_journal(records: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """The records of a journal of an earlier version in the words of this one."""
    first, *others = [each for record in records for each in renewed(record)]
    return [{**first, "version": VERSION}, *others]


PLAN = "plan.json"
PHOTOGRAPHS = "photographs"
A_PHOTOGRAPH = "a photograph of the canvas"


class Journal:
    """Writes the journal, the plan and the photographs into a painting's folder.

    book: the journal's file, None where a painting is to leave no traces. Raises StorageError where
    something cannot be written that resuming needs; a photograph is rather left out.
    """

    def __init__(self, book: EventLog | None, looks: int = 0) -> None:
        self._book = book
        self._looks = looks
        self._photograph: str | None = None

    @classmethod
    def nowhere(cls) -> Self:
        """The journal of a painting that nobody will resume."""
        return cls(None)

    @classmethod
    def begin(cls, folder: Path, settings: dict[str, Any], rests_on: dict[str, str]) -> Self:
        """The journal of a new painting.

        settings: how it is painted, as plain values; rests_on: by name, what else decides how it is
        painted (hashes of goal, calibration and brush), to be compared when it is resumed.
        """
        begun = record(PaintingBegun(settings, rests_on, **_who()))
        return cls(EventLog.begin(folder / JOURNAL, {"format": FORMAT, "version": VERSION, **begun}))

    @classmethod
    def reopen(cls, folder: Path) -> tuple[Self, History]:
        """The journal of a painting that broke off, and what it tells; one of an earlier version is written anew."""
        if not storage.exists(folder / JOURNAL):
            raise StorageError(
                f"{storage.shown(folder)} is not the folder of a painting: it holds no journal; give one that does."
            )
        book = EventLog(folder / JOURNAL)
        try:
            history = History.of(book.found, folder)
            if book.found[0]["version"] != VERSION:
                book.replace_all(renewed_journal(book.found))
        except StorageError:
            book.close()
            raise
        history.missing = book.missing
        return cls(book, history.looks), history

    def close(self) -> None:
        """Lets another process have the journal."""
        if self._book is not None:
            self._book.close()

    def resumed(self, history: History, *, repaint: bool) -> None:
        """A person has had the painting resumed, and decided on the stroke in doubt; so `history` has it then."""
        decision = "" if history.in_doubt is None else "repaint" if repaint else "skip"
        self.tell(SessionResumed(history.painted, history.in_doubt, decision, **_who()))
        history.decide(repaint=repaint)

    def planned(self, plan: Plan, done: int, placement: Placement) -> None:
        """From stroke `done` + 1 on, painting goes by this plan of all strokes, which is put into the folder.

        It is noted first, so that a plan that stands in the folder is always one that the journal names.
        """
        self.kept(plan, done, placement)
        if self._book is not None:
            plan.save(self._book.path.with_name(PLAN))

    def kept(self, plan: Plan, done: int, placement: Placement) -> None:
        """After a look at stroke `done` painting still goes by this plan; the placement was learned from the look."""
        touch = placement.touch
        where = (placement.error, placement.information, dict(touch.depths), touch.lower, touch.information)
        self.tell(PlanAdopted(plan.digest, done, self._photograph, *where))

    def begins(self, action: Action, plan: Plan) -> None:
        """The robot will now be told this; not where the disk has no room to take down how it ends."""
        if self._book is not None:
            self._book.require_reserve()
        what = tuple(motion.label for motion in action.motions)
        painted = action.done
        if isinstance(painted, StrokePainted):
            self.tell(MotionBegan(what, painted.done, plan.digest))
        else:
            self.tell(MotionBegan(what))

    def ends(self, done: Dipped | StrokePainted | StrokeLeftOut) -> None:
        """The robot has done it, or a person has left it out."""
        self.tell(done)

    def looked(self, frame: Frame, light: FlatField | None) -> None:
        """A photograph was taken for planning; it is kept as the camera gave it where there is room for it."""
        name = f"{PHOTOGRAPHS}/look-{self._looks:04d}.png"
        self._looks += 1
        content = self._keep(frame.image, name)
        self._photograph = None if content is None else name
        light_now = None if light is None else light.logarithm.tolist()
        self.tell(Photographed(self._photograph, frame.captured_at, frame.sequence, light_now, content))

    def tell(self, event: Written) -> None:
        """Writes an event down; when this returns, it is on the disk."""
        if self._book is not None:
            self._book.append(record(event))

    def hear(self, event: Event) -> None:
        """Notes what is not needed to go on; where it finds no room, it is left out."""
        if isinstance(event, Paused | Failed | LastLookDoubted):
            with contextlib.suppress(StorageError):
                self.tell(event)

    def _keep(self, photograph: NDArray[np.uint8], name: str) -> str | None:
        """sha256 of the file; None where there is none."""
        if self._book is None:
            return None
        path = self._book.path.parent / name
        try:
            images.save_exactly(photograph, path)
            return storage.sha256(path, A_PHOTOGRAPH)
        except StorageError:
            return None


def _who() -> dict[str, Any]:
    """Who paints: the person's name on this machine, the machine, the process and the program."""
    try:
        name = getpass.getuser()
    except (OSError, KeyError):
        name = str(os.getuid())
    return {"by": f"{name}@{socket.gethostname()}", "process": os.getpid(), "program": version("frida-painter")}
