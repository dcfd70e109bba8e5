"""The stroke library that experiments learn from unless they are given another: painted in the virtual studio."""

from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.library import StrokeLibrary
from frida_painter.experiments.outcome import Notify, Progress
from frida_painter.session.opening import open_virtual_easel
from frida_painter.session.procedures.dialogue import lead
from frida_painter.session.procedures.strokes import StrokesProgress, strokes


def virtual_library(brush: str, count: int, seed: int, notify: Notify) -> StrokeLibrary:
    """`count` strokes of a brush that ships with the project. Raises ConfigError where there is no such brush."""

    def hear(progress: StrokesProgress) -> None:
        notify(Progress(progress.done / progress.of, "painting a stroke library"))

    painting = strokes(open_virtual_easel(brush, seed), brush_kind(brush), count=count, seed=seed, notify=hear)
    return lead(painting, lambda question: question.proposal or False).library
