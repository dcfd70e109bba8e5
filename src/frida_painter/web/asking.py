"""Questions that a worker asks the person at the page, and waits for: calibration, paints to fill, strokes in doubt."""

import secrets
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from torch import Tensor

from frida_painter import images
from frida_painter.event_log import LogReader
from frida_painter.session.page_events import Answered, Asked
from frida_painter.session.procedures.dialogue import Answer, Confirm, Jog, Measure, PointCorners, Question
from frida_painter.web.answers import understood
from frida_painter.web.feed import Feed
from frida_painter.web.folder import PaintingFolder
from frida_painter.web.stop_line import StopWatch

_BETWEEN_GLANCES = 0.04


@dataclass
class Asker:
    """Puts questions on the page; `answer` is what a procedure's dialogue and an operator want."""

    folder: PaintingFolder
    feed: Feed
    stop: StopWatch
    _shown: deque[str] = field(default_factory=deque, init=False)

    def answer(self, question: Question) -> Answer:
        """What the person says, who is waited for. Raises StopPressed where they stop everything."""
        number = secrets.token_hex(8)
        asked = described(question)
        picture = None if isinstance(question, Measure) else question.picture
        if picture is not None:
            asked |= {"picture": self._show(picture), "rows": picture.shape[1], "columns": picture.shape[2]}
        reader = LogReader(self.folder.replies)
        reader.read()  # what was said before does not count
        self.feed.tell(Asked({"id": number, **asked}))
        while True:
            self.stop.heed()
            for line in reader.read():
                answer = understood(line, number, asked)
                if answer is not None:
                    self.feed.tell(Answered())
                    return answer
            time.sleep(_BETWEEN_GLANCES)

    def _show(self, picture: Tensor) -> str:
        # Whoever knows its name may see it: it is not to be guessed.
        name = f"question-{secrets.token_hex(12)}.jpg"
        images.save(picture, self.folder.live / name)
        self._shown.append(name)
        while len(self._shown) > 2:
            (self.folder.live / self._shown.popleft()).unlink(missing_ok=True)
        return name


def described(question: Question) -> dict[str, Any]:
    """A question as plain values, but for its picture."""
    match question:
        case Confirm(text=text, proposal=proposal):
            return {"kind": "confirm", "text": text, "proposal": proposal}
        case PointCorners(text=text, proposal=proposal):
            corners = None if proposal is None else [[float(x), float(y)] for x, y in proposal]
            return {"kind": "corners", "text": text, "proposal": corners}
        case Jog():
            step = None if question.proposal is None else question.proposal.step
            told = {"kind": "jog", "text": question.text, "height": question.height, "proposal": step}
            return told | {"lowest": question.lowest, "highest": question.highest}
        case Measure():
            told = {"kind": "measure", "text": question.text, "proposal": question.proposal}
            return told | {"lowest": question.lowest, "highest": question.highest}
