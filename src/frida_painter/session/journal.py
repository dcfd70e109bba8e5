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
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from frida_painter import images, storage
from frida_painter.errors import StorageError
from frida_painter.event_log import EventLog
from frida_painter.hardware.camera import Frame
from frida_painter.perception.flatfield import FlatField
from frida_painter.plan import Plan
from frida_painter.planning.placement import Placement
from frida_painter.session.choreography import Action
from frida_painter.session.events import (
    Dipped,
    Event,
    Failed,
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
    record,
)
from frida_painter.session.history import FORMAT, VERSION, History, renewed_journal
from frida_painter.session.names import JOURNAL

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
