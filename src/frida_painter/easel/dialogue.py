"""Calibration as a conversation: a procedure asks, whoever leads it answers, and in the end there is a finding."""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeVar

if TYPE_CHECKING:
    from torch import Tensor

    from frida_painter.calibration import Calibration


Found = TypeVar("Found")
Corners = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Confirm:
    """Is something so, or done? Answered with True or False.

    text: the question in plain words; picture [3, h, w]: what to look at, or None; proposal: what the
    procedure would answer itself.
    """

    text: str
    picture: "Tensor | None" = None
    proposal: bool = True


@dataclass(frozen=True)
class PointCorners:
    """Where are the four corners of something in this photograph? Answered with (column, row) pixels.

    They go round clockwise from the top left as it would be read. proposal: the corners that were
    found, or None.
    """

    text: str
    picture: "Tensor"
    proposal: Corners | None


@dataclass(frozen=True)
class Jog:
    """Up or down? Answered with a `JogMove`, until one says that the height is right.

    height: robot z in metres now; lowest, highest: what the workspace allows; proposal: the move
    that the procedure would make, or None where only a person can tell.
    """

    text: str
    height: float
    lowest: float
    highest: float
    picture: "Tensor | None" = None
    proposal: "JogMove | None" = None


@dataclass(frozen=True)
class JogMove:
    """One press of a jog key: step in metres, up positive; settled: the height is right as it is now."""

    step: float = 0.0
    settled: bool = False


@dataclass(frozen=True)
class Measure:
    """How long is something? Answered with metres from lowest to highest.

    proposal: what is known of it so far, or None.
    """

    text: str
    lowest: float
    highest: float
    proposal: float | None = None


Question = Confirm | PointCorners | Jog | Measure
Answer = bool | Corners | JogMove | float
Procedure = Generator[Question, Answer, Found]


class Finding(Protocol):
    """What a procedure found at an easel; implemented by a frozen dataclass of each procedure."""

    @property
    def sentence(self) -> str:
        """What was found and how exactly, in plain words of one or two lines."""

    @property
    def picture(self) -> "Tensor | None":
        """What was found, to look at: sRGB [3, h, w] in [0, 1]; None where there is nothing to see."""

    def enter(self, record: "Calibration") -> "Calibration":
        """The record with this part renewed, by way of `record.with_<procedure>(...)`."""


def lead(procedure: Procedure[Found], answer: Callable[[Question], Answer]) -> Found:
    """Leads a procedure to its end by answering all that it asks, and returns what it found.

    Raises whatever the procedure or the answers raise; the procedure is closed then.
    """
    try:
        question = next(procedure)
        while True:
            question = procedure.send(answer(question))
    except StopIteration as end:
        return end.value
    finally:
        procedure.close()
