"""Questions to a person at the page: calibration, setup, paints to fill, strokes in doubt."""

import secrets
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from torch import Tensor

from frida_painter.easel.dialogue import (
    JOG_STEPS,
    Answer,
    Choose,
    Confirm,
    EnterAddress,
    Guide,
    Jog,
    Measure,
    PointCorners,
    SetupQuestion,
)
from frida_painter.errors import Interrupted
from frida_painter.session import events
from frida_painter.session.events import Notify
from frida_painter.system import images
from frida_painter_together.inbox import FOLLOWED, Inbox, accept_reply, make_live_path

_BETWEEN_GLANCES = 0.04
MAX_ABSENCE = 600.0
"""Seconds without a page after which a dialogue that can be continued is left: phones sleep, and networks fail."""


@dataclass
class Asker:
    """Asks questions on the page; `answer` is the callback for dialogues and operators.

    folder: of the painting or the job; its inbox has the answers, and its folder LIVE the pictures of questions.
    tell: writes an event into the log that the page follows: the journal of a painting, or the feed of a job.
    heed: called while it waits; raises if the person stops everything.
    may_leave: True if the person may leave the dialogue without a stop. It is then left, too, if no page has followed
        it for MAX_ABSENCE seconds while it waits for an answer, so that the machine is free for others.
    """

    folder: Path
    tell: Notify
    heed: Callable[[], None]
    may_leave: bool = False
    _shown: deque[Path] = field(default_factory=deque, init=False)

    def answer(self, question: SetupQuestion) -> Answer:
        """Waits for the person's answer and returns it.

        Raises the error of `heed`, Interrupted if the person leaves or is gone.
        """
        number = secrets.token_hex(8)
        asked = describe_question(question) | ({"leave": True} if self.may_leave else {})
        picture = getattr(question, "picture", None)
        if picture is not None:
            asked |= {"picture": self._show(picture), "rows": picture.shape[1], "columns": picture.shape[2]}
        inbox = Inbox(self.folder, 0.0)
        inbox.listen()  # earlier answers do not count
        self.tell(events.Asked({"id": number, **asked}))
        followed, since = self._followed(), time.monotonic()
        while True:
            self.heed()
            if (now := self._followed()) not in (followed, None):
                followed, since = now, time.monotonic()
            elif self.may_leave and time.monotonic() - since > MAX_ABSENCE:
                self.tell(events.Asked(None))
                raise Interrupted(
                    f"No page was open for {MAX_ABSENCE / 60:.0f} minutes; what was done before is kept, and the "
                    "machine is free."
                )
            for message in inbox.listen():
                answer = accept_reply(message.reply, number, asked)
                if answer is not None:
                    self.tell(events.Asked(None))
                    return answer
            time.sleep(_BETWEEN_GLANCES)

    def _followed(self) -> int | None:
        """Returns a number that changes while a page follows; None if none ever did."""
        with suppress(OSError):
            return (self.folder / FOLLOWED).stat().st_mtime_ns
        return None

    def _show(self, picture: Tensor) -> str:
        self._shown.append(make_live_path(self.folder, "question", ".jpg"))
        images.save(picture, self._shown[-1])
        while len(self._shown) > 2:
            self._shown.popleft().unlink(missing_ok=True)
        return self._shown[-1].name


_KINDS: dict[type, str] = {
    Confirm: "confirm",
    PointCorners: "corners",
    Jog: "jog",
    Measure: "measure",
    Guide: "guide",
    Choose: "choose",
    EnterAddress: "address",
}


def describe_question(question: SetupQuestion) -> dict[str, Any]:
    """Returns a question as plain values, without its picture."""
    told = {name: value for name, value in vars(question).items() if name != "picture"}
    match question:
        case PointCorners(proposal=tuple(corners)):
            told["proposal"] = [[float(x), float(y)] for x, y in corners]
        case Jog():
            told["proposal"] = None if question.proposal is None else question.proposal.step
        case Guide():
            told |= {"proposal": None, "steps": JOG_STEPS}
        case EnterAddress():
            told["example"] = question.example
        case _:
            pass
    return {"kind": _KINDS[type(question)], **told}
