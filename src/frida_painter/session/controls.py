"""Controls of a painting: what a person who leads it answers and asks for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from frida_painter.registry import Later

if TYPE_CHECKING:
    from torch import Tensor

    from frida_painter.easel.dialogue import Answer, Question
    from frida_painter.session.events import PauseCause, Paused
    from frida_painter.strokes.palette import Palette
    from frida_painter.strokes.plan import Plan

    Adapt = Callable[[Any], Plan | None]
    """Answer to a turn of a person (together.policies.TurnTaken): the strokes to paint instead of the rest, or None to
    replan the rest for the goal."""

answer_usually: Adapt = Later("frida_painter_together.policies:answer_usually")


@dataclass(frozen=True)
class Controls:
    """Callbacks of a person who leads a painting; by default nobody is there, and every answer is no.

    stop_asked, pause_cause: checked after every stroke and planning iteration.
    go_on: waits in a pause (on request, or after a fault of disk or camera) for a person; returns True to go on. Before
    it returns, it may call the session's `look_again` or `paint_instead`, or set another `planner`.
    mixed: waits until the wells are filled; returns the really mixed paints, None for the wanted ones. Default: the
    paints of the description.
    answer: answers a question at a real easel. None: nobody is asked.

    paint_on: called with a sentence and a photograph [3, H, W] of a canvas that is not bare, or has changed;
    returns True to paint on.
    repaint: called with the number and a picture of the stroke in doubt; returns True to paint it again.
    adapt: answers a turn of a person who is not answered in a pause; see together/.
    """

    stop_asked: Callable[[], bool] = lambda: False
    pause_cause: Callable[[], PauseCause | None] = lambda: None
    go_on: Callable[[Paused], bool] = lambda paused: False
    mixed: Callable[[Palette], Palette | None] | None = None
    answer: Callable[[Question], Answer] | None = None
    paint_on: Callable[[str, Tensor], bool] = lambda difference, photograph: False
    repaint: Callable[[int, Tensor], bool] = lambda number, picture: False
    adapt: Adapt = answer_usually
