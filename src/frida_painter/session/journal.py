"""Journal of a painting: all its events, so that others can show it and another process can resume it.

Entries that resuming needs (`Durable`) are on the disk before the painting goes on: a stroke is noted before the robot
gets it and again when it is done, so that after a crash at most one stroke is in doubt. The session writes them by
direct calls and can pause if they fail. Other events only show something; the engine appends them, and they may be
lost. `Journal.state` folds all of them.
"""

import contextlib
import os
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.easel.kinds import JOURNAL
from frida_painter.errors import StorageError
from frida_painter.hardware.robot import Frame
from frida_painter.perception.flatfield import FlatField
from frida_painter.planning.placement import Placement, TouchHeights
from frida_painter.session import events
from frida_painter.session.choreography import Action
from frida_painter.session.events import Durable, Event, record, time_of
from frida_painter.session.fold import FORMAT, VERSION, PaintingState, require_journal
from frida_painter.strokes.plan import Plan
from frida_painter.system import images, locks, storage
from frida_painter.system.event_log import EventLog

PLAN = "plan.json"
PHOTOGRAPHS = "photographs"
A_PHOTOGRAPH = "a photograph of the canvas"


class Journal:
    """Writes the journal, the plan and the photographs into a painting's folder.

    book: file of the journal. None: nothing is written.
    state: fold of all events.
    Raises StorageError if an entry that resuming needs cannot be written; a photograph is left out instead.
    """

    def __init__(self, book: EventLog | None, state: PaintingState | None = None) -> None:
        self._book, self.state = book, state or PaintingState()
        self._photograph: str | None = None

    @classmethod
    def begin(cls, folder: Path, settings: dict[str, Any], rests_on: dict[str, str]) -> Self:
        """Returns the journal of a new painting. Resuming compares the arguments, as in PaintingBegun."""
        begun = events.PaintingBegun(settings, rests_on, **_who())
        first = {"format": FORMAT, "version": VERSION, **record(begun)}
        journal = cls(EventLog.begin(folder / JOURNAL, first))
        journal.state.hear(begun, time_of(first))
        return journal

    @classmethod
    def reopen(cls, folder: Path) -> tuple[Self, PaintingState]:
        """Returns the journal of a painting that broke off, and its state.

        Raises StorageError if the folder has no journal, a damaged one, or one of another version.
        """
        require_journal(folder)
        book = EventLog(folder / JOURNAL)
        try:
            state = PaintingState.of_journal(book.found, folder)
            with storage.understanding(folder / JOURNAL, "the journal of a painting"):
                for planning in state.planning.adopted:
                    placement_of(planning)
                if state.pictures.light is not None:
                    FlatField.of(state.pictures.light)
        except StorageError:
            book.close()
            raise
        state.sittings.missing = book.missing
        return cls(book, state), state

    def close(self) -> None:
        """Closes the journal, so that another process can open it."""
        if self._book is not None:
            self._book.close()

    def record_resume(self, *, repaint: bool) -> events.SessionResumed:
        """Notes that a person resumed the painting and decided about the stroke in doubt; returns the note."""
        in_doubt = self.state.progress.in_doubt
        decision = "" if in_doubt is None else "repaint" if repaint else "skip"
        resumed = events.SessionResumed(self.state.progress.painted, in_doubt, decision, **_who())
        self.tell(resumed)
        return resumed

    def record_plan(
        self, plan: Plan, done: int, placement: Placement, *, answers: bool = False, kept: bool = False
    ) -> None:
        """Notes that painting follows this plan of all strokes from stroke `done` + 1 on, then saves the plan.

        answers: True if the rest answers a person. kept: True if a look at stroke `done` kept the plan, and only the
        placement is newer. The note comes first, so that the journal knows every plan that the folder may hold.
        """
        touch = placement.touch
        where = (placement.error, placement.information, dict(touch.depths), touch.lower, touch.information)
        self.tell(events.PlanAdopted(plan.digest, done, self._photograph, *where, answers=answers))
        if self._book is not None and not kept:
            plan.save(self._book.path.with_name(PLAN))

    def begins(self, action: Action) -> None:
        """Notes that the robot will now get this action. Raises StorageError if there is no room to note its end."""
        if self._book is not None:
            self._book.require_reserve()
        stroke = action.done.done if isinstance(action.done, events.StrokePainted) else None
        self.tell(events.MotionBegan(tuple(motion.label for motion in action.motions), stroke))

    def record_look(self, frame: Frame, light: FlatField | None) -> None:
        """Notes a photograph for planning, and keeps it in the camera's pixels if there is room."""
        content = self._keep(frame.image, f"look-{self.state.pictures.count:04d}.png")
        light_now = None if light is None else light.logarithm.tolist()
        self.tell(events.CanvasPicture(self._photograph, self.state.progress.painted, "camera", content, light_now))

    def record_canvas(self, canvas: Tensor, done: int, *, seen: bool = False) -> events.CanvasPicture:
        """Notes the canvas [3, H, W] after `done` strokes, and keeps its picture if there is room; returns the note.

        seen: True if a person took the picture, False if it is rendered.
        """
        name = f"seen-{self.state.pictures.count:04d}.png" if seen else f"assumed-{done:06d}.png"
        content = self._keep(images.to_uint8(canvas), name)
        noted = events.CanvasPicture(self._photograph, done, "person" if seen else "renderer", content, canvas=canvas)
        self.tell(noted)
        return noted

    def tell(self, event: Event) -> None:
        """Writes an event; it is on the disk when this returns."""
        self._write(event, flush=True)

    def show(self, event: Event) -> None:
        """Appends an event that resuming does not need; without room, or with infinite values, it is left out."""
        if not isinstance(event, Durable):
            self._write(event, flush=False)

    def _write(self, event: Event, *, flush: bool) -> None:
        event = event.without_live()  # the state keeps events, and their pixels would fill the memory
        written = record(event)
        with contextlib.nullcontext() if flush else contextlib.suppress(StorageError, ValueError):
            if self._book is not None:
                self._book.append(written, flush=flush)
        self.state.hear(event, time_of(written))

    def _keep(self, photograph: NDArray[np.uint8], name: str) -> str | None:
        """Saves a photograph, beside one of its name, and returns its sha256; None if it was not saved."""
        self._photograph = None
        if self._book is None:
            return None
        path = storage.find_unused(self._book.path.parent / PHOTOGRAPHS / name)
        try:
            images.save_exactly(photograph, path)
            content = storage.sha256(path, A_PHOTOGRAPH)
        except StorageError:
            return None
        self._photograph = f"{PHOTOGRAPHS}/{path.name}"
        return content


def placement_of(planning: events.PlanAdopted) -> Placement:
    """Returns the placement that was known when a plan was adopted."""
    touch = TouchHeights(planning.depths, planning.lower, planning.touch_information)
    return Placement(planning.error, planning.information, touch)


def _who() -> dict[str, Any]:
    """Returns the person's name and machine, the process number and the program version."""
    return {"by": locks.who(), "process": os.getpid(), "program": version("frida-painter")}
