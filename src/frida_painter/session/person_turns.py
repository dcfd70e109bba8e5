"""Turns of a person in a painting: what they paint in a pause of the robot, and the robot's answer.

On a simulated easel a person paints through this program, stroke by stroke. At a real one they paint on the canvas,
and two photographs of a pause show what was added.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.errors import CameraError, ConfigError, PaintingPaused
from frida_painter.hardware.easel import PersonCanvas, PersonStroke
from frida_painter.palette import Palette
from frida_painter.perception.frame_check import MARK, find_painted
from frida_painter.plan import Plan
from frida_painter.session.events import TimelapseFrame
from frida_painter.session.executor import Desk
from frida_painter.session.hand import Hand
from frida_painter.session.observer import PHOTOGRAPH_ROWS, TIMELAPSE_ROWS, CanvasObserver
from frida_painter.session.open_loop import OpenLoopMonitor
from frida_painter.session.person_events import PersonStrokeBegan, PersonStrokePainted
from frida_painter.session.person_strokes import PenStroke, begin_stroke, draw_stroke
from frida_painter.session.plan_keeper import ExecutionMonitor, PlanKeeper
from frida_painter.session.turn_policy import TurnTaken, take_turn

Adapt = Callable[[TurnTaken], Plan | None]
"""Answer to a turn: the strokes to paint instead of the rest, or None to replan the rest for the goal."""
_YOUR_TURN = "It is your turn: paint what you like, then let the robot answer."
_IDLE_TURNS = 3  # turns without any paint, after which nobody is asked again
_FEWEST = 3  # strokes of an answer in a painting without a goal
_LARGE = 0.03  # share of the canvas; so much paint of a person always matters
_COVERED = 0.15  # share of a person's paint; if planned strokes would cover so much of it, it matters
_MARKED = 0.05  # mean change of a pixel, in sRGB, that a planned stroke makes
_OUTLINE = (230, 60, 20)  # sRGB of the line around found paint


@dataclass(frozen=True)
class FoundPaint:
    """Paint that a person added to the canvas in a pause, as two photographs show.

    painted [H, W]: True where it is.
    outlined [3, H, W]: the canvas, with a line around it.
    share: of the canvas. covered: share of the paint that planned strokes would cover.
    """

    painted: NDArray[np.bool_]
    outlined: Tensor
    share: float
    covered: float

    @property
    def matters(self) -> bool:
        """True if it must be known what becomes of it: it is large, or planned strokes would cover it."""
        return self.share >= _LARGE or self.covered >= _COVERED


class PersonTurns:
    """Turns of a person: what they paint in a pause, and the answer of the robot at its end."""

    def __init__(
        self,
        hand: Hand,
        observer: CanvasObserver,
        monitor: ExecutionMonitor | OpenLoopMonitor,
        plans: PlanKeeper,
        desk: Desk,
    ) -> None:
        self._hand, self._observer, self._monitor, self._plans = hand, observer, monitor, plans
        self._journal, self._interruptions, self._progress, self._tell = desk
        self._begun: list[PersonStrokeBegan] = []  # all strokes of the person
        self._answered = 0  # number of the last stroke that the robot has answered
        self._released = 0  # number of the last stroke that the robot may paint over
        self._before: Tensor | None = None  # canvas at the beginning of a pause, if only photographs tell of the person

    @property
    def may_paint(self) -> bool:
        """True if a person can paint on the canvas through this program, in a pause."""
        easel = self._hand.easel
        return bool(easel.person_brushes) and easel.has_camera and self._progress.wells is not None

    @property
    def wells(self) -> Palette | None:
        """Paints in the wells; None if they are unknown."""
        return self._progress.wells

    @property
    def touched(self) -> bool:
        """True if a person painted through this program since the last look."""
        return self._progress.person_unseen

    def paint(self, pen: PenStroke) -> None:
        """Paints a person's stroke on the canvas of a simulated easel, in a pause, and shows the canvas.

        The canvas is looked at before the first stroke, so that the next look tells what the person painted. The
        stroke is noted in the journal before it is painted and again after it.
        Raises ConfigError if the stroke cannot be painted as asked; then nothing is painted. Raises StorageError.
        """
        progress, easel = self._progress, self._hand.easel
        if not self.may_paint:
            raise ConfigError(
                "Nobody can paint through the page on this easel; paint with a real brush, then let it look."
            )
        stroke = pen.on_canvas(easel.canvas, progress.person + 1)
        if stroke.brush not in {each.name for each in easel.person_brushes}:
            names = ", ".join(each.name for each in easel.person_brushes)
            raise ConfigError(f"There is no brush {stroke.brush[:40]!r} here; take {names}.")
        begun = begin_stroke(stroke, progress.wells, progress.painted)
        if not progress.person_unseen:
            self._monitor.observe()
            self._plans.keep()
        self._journal.tell(begun)
        self._lay(stroke)
        self._begun.append(begun)
        self._tell_canvas(begun.color)

    def remember(self, strokes: Sequence[PersonStrokeBegan], answered: int, released: int = 0) -> None:
        """Takes over the person's strokes of earlier runs.

        answered, released: numbers of the last one that the robot has answered, and that it may paint over.
        """
        self._begun, self._answered, self._released = list(strokes), answered, released

    def release(self) -> None:
        """Lets the robot paint over all that the person has painted so far."""
        self._released = self._progress.person

    def photograph(self) -> Tensor:
        """Returns the canvas as it is now, [3, H, W], without the arm; that is no look, and nothing is noted.

        Without a camera, it is the canvas as it should be. Raises CameraError.
        """
        if not self._hand.easel.has_camera:
            return self._monitor.look()
        frame = self._observer.photograph(self._hand.last_motion)
        return self._observer.see(frame.image, PHOTOGRAPH_ROWS)

    def find_own_paint(self) -> NDArray[np.bool_] | None:
        """Returns a mask [H, W] of the person's paint, for a goal that may change all of the canvas.

        That is all that they painted through this program and have not released, and what they added since
        `await_paint` with a brush of their own, which is not found a second time. None if there is nothing.
        """
        if (found := self.find_paint()) is not None:
            self.await_paint()
            return found.painted
        brushes = {brush.name: brush for brush in self._hand.easel.person_brushes}
        size = self._hand.easel.canvas
        mask = np.zeros((PHOTOGRAPH_ROWS, round(PHOTOGRAPH_ROWS * size.width / size.height)), np.uint8)
        for stroke in (PersonStroke.of(each.stroke) for each in self._begun[self._released :]):
            draw_stroke(stroke, brushes[stroke.brush], size, mask)
        return mask > 0 if mask.any() else None

    def await_paint(self) -> None:
        """Photographs the canvas at the beginning of a pause, so that its end shows what a person painted.

        It does nothing if this program knows the person's strokes, or has no camera; a camera that fails now is no
        reason to keep a person waiting.
        """
        self._before = None
        if self._hand.easel.has_camera and not self.may_paint and self._progress.plan is not None:
            with suppress(CameraError):
                self._before = self.photograph()

    def find_paint(self) -> FoundPaint | None:
        """Returns what a person painted since `await_paint`; None if nothing is found, or it cannot be known."""
        if self._before is None:
            return None
        try:
            after = self.photograph()
        except CameraError:
            return None
        painted = find_painted(self._before, after, MARK)
        if not painted.any():
            return None
        rest, planned = self._progress.rest, np.zeros_like(painted)
        if len(rest):
            planner = self._plans.planner
            expected, now = planner.expected(rest, after), planner.expected(rest.part(slice(0)), after)
            marked = ((expected - now).abs().mean(0) > _MARKED).numpy().astype(np.uint8)
            planned = cv2.resize(marked, painted.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
        return FoundPaint(
            painted, _outline(after, painted), float(painted.mean()), float((planned & painted).sum() / painted.sum())
        )

    def answer(self, adapt: Adapt) -> None:
        """Looks at the canvas and answers a person who painted, at the end of a pause.

        adapt: may set another `planner`. Its errors pass through; the rest is then replanned.
        """
        progress = self._progress
        before = progress.canvas.last_seen if self._before is None else self._before
        self._interruptions.touched = True  # also in a painting that broke off: the canvas is not as it was left
        self._monitor.observe()
        rest, self._before = None, None
        turn = sum(each.number > self._answered for each in self._begun)
        room = 0 if progress.most is None else progress.most - progress.painted
        count = min(room, max(_FEWEST, turn))
        try:
            strokes = tuple(PersonStroke.of(each.stroke) for each in self._begun)
            colors = tuple(each.color for each in self._begun)
            seen = progress.canvas.last_seen
            answered = strokes, colors, progress.rest, progress.painted
            rest = adapt(take_turn(before, seen, *answered, count, room))
        finally:
            self._answered = progress.person
            if rest is not None:
                self._plans.replace(rest, answers=True)
            elif len(progress.rest):
                self._plans.replan()
            else:
                self._plans.keep()

    def answer_if_possible(self, adapt: Adapt) -> None:
        """Answers a person; an answer that is not possible changes nothing."""
        with suppress(ConfigError):
            self.answer(adapt)

    def alternate(self, most: int, equip: Callable[[], None], paint_until: Callable[[int], None], adapt: Adapt) -> None:
        """Paints without a goal: a person paints, the robot answers, until `most` strokes are done or a person ends it.

        equip: gets brush and paints. paint_until: paints until that number of strokes is done.
        Raises PaintingPaused if nobody goes on, or if nobody paints anything.
        """
        progress, idle = self._progress, 0
        while not progress.ended and progress.painted < most:
            equip()
            if progress.painted < progress.strokes:
                paint_until(progress.strokes)
                if progress.painted == progress.strokes:
                    self._monitor.observe()
                    self._plans.keep()
                idle = 0
                continue
            if idle == _IDLE_TURNS:
                raise PaintingPaused(
                    "Nobody painted anything, and the robot has nothing to continue; paint on the canvas, then resume."
                )
            idle += 1
            self._interruptions.pause(_YOUR_TURN, "turn")
            if not progress.ended and progress.painted == progress.strokes:
                self.answer_if_possible(adapt)  # else nothing is painted yet, and it is asked again

    def end_here(self) -> None:
        """Ends a painting without a goal, in a pause: what is planned is left out."""
        self._progress.ended = True
        self._plans.replace(self._progress.rest.part(slice(0)))

    def finish(self, stroke: PersonStroke) -> None:
        """Paints the person's last stroke of a painting that broke off before its end was noted.

        A simulated easel knows the strokes on its canvas by their numbers, so no stroke is painted twice.
        """
        self._progress.person = stroke.number - 1
        self._lay(stroke)

    def _lay(self, stroke: PersonStroke) -> None:
        operator = self._hand.easel.operator
        assert isinstance(operator, PersonCanvas)
        operator.paint_stroke(stroke)
        self._progress.person, self._progress.person_unseen = stroke.number, True
        self._interruptions.touched = True
        painted = PersonStrokePainted(stroke.number, self._progress.painted)
        self._journal.tell(painted)
        self._tell(painted)

    def _tell_canvas(self, color: tuple[float, float, float]) -> None:
        """Reports a picture of the canvas for people and for the film."""
        frame = self._observer.photograph(self._hand.last_motion)
        seen = self._observer.film(frame.image, TIMELAPSE_ROWS)
        self._tell(TimelapseFrame(seen, self._progress.painted, max(1, self._progress.strokes), color))


def _outline(canvas: Tensor, painted: NDArray[np.bool_]) -> Tensor:
    """Returns the canvas [3, H, W] with a line around what was painted [H, W]."""
    picture = np.ascontiguousarray((canvas.permute(1, 2, 0).numpy() * 255).round().astype(np.uint8))
    around = cv2.dilate(painted.astype(np.uint8), np.ones((9, 9), np.uint8))
    contours, _ = cv2.findContours(around, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    cv2.drawContours(picture, contours, -1, _OUTLINE, max(1, painted.shape[0] // 270), cv2.LINE_AA)
    return torch.from_numpy(picture).permute(2, 0, 1).float() / 255
