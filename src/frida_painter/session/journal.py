"""The journal of a painting: every stroke, motion, plan and photograph, so that another process can go on.

What is in the journal is on the disk. A stroke is noted before the robot is told of it and again when
it is done, so that after any crash at most one stroke is in doubt.
"""

import getpass
import os
import socket
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from frida_painter import images
from frida_painter.errors import StorageError
from frida_painter.hardware.camera import Frame
from frida_painter.perception.flatfield import FlatField
from frida_painter.plan import Plan
from frida_painter.planning.placement import Placement
from frida_painter.session.choreography import Action
from frida_painter.event_log import EventLog
from frida_painter.session.events import Dipped, StrokeLeftOut, StrokePainted
from frida_painter.session.history import FORMAT, VERSION, History
from frida_painter.session.names import JOURNAL

PLAN = "plan.json"
PHOTOGRAPHS = "photographs"


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
        begun = {"format": FORMAT, "version": VERSION, "settings": settings, "rests_on": rests_on}
        return cls(EventLog.begin(folder / JOURNAL, _dated("begun", **begun, **_who())))

    @classmethod
    def reopen(cls, folder: Path) -> tuple[Self, History]:
        """The journal of a painting that broke off, and what it tells."""
        if not (folder / JOURNAL).is_file():
            raise StorageError(f"{folder} is not the folder of a painting: it holds no journal; give one that does.")
        book = EventLog(folder / JOURNAL)
        try:
            history = History.of(book.found, folder)
        except StorageError:
            book.close()
            raise
        return cls(book, history.looks), history

    def close(self) -> None:
        """Lets another process have the journal."""
        if self._book is not None:
            self._book.close()

    def resumed(self, history: History, *, repaint: bool) -> None:
        """A person has had the painting resumed, and decided on the stroke in doubt; so `history` has it then."""
        in_doubt = history.in_doubt
        decision = {} if in_doubt is None else {"in_doubt": in_doubt, "decision": "repaint" if repaint else "skip"}
        self.note("resumed", painted=history.painted, **decision, **_who())
        history.decide(repaint=repaint)

    def planned(self, plan: Plan, done: int, placement: Placement) -> None:
        """From stroke `done` + 1 on, painting goes by this plan of all strokes, which is put into the folder.

        It is noted first, so that a plan that stands in the folder is always one that the journal names.
        """
        self.note(
            "planned",
            plan=plan.digest,
            done=done,
            photograph=self._photograph,
            placement={"error": placement.error, "information": placement.information},
        )
        if self._book is not None:
            plan.save(self._book.path.with_name(PLAN))

    def begins(self, action: Action, plan: Plan) -> None:
        """The robot will now be told this."""
        painted = action.done
        stroke = {"stroke": painted.done, "plan": plan.digest} if isinstance(painted, StrokePainted) else {}
        self.note("began", what=[motion.label for motion in action.motions], **stroke)

    def ends(self, done: Dipped | StrokePainted | StrokeLeftOut) -> None:
        """The robot has done it, or a person has left it out."""
        match done:
            case Dipped(paint, cleaned):
                self.note("ended", paint=paint, cleaned=cleaned)
            case StrokePainted(stroke):
                self.note("ended", stroke=stroke)
            case StrokeLeftOut(stroke):
                self.note("ended", stroke=stroke, left_out=True)

    def looked(self, frame: Frame, light: FlatField | None) -> None:
        """A photograph was taken for planning; it is kept as the camera gave it where there is room for it."""
        name = f"{PHOTOGRAPHS}/look-{self._looks:04d}.png"
        self._looks += 1
        self._photograph = name if self._keep(frame.image, name) else None
        self.note(
            "looked",
            photograph=self._photograph,
            captured_at=frame.captured_at,
            sequence=frame.sequence,
            light=light and light.logarithm.tolist(),
        )

    def note(self, kind: str, **facts: Any) -> None:
        """Anything else that happened; facts are plain values."""
        if self._book is not None:
            self._book.append(_dated(kind, **facts))

    def _keep(self, photograph: NDArray[np.uint8], name: str) -> bool:
        if self._book is None:
            return False
        try:
            images.save_exactly(photograph, self._book.path.parent / name)
        except StorageError:
            return False
        return True


def _dated(kind: str, **facts: Any) -> dict[str, Any]:
    return {"kind": kind, "at": datetime.now(UTC).isoformat(timespec="milliseconds"), **facts}


def _who() -> dict[str, Any]:
    """Who paints: the person's name on this machine, the machine, the process and the program."""
    try:
        name = getpass.getuser()
    except (OSError, KeyError):
        name = str(os.getuid())
    return {"by": f"{name}@{socket.gethostname()}", "process": os.getpid(), "program": version("frida-painter")}
