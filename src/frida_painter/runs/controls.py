"""What a run asks of whoever leads it: whether to stop or pause, and the questions that only a person can answer."""

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor

from frida_painter.palette import Palette
from frida_painter.session.events import Paused
from frida_painter.session.procedures.dialogue import Answer, Question


def _never() -> bool:
    return False


@dataclass(frozen=True)
class Controls:
    """How a painting is led; by default nobody is there: it is neither stopped nor paused, and every doubt is a no.

    stop_asked, pause_asked: looked at after every stroke and planning iteration;
    go_on: waits in a pause for a person, and says whether the painting goes on;
    mixed: waits until the wells are filled, and answers with what was really mixed, None for just what was wanted
    (by default: what the description says);
    answer: leads a dialogue with a person at a real easel, None where nobody is asked;
    paint_on: whether a canvas that is not as it was left (a sentence, a photograph [3, H, W]) is painted on;
    repaint: whether the stroke in doubt (its number, a picture of it) is painted again.
    """

    stop_asked: Callable[[], bool] = _never
    pause_asked: Callable[[], bool] = _never
    go_on: Callable[[Paused], bool] = lambda paused: False
    mixed: Callable[[Palette], Palette | None] | None = None
    answer: Callable[[Question], Answer] | None = None
    paint_on: Callable[[str, Tensor], bool] = lambda difference, photograph: False
    repaint: Callable[[int, Tensor], bool] = lambda number, picture: False
