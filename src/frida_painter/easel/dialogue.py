"""Dialogues of calibration: a procedure asks questions, a caller answers, and the procedure returns a finding."""

import re
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from torch import Tensor

    from frida_painter.calibration import Calibration


Found = TypeVar("Found")
Asked = TypeVar("Asked")
Corners = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Confirm:
    """Yes-or-no question, answered with True or False.

    text: the question in plain words
    picture: [3, h, w] to look at, or None
    proposal: answer that the procedure suggests
    moves: True if the machine moves after a yes, which nobody says by Enter alone
    """

    text: str
    picture: "Tensor | None" = None
    proposal: bool = True
    moves: bool = False


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
    remark: the reason why the last move was not made, or ""
    again: True after the first move: the text was shown before
    """

    text: str
    height: float
    lowest: float
    highest: float
    picture: "Tensor | None" = None
    proposal: "JogMove | None" = None
    remark: str = ""
    again: bool = False


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


@dataclass(frozen=True)
class Guide:
    """Question for a place, answered with one `GuideMove` after another until the tip stands there.

    position: of the tip now, robot frame (x, y, z) in metres
    lower, upper: corners of the box in which it may be guided
    proposal: move that the procedure suggests; None if only a person can tell
    remark, again: as in `Jog`
    """

    text: str
    position: tuple[float, float, float]
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    proposal: "GuideMove | None" = None
    remark: str = ""
    again: bool = False


@dataclass(frozen=True)
class GuideMove:
    """Press of a guiding key.

    step: metres along x, y and z
    settled: True if the tip stands at the place
    """

    step: tuple[float, float, float] = (0.0, 0.0, 0.0)
    settled: bool = False


@dataclass(frozen=True)
class Choose:
    """Question for one of several things, answered with its index.

    things: in plain words
    proposal: index that the procedure suggests, or None
    notes: a line about each thing, or empty
    drawings: name of a small drawing of each thing, or empty
    """

    text: str
    things: tuple[str, ...]
    proposal: int | None = None
    notes: tuple[str, ...] = ()
    drawings: tuple[str, ...] = ()


_ADDRESS = re.compile(r"[A-Za-z0-9][A-Za-z0-9._:\[\]-]{0,98}")
_PORT = re.compile(
    r"(?!.*\.\.)/dev/[A-Za-z0-9._:/+-]{1,120}|COM\d{1,3}|(socket|rfc2217)://[A-Za-z0-9._-]{1,90}:\d{1,5}"
)


@dataclass(frozen=True)
class EnterAddress:
    """Question for an address on the network, or for the name of a serial port, answered with a text.

    port: True for a serial port
    """

    text: str
    port: bool = False

    @property
    def example(self) -> str:
        """Answer of the right form."""
        return "/dev/ttyUSB0" if self.port else "192.168.1.10"

    def allows(self, answer: str) -> bool:
        """Returns True if the answer has the form of a host, with or without a port, or of a serial port."""
        return (_PORT if self.port else _ADDRESS).fullmatch(answer) is not None


JOG_STEPS = (0.02, 0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002, 0.0001)
"""Steps of a guided tip in metres; the next smaller one is taken when the direction is reversed."""

Question = Confirm | PointCorners | Jog | Measure
SetupQuestion = Question | Guide | Choose | EnterAddress
Answer = bool | Corners | JogMove | float | GuideMove | str
Procedure = Generator[Question, Answer, Found]
SetupStep = Generator[SetupQuestion, Answer, Found]


@dataclass(frozen=True)
class Finding:
    """Result of a calibration procedure.

    sentence: result and its accuracy, in one or two lines of plain words
    picture: of the result, sRGB [3, h, w] in [0, 1]; None if there is nothing to see
    enter: returns a calibration with this part replaced
    """

    sentence: str
    picture: "Tensor | None"
    enter: "Callable[[Calibration], Calibration]"


def lead(procedure: Generator[Asked, Answer, Found], answer: Callable[[Asked], Answer]) -> Found:
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
