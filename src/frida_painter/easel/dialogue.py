"""Dialogues of calibration: a procedure asks questions, a caller answers, and the procedure returns a finding."""

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
    """Yes-or-no question, answered with True or False.

    text: the question in plain words
    picture: [3, h, w] to look at, or None
    proposal: answer that the procedure suggests
    """

    text: str
    picture: "Tensor | None" = None
    proposal: bool = True


@dataclass(frozen=True)
class PointCorners:
    """Question for the four corners of an object in a photograph, answered with (column, row) pixels.

    The corners go clockwise from the top left of the upright object.
    proposal: corners that the procedure found, or None
    """

    text: str
    picture: "Tensor"
    proposal: Corners | None


@dataclass(frozen=True)
class Jog:
    """Question for a height, answered with one `JogMove` after another until the height is right.

    height: current robot z in metres
    lowest, highest: limits of the workspace
    proposal: move that the procedure suggests; None if only a person can tell
    """

    text: str
    height: float
    lowest: float
    highest: float
    picture: "Tensor | None" = None
    proposal: "JogMove | None" = None


@dataclass(frozen=True)
class JogMove:
    """Press of a jog key.

    step: metres, positive is up
    settled: True if the current height is right
    """

    step: float = 0.0
    settled: bool = False


@dataclass(frozen=True)
class Measure:
    """Question for a length, answered with metres from lowest to highest.

    proposal: known value, or None
    """

    text: str
    lowest: float
    highest: float
    proposal: float | None = None


Question = Confirm | PointCorners | Jog | Measure
Answer = bool | Corners | JogMove | float
Procedure = Generator[Question, Answer, Found]


class Finding(Protocol):
    """Result of a procedure; each procedure implements it as a frozen dataclass."""

    @property
    def sentence(self) -> str:
        """Result and its accuracy, in one or two lines of plain words."""

    @property
    def picture(self) -> "Tensor | None":
        """Picture of the result: sRGB [3, h, w] in [0, 1]; None if there is nothing to see."""

    def enter(self, record: "Calibration") -> "Calibration":
        """Returns the calibration with this part replaced, through `record.with_<procedure>(...)`."""


def lead(procedure: Procedure[Found], answer: Callable[[Question], Answer]) -> Found:
    """Runs a procedure to its end with the answers of `answer`, and returns its finding.

    Raises the errors of the procedure and of `answer`; the procedure is closed then.
    """
    try:
        question = next(procedure)
        while True:
            question = procedure.send(answer(question))
    except StopIteration as end:
        return end.value
    finally:
        procedure.close()
