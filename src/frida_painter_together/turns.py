"""Turns of a person in a painting: what they paint in a pause of the robot, and the robot's answer.

On a simulated easel a person paints through this program, stroke by stroke. At a real one they paint on the canvas,
and two photographs of a pause show what was added.
"""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CameraError, ConfigError, PaintingPaused
from frida_painter.hardware.easel import PersonCanvas, PersonStroke
from frida_painter.perception.frame_check import MARK, find_painted
from frida_painter.planning.mixable import make_mixable
from frida_painter.planning.planner import Planner
from frida_painter.session.events import PEN_LIMITS, StrokeOfPerson, TimelapseFrame
from frida_painter.session.executor import Desk
from frida_painter.session.hand import Hand
from frida_painter.session.observer import PHOTOGRAPH_ROWS, TIMELAPSE_ROWS, CanvasObserver
from frida_painter.session.open_loop import OpenLoopMonitor
from frida_painter.session.plan_keeper import ExecutionMonitor, PlanKeeper
from frida_painter.strokes.palette import Palette, from_hex
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import Strokes
from frida_painter_together.policies import take_turn

if TYPE_CHECKING:
    from frida_painter.session.controls import Adapt

_COLORS = ("#26262b", "#b23a2e", "#2f5f96", "#e3ab2f", "#f3efe4", "#3f7d4e", "#8a5636", "#7a4c8f")
_APART = 5.0  # CIEDE2000 between two paints
_YOUR_TURN = "It is your turn: paint what you like, then let the robot answer."
_IDLE_TURNS = 3  # turns without any paint, after which nobody is asked again
_FEWEST = 3  # strokes of an answer in a painting without a goal
_LARGE = 0.03  # share of the canvas; so much paint of a person always matters
_COVERED = 0.15  # share of a person's paint; if planned strokes would cover so much of it, it matters
_MARKED = 0.05  # mean change of a pixel, in sRGB, that a planned stroke makes
_OUTLINE = (230, 60, 20)  # sRGB of the line around found paint


def begin_together(planner: Planner, colors: int, mixed: Palette | None = None) -> Plan:
    """Returns a plan without strokes, to which each answer to a person adds some.

    colors: greatest number of paints: ink, red, blue, yellow, cream, green, brown and violet, in this order.
    mixed: really mixed paints; None for those, as the paints of the planner mix them.
    """
    color = torch.stack([from_hex(each) for each in _COLORS[:colors]])
    if planner.materials.paints is not None:
        color = make_mixable(color, torch.ones(len(color)), planner.materials.paints, _APART).color
    palette = mixed or Palette.sort_light_to_dark(color)
    model, no_paint = planner.models[planner.kinds[0]], torch.zeros(0, dtype=torch.long)
    limits = model.limits.within(planner.size)
    return Plan.of(
        Strokes.empty(), palette, no_paint, brush=model.brush, limits=limits, canvas=planner.size, ground=planner.ground
    )


# A stroke from the points of a pen, and its records. A pen may report 1,000 points a second. A stroke keeps only the
# points that its mark needs: between two kept points, place and press change evenly, to within a tenth of a millimetre
# and a hundredth of the press.

MAX_LENGTH = 3.0
"""Greatest length of one stroke in metres."""
MARGIN = 0.03
"""Distance in metres by which a brush may go over the edge of the canvas. It paints nothing there."""
_EXACT = np.array([1e-4, 1e-4, 0.01, math.radians(2), math.radians(8)])
"""Errors that thinning may make: metres, metres, share of the press, radians of tilt and of its direction."""


@dataclass(frozen=True)
class PenStroke:
    """Stroke as it comes from a pen, a finger or a pointer.

    brush: name of a brush of the easel.
    paint: number of a well, from 0.
    points: (x, y, press, tilt, toward, seconds) of each report of the pen. x and y are shares of the canvas's width
    and height from its top-left corner. Press is in [0, 1]. Tilt is in radians from upright, toward in radians
    clockwise from the right, as pens report them. Seconds count from the first point.
    """

    brush: str
    paint: int
    points: Sequence[Sequence[float]]

    def on_canvas(self, canvas: CanvasSize, number: int) -> PersonStroke:
        """Returns the stroke on a canvas, with as few points as its mark needs.

        Raises ConfigError if a value is not a number or out of range, if the stroke leaves the canvas, or if it is
        too long.
        """
        given = np.array(self.points, np.float64).reshape(-1, len(PEN_LIMITS))
        if not len(given):
            raise ConfigError("The stroke has no points; touch the canvas with the brush.")
        for (name, least, most), values in zip(PEN_LIMITS, given.T, strict=True):
            good = (least <= values) & (values <= most)
            if not good.all():
                first = int(np.argmin(good))
                raise ConfigError(
                    f"Point {first + 1} of the stroke has a {name} of {values[first]}; it is a number from {least:g} "
                    f"to {most:.4g}. Nothing was painted; paint the stroke again."
                )
        page = torch.from_numpy(given[:, :2] * (canvas.width, canvas.height))
        place = canvas.on_page(page).numpy()  # its own inverse
        over = np.maximum(-place, place - (canvas.width, canvas.height)).max(1)
        if not (over <= MARGIN).all():
            raise ConfigError(
                f"The stroke leaves the canvas by {1000 * over.max():.0f} mm at point {int(over.argmax()) + 1}; a "
                f"brush may go {1000 * MARGIN:.0f} mm over the edge. Paint it on the canvas."
            )
        length = float(np.linalg.norm(np.diff(place, axis=0), axis=1).sum())
        if not length <= MAX_LENGTH:
            raise ConfigError(
                f"The stroke is {length:.1f} m long, and one stroke is at most {MAX_LENGTH:g} m; "
                "lift the brush in between."
            )
        way = np.c_[place, given[:, 2:4], -np.unwrap(given[:, 4])]
        kept = way[thin(way / _EXACT)]
        seconds = float(given[-1, 5] - given[0, 5])
        return PersonStroke(number, self.brush, self.paint, kept[:, :2], kept[:, 2], kept[:, 3], kept[:, 4], seconds)


