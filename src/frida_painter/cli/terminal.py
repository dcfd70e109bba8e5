"""The terminal as the place of a calibration dialogue: questions become lines to read, and lines typed answers."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from torch import Tensor

from frida_painter import images
from frida_painter.errors import Interrupted
from frida_painter.session.procedures.dialogue import (
    Answer,
    Confirm,
    Corners,
    Jog,
    JogMove,
    Measure,
    PointCorners,
    Question,
)

_STEPS = {"u": 0.001, "d": -0.001, "uu": 0.005, "dd": -0.005, "+": 0.0002, "-": -0.0002}


@dataclass(frozen=True)
class Terminal:
    """Leads a dialogue line by line; `answer` is what `dialogue.lead` wants.

    ask: shows a prompt and returns the line typed, raises EOFError where there are no more; tell:
    shows a line; pictures: the folder in which pictures to look at are put.
    """

    ask: Callable[[str], str]
    tell: Callable[[str], None]
    pictures: Path

    def answer(self, question: Question) -> Answer:
        """What the person types, asked again until it can be understood. Raises Interrupted where they leave."""
        self.tell(question.text)
        if not isinstance(question, Measure):
            self._show(question.picture)
        while True:
            try:
                line = self.ask(_prompt(question)).strip().lower()
            except (EOFError, KeyboardInterrupt) as end:
                raise Interrupted("You left, or nobody is there to answer; what was done before is kept.") from end
            understood = _understood(question, line)
            if understood is not None:
                return understood
            self.tell(_allowed(question))

    def _show(self, picture: Tensor | None) -> None:
        if picture is not None:
            path = self.pictures / "question.png"
            images.save(picture, path)
            self.tell(f"  Look at {path}")


def _prompt(question: Question) -> str:
    match question:
        case Confirm(proposal=proposal):
            return "[Y/n] " if proposal else "[y/N] "
        case PointCorners(proposal=None):
            return "Four corners: "
        case PointCorners(proposal=proposal):
            points = "  ".join(f"{column:.1f},{row:.1f}" for column, row in proposal or ())
            return f"Four corners [{points}]: "
        case Jog(height=height):
            return f"{height * 1000:.1f} mm> "
        case Measure(proposal=None):
            return "mm: "
        case Measure(proposal=proposal):
            return f"mm [{(proposal or 0) * 1000:g}]: "


def _understood(question: Question, line: str) -> Answer | None:
    """What a line means as an answer; None where it means nothing."""
    match question:
        case Confirm(proposal=proposal):
            return proposal if not line else {"y": True, "yes": True, "n": False, "no": False}.get(line)
        case PointCorners(proposal=proposal):
            return _corners(line) if line else proposal
        case Jog():
            return _move(question, line)
        case Measure(lowest=lowest, highest=highest, proposal=proposal):
            length = _length(line) if line else proposal
            return length if length is not None and lowest <= length <= highest else None


def _corners(line: str) -> Corners | None:
    numbers = [float(word) for word in re.findall(r"-?\d+(?:\.\d+)?", line)]
    if len(numbers) != 8 or re.search(r"[a-z]", line):
        return None
    return tuple(zip(numbers[::2], numbers[1::2], strict=True))


def _move(question: Jog, line: str) -> JogMove | None:
    if not line:
        return question.proposal
    if line == "ok":
        return JogMove(settled=True)
    step = _STEPS[line] if line in _STEPS else _length(line)
    if step is None or not question.lowest <= question.height + step <= question.highest:
        return None
    return JogMove(step)


def _length(line: str) -> float | None:
    """ "31", "31mm", "3.1 cm" in metres."""
    match = re.fullmatch(r"([+-]?\d+(?:\.\d+)?)\s*(mm|cm|m)?", line)
    if match is None:
        return None
    metres = float(match[1]) * {"mm": 0.001, "cm": 0.01, "m": 1.0}[match[2] or "mm"]
    return metres if math.isfinite(metres) else None


def _allowed(question: Question) -> str:
    match question:
        case Confirm():
            return "Type y or n."
        case PointCorners():
            return (
                "Type eight numbers, column and row of the top left, top right, bottom right and bottom left corner in "
                "pixels of the picture, like 120,80 1400,95 1420,1010 100,1000"
                + ("; or only Enter to take those in brackets." if question.proposal else ".")
            )
        case Jog(lowest=lowest, highest=highest):
            return (
                "Type u or d for 1 mm up or down, uu or dd for 5 mm, + or - for 0.2 mm, a number of millimetres, or ok "
                f"where it is right; the brush moves from {lowest * 1000:.1f} to {highest * 1000:.1f} mm."
            )
        case Measure(lowest=lowest, highest=highest):
            return f"Type millimetres, from {lowest * 1000:g} to {highest * 1000:g}."