def thin(way: NDArray[np.float64]) -> NDArray[np.intp]:
    """Returns the indices of the points to keep, so that no point lies more than 1 from the line between two of them.

    way [k, d]: points, in units of the error that is allowed (Ramer 1972; Douglas and Peucker 1973).
    """
    keep = np.zeros(len(way), np.bool_)
    keep[[0, -1]] = True
    open_ends = [(0, len(way) - 1)]
    while open_ends:
        first, last = open_ends.pop()
        if last - first < 2:
            continue
        along = way[last] - way[first]
        off = way[first + 1 : last] - way[first]
        share = np.clip(off @ along / max(float(along @ along), 1e-12), 0, 1)
        error = np.linalg.norm(off - share[:, None] * along, axis=1)
        farthest = int(error.argmax())
        if error[farthest] > 1:
            middle = first + 1 + farthest
            keep[middle] = True
            open_ends += [(first, middle), (middle, last)]
    return np.flatnonzero(keep)


# Turns


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
        self._begun: list[StrokeOfPerson] = []  # all strokes of the person
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
        wells = progress.wells
        count = 0 if wells is None else len(wells.color)
        if wells is None or not 0 <= stroke.paint < count:
            raise ConfigError(f"Well {stroke.paint + 1} has no paint; {count} wells are filled. Take one of them.")
        red, green, blue = wells.color[stroke.paint].tolist()
        begun = StrokeOfPerson(stroke.number, stroke.record(), (red, green, blue))
        if not progress.person_unseen:
            self._monitor.observe()
            self._plans.keep()
        self._journal.tell(begun)
        self._lay(begun)
        self._begun.append(begun)
        seen = self._observer.film(self._observer.photograph(self._hand.last_motion).image, TIMELAPSE_ROWS)
        self._tell(TimelapseFrame(progress.painted, max(1, progress.strokes), begun.color, photograph=seen))

    def remember(self, strokes: Sequence[StrokeOfPerson], answered: int, released: int = 0) -> None:
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
        rows, columns = mask.shape
        for stroke in (PersonStroke.of(each.stroke) for each in self._begun[self._released :]):
            brush = brushes[stroke.brush]
            pixels = stroke.place / (size.width, size.height) * (columns, -rows) + (0, rows)
            points = pixels.round().astype(int).tolist()
            width = (brush.light + (brush.hard - brush.light) * stroke.press) / size.height * rows
            for start, end, wide in zip(points, [*points[1:], points[-1]], width, strict=True):
                cv2.line(mask, start, end, 1, max(1, round(float(wide))))
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

    def answer(self, adapt: "Adapt") -> None:
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
            colors, seen = tuple(each.color for each in self._begun), progress.canvas.last_seen
            rest = adapt(take_turn(before, seen, strokes, colors, progress.rest, progress.painted, count, room))
        finally:
            self._answered = progress.person
            if rest is not None:
                self._plans.replace(rest, answers=True)
            elif len(progress.rest):
                self._plans.replan()
            else:
                self._plans.keep()

    def answer_if_possible(self, adapt: "Adapt") -> None:
        """Answers a person; an answer that is not possible changes nothing."""
        with suppress(ConfigError):
            self.answer(adapt)

    def alternate(
        self, most: int, equip: Callable[[], None], paint_until: Callable[[int], None], adapt: "Adapt"
    ) -> None:
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

    def finish(self, begun: StrokeOfPerson) -> None:
        """Paints the person's last stroke of a painting that broke off before its end was noted.

        A simulated easel knows the strokes on its canvas by their numbers, so no stroke is painted twice.
        """
        self._progress.person = begun.number - 1
        self._lay(begun)

    def _lay(self, begun: StrokeOfPerson) -> None:
        operator = self._hand.easel.operator
        assert isinstance(operator, PersonCanvas)
        operator.paint_stroke(PersonStroke.of(begun.stroke))
        self._progress.person, self._progress.person_unseen = begun.number, True
        self._interruptions.touched = True
        painted = replace(begun, painted=True)
        self._journal.tell(painted)
        self._tell(painted)


def _outline(canvas: Tensor, painted: NDArray[np.bool_]) -> Tensor:
    """Returns the canvas [3, H, W] with a line around what was painted [H, W]."""
    picture = np.ascontiguousarray((canvas.permute(1, 2, 0).numpy() * 255).round().astype(np.uint8))
    around = cv2.dilate(painted.astype(np.uint8), np.ones((9, 9), np.uint8))
    contours, _ = cv2.findContours(around, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    cv2.drawContours(picture, contours, -1, _OUTLINE, max(1, painted.shape[0] // 270), cv2.LINE_AA)
    return torch.from_numpy(picture).permute(2, 0, 1).float() / 255
