"""Plan keeper: makes the plan of a painting, replans the rest, and adopts each new plan.

A plan is adopted in this order: it is saved to the disk, painting follows it, and listeners hear of it with its
timetable.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.calibration import WetPaint
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CameraError, ConfigError, FrameDoubtful, PaintingPaused
from frida_painter.perception.flatfield import is_evenly
from frida_painter.planning.optimize import Step
from frida_painter.planning.placement import Placement
from frida_painter.planning.planner import Planner
from frida_painter.planning.wet_paint import ENOUGH, PaintedPart, Wetness, learn_wet_paint
from frida_painter.session.choreography import BrushLoad, Looks, Timetable, no_looks
from frida_painter.session.events import Looked, Planned, PlanningStep, Remark, Scheduled
from frida_painter.session.executor import BatchExecutor, Desk
from frida_painter.session.hand import Hand
from frida_painter.session.observer import PHOTOGRAPH_ROWS, TOLERANCE, CanvasObserver, Timelapse
from frida_painter.session.progress import difference
from frida_painter.session.replan_policy import CanvasSeen, ReplanPolicy, looks_on_the_way
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import Strokes

_CLEAR = 0.004  # metres that the middle of a stroke keeps from a protected part
_SAMPLES = 9  # points of a stroke that are tested


class PlanKeeper:
    """Makes plans with `planner`, which may be replaced in a pause, and keeps the plan in `progress`.

    budget: seconds of the robot's clock for the whole painting. None: no limit.
    A person may stop or pause at every planning step. If another plan is adopted in such a pause, the running
    planning is discarded.
    """

    def __init__(
        self,
        planner: Planner,
        hand: Hand,
        policy: ReplanPolicy,
        timelapse: Timelapse,
        desk: Desk,
        budget: float | None = None,
    ) -> None:
        self.planner, self._budget = planner, budget
        self._hand, self._policy, self._timelapse = hand, policy, timelapse
        self._journal, self._interruptions, self._progress, self._tell = desk

    def begin(self, strokes: int, colors: int, made: Plan | None = None) -> None:
        """Adopts a plan with this number of strokes: `made` if the canvas shows only its ground, else a new one.

        Raises ConfigError if no painting fits the budget.
        """
        canvas = self._progress.canvas.last_seen
        if self._progress.most is not None:
            assert made is not None, "a painting without a goal begins with a plan without strokes"
            self._adopt(made, 0.0)
            return
        made = made if made is not None and is_evenly(canvas, made.ground, TOLERANCE) else None
        hear = self._checking_interrupts("plan")
        plan = made
        if plan is None:
            plan = self._arrange(self.planner.plan(canvas, strokes, colors, hear))
            plan = self._settle_wet(plan, hear, mixed=False)
        self._adopt(self._within_budget(plan), self.planner.validation_loss(canvas))

    def bind_to_palette(self, mixed: Palette) -> None:
        """Adopts the rest in the really mixed paints."""
        if self._progress.most is not None:  # the strokes stay, in the paints of the same wells
            rest = self._progress.rest
            strokes = rest.strokes.with_groups(color=mixed.color[rest.paint])
            self._adopt(replace(rest, palette=mixed, strokes=strokes), 0.0, answers=self._progress.answers)
            return
        bound = None
        while bound is None:  # if another plan was adopted in a pause, that one gets these paints
            rest, canvas = self._progress.rest, self._progress.canvas.last_seen
            before = self._loss()
            with suppress(_Overtaken):
                hear = self._checking_interrupts("plan")
                again = self._arrange(self.planner.bind_to_palette(rest, canvas, mixed, hear))
                bound = self._within_budget(self._settle_wet(again, hear))
        self._adopt(bound, before)

    def replan(self, rounds: int = 1) -> None:
        """Replans the rest for the last seen canvas, in this number of rounds, and adopts the result.

        Without a goal, the rest stays, without the strokes that touch the protected part.
        """
        if self._progress.most is not None:
            self._keep_clear()
            return
        rest, canvas, before = self._progress.rest, self._progress.canvas.last_seen, self._loss()
        with suppress(_Overtaken):
            hear = self._checking_interrupts("replan")
            fresh, wetness = self._progress.begins_layer, self._wetness(rest)
            again = self.planner.replan(rest, canvas, hear, rounds, fresh=fresh, wetness=wetness)
            mixed = not (self._progress.begins_layer and self._progress.painted)
            again = self._settle_wet(self._arrange(again), hear, mixed=mixed)
            after = self._adopt(self._within_budget(again), before)
            self._progress.gain = 10 * math.log10(before / after) if min(before, after) > 0 else 0.0

    def _keep_clear(self) -> None:
        """Leaves out the strokes of the rest that touch the protected part."""
        rest, region = self._progress.rest, self.planner.region
        touching = None if region is None else touches(rest.strokes, region.forbidden.numpy(), rest.canvas)
        if touching is None or not touching.any():
            self.keep()
        else:
            self._adopt(rest.part(np.flatnonzero(~touching).tolist()), 0.0, answers=self._progress.answers)

    def replace(self, rest: Plan, *, answers: bool = False) -> None:
        """Adopts another rest in the same paints.

        answers: True if it answers a person, and is not on the way to the goal.
        """
        self._adopt(rest, self._loss(), answers=answers)

    def keep(self) -> None:
        """Keeps the rest after a look, and notes the newer placement."""
        progress = self._progress

        def note() -> None:  # another plan may be adopted in a pause for a full disk
            if progress.plan is not None and (progress.painted < progress.strokes or progress.most is not None):
                known = progress.plan, progress.painted, self._hand.placement
                self._journal.record_plan(*known, answers=progress.answers, kept=True)

        self._interruptions.retry(note)
        progress.planned_at = progress.painted

    def schedule(self) -> Timetable:
        """Reports the work that is left, and returns the time that the robot takes for it, with all looks."""
        done, of, rest = self._progress.painted, self._progress.strokes, self._progress.rest
        table = self._table(rest, self._looks(done, of))
        work = self._count_work(0 if self._progress.most is not None else of, done)
        pace = self._hand.easel.drying_pace
        self._tell(replace(work, seconds=table.total, drying=table.drying, after=table.milestones, pace=pace))
        return table

    def expect(self, strokes: int) -> None:
        """Reports the work of a painting of that many strokes, 0 if nobody knows how many, before it is planned."""
        work = self._count_work(strokes, self._journal.state.progress.painted)
        self._tell(replace(work, planning=self.planner.iterations(strokes) if strokes else 0))

    def _count_work(self, strokes: int, done: int) -> Scheduled:
        """Returns the work of the looks that are left on the way of a painting."""
        looks = tuple(look for look in looks_on_the_way(self._policy, strokes) if look > done)
        return Scheduled(done, strokes, looks, self.planner.effort.settling + self.planner.effort.replanning)

    def _table(self, rest: Plan, looks: Looks) -> Timetable:
        """Returns the timetable of the rest, after the paint on the canvas has dried if it must."""
        table = self._hand.timetable(rest, looks)
        return table.after_drying(self._progress.wet_for(self._hand.drying)) if self._progress.must_dry else table

    def _looks(self, done: int, of: int) -> Looks:
        """Returns the function that counts trips to the home position after each stroke that follows stroke `done`."""
        if not self._hand.easel.has_camera:
            return lambda painted, leaves: int(done + painted == of)  # at the end, to leave the canvas free
        whole = self._progress.most or of
        taken = self._timelapse.due(done, whole)

        def after(painted: int, leaves: bool) -> int:
            nonlocal taken
            number = done + painted
            looks = self._policy.next_look(number - 1, of) == number
            films = self._timelapse.wants_frame(number, whole, taken, leaves=leaves or looks)
            if films:
                taken = self._timelapse.due(number, whole)
            return int(films) + int(looks)

        return after

    def _within_budget(self, rest: Plan) -> Plan:
        """Returns the arranged rest, with strokes left out until the painting fits the budget.

        The remaining strokes are then settled again. Raises ConfigError if no stroke is painted yet and not even
        one fits.
        """
        fitting = self._fitting(rest)
        if len(fitting) == len(rest):
            return rest
        canvas, hear = self._progress.canvas.last_seen, self._checking_interrupts("plan")
        settled = self.planner.replan(fitting, canvas, hear, wetness=self._wetness(fitting))
        return self._fitting(self._arrange(settled))

    def _fitting(self, rest: Plan) -> Plan:
        """Returns the arranged rest without the strokes that matter least, until it fits the budget."""
        canvas = self._progress.canvas.last_seen
        while self._budget is not None and len(rest) and (seconds := self._seconds(rest)) > self._budget:
            if len(rest) == 1 and self._progress.painted:
                break
            if len(rest) == 1:
                raise ConfigError(
                    f"--minutes was given {self._budget / 60:g}, and with all looks and layers a painting of a single "
                    f"stroke takes {math.ceil(seconds / 6) / 10:g} minutes; give more minutes."
                )
            share = min(0.5, 1 - self._budget / seconds)
            count = min(max(1, math.floor(share * len(rest))), len(rest) - 1)
            rest = self._arrange(self.planner.without_weakest(rest, canvas, count))
        return rest

    def _seconds(self, rest: Plan) -> float:
        """Returns the time that the robot takes for the painted strokes and this rest."""
        plan = self._progress.followed_by(rest)
        return self._hand.timetable(plan, self._looks(0, len(plan)), BrushLoad()).total

    def _adopt(self, rest: Plan, before: float, *, answers: bool = False) -> float:
        """Adopts this rest, made for the current canvas, and reports it.

        before: validation loss of the old plan.
        answers: True if the rest answers a person.
        Returns the validation loss of the new plan.
        """
        progress = self._progress
        plan, placement = progress.followed_by(rest), self._hand.placement
        note = partial(self._journal.record_plan, plan, progress.painted, placement, answers=answers)
        self._interruptions.retry(note)
        progress.plan, progress.planned_at, progress.answers = plan, progress.painted, answers
        wetness = self._wetness(rest, self.schedule())
        planner, canvas, unseen = self.planner, progress.canvas.last_seen, 0
        if len(rest):
            unseen = self._policy.next_look(progress.painted, progress.strokes) - progress.painted
        expected, after = planner.expected(rest, canvas, wetness), planner.expected_loss(rest, canvas, wetness)
        forecast = planner.forecast(rest, canvas, placement, unseen, wetness, progress.painted)
        similarity = None if forecast is None else (forecast.expected, forecast.least, forecast.most)
        self._tell(Planned(progress.painted, len(rest), before, after, similarity, plan=rest, expected=expected))
        return after

    def _loss(self) -> float:
        """Returns the validation loss of the expected canvas after the rest."""
        rest, canvas = self._progress.rest, self._progress.canvas.last_seen
        return self.planner.expected_loss(rest, canvas, self._wetness(rest))

    def _arrange(self, rest: Plan) -> Plan:
        """Returns the rest, with the strokes of the next batch in a good order for painting."""
        if len(rest) == 0:  # all remaining strokes would have touched the region
            return rest
        painted = self._progress.painted
        batch = self._policy.next_look(painted, painted + len(rest)) - painted
        fading = self.planner.fading(rest, self._progress.canvas.last_seen)
        return self._hand.arrange(rest, min(batch, rest.layer_end(0)), fading)

    def _settle_wet(self, rest: Plan, hear: Callable[[Step], None], *, mixed: bool = True) -> Plan:
        """Returns the arranged rest, settled for wet paint if a painting has shown how it mixes.

        mixed: False if the paints of the next stroke's layer may still change.
        """
        wetness = self._wetness(rest)
        if wetness is None or len(rest) == 0:
            return rest
        return self.planner.settle_wet(rest, self._progress.canvas.last_seen, wetness, hear, mixed=mixed)

    def _wetness(self, rest: Plan, table: Timetable | None = None) -> Wetness | None:
        """Returns the wetness of a rest with this timetable; None if nothing is known of wet paint.

        table: None for that of the rest without looks
        """
        wet, progress = self._hand.easel.calibration.wet, self._progress
        if wet is None:
            return None
        table = self._table(rest, no_looks) if table is None else table
        if progress.plan is None:
            return Wetness(wet, table.after)
        below = progress.plan.part(slice(progress.resumed_at, progress.painted))
        after = self._hand.timetable(below, no_looks, BrushLoad()).after
        ago = [at - after[-1] for at in after if after[-1] - at < wet.drying]
        return Wetness(wet, table.after, below.part(slice(len(below) - len(ago), None)), ago)

    def _checking_interrupts(self, phase: str) -> Callable[[Step], None]:
        """Returns a callback that reports planning steps and stops the planner if a person wants that."""

        def tell(step: Step) -> None:
            self._tell(PlanningStep(phase, step.iteration, step.of, step.loss, parts=step.parts))
            plan = self._progress.plan
            self._interruptions.check()
            if self._progress.plan is not plan:
                raise _Overtaken

        return tell


class _Overtaken(Exception):
    """Signal that a person adopted another plan in a pause; it never leaves this file."""


# Execution monitor: looks at the canvas and compares it with the expected one.

_TOLD = 0.0004  # metres; a smaller change is hidden by the differences between marks of one stroke


class ExecutionMonitor:
    """Looks at the canvas of `progress` through `observer`, with the arm at home.

    plans: keeper of the planner that computes the expected canvas.
    executor: moves the arm to its home position.

    If the camera or the disk fails, the painting pauses and then looks again. If all strokes are painted, a look
    decides nothing any more. Then any visible canvas is accepted, with a remark.
    """

    def __init__(
        self, plans: PlanKeeper, executor: BatchExecutor, hand: Hand, observer: CanvasObserver, desk: Desk
    ) -> None:
        self._plans, self._executor, self._hand, self._observer = plans, executor, hand, observer
        self._journal, self._interruptions, self._progress, self._tell = desk
        self._painted: list[tuple[Plan, Tensor, Tensor]] = []  # last batches of ours alone, as seen and as expected
        self._looked_after: int | None = None  # strokes at a look that could not tell whether the canvas was moved
        self._moved: tuple[str, ...] = ()  # what was told of camera and canvas

    def look(self) -> Tensor:
        """Returns the current canvas [3, H, W] from a photograph newer than the last motion, which is journalled.

        Only a complete painting may get a doubtful photograph, or the last seen canvas.
        """
        if self._progress.remark:
            return self._interruptions.retry(self._glance)
        is_last = self._progress.is_complete and self._hand.easel.simulated
        try:
            return self._interruptions.retry(self._last_look if is_last else self._look)
        except PaintingPaused as nobody:
            if not (self._progress.is_complete and isinstance(nobody.__cause__, CameraError)):
                raise
            self._doubt(nobody.__cause__)
            return self._interruptions.retry(self._glance)

    def observe(self) -> CanvasSeen:
        """Looks, reports the seen and the expected canvas, and learns the placement."""
        alone = not (self._interruptions.touched or self._progress.person_unseen)
        canvas, progress, planner = self.look(), self._progress, self._plans.planner
        batch, last = progress.batch, progress.canvas.last_seen
        expected = planner.expected(batch, last)
        self._tell(Looked(progress.painted, photograph=canvas, expected=expected))
        if len(batch) and not progress.remark:  # the landed strokes show how to correct the robot
            self._learn(planner.locate(batch, self._hand.placement, last, canvas))
            if alone:
                self._keep(batch, canvas, expected)
        progress.canvas.saw(canvas, progress.painted)
        return CanvasSeen(progress.painted, len(progress.rest), difference(canvas, expected), progress.gain)

    def _keep(self, batch: Plan, seen: Tensor, expected: Tensor) -> None:
        """Keeps a batch to learn wet paint from, and forgets those that are not needed for it any more."""
        self._painted.append((batch, seen, expected))
        while sum(len(one) for one, _, _ in self._painted[1:]) >= ENOUGH:
            del self._painted[0]

    def learn_wet_paint(self) -> WetPaint | None:
        """Returns how wet paint mixed in the batches of this painting; None if it hardly shows."""
        parts, planner = [], self._plans.planner
        for batch, seen, expected in self._painted:
            painted_at = self._hand.timetable(batch, no_looks, BrushLoad()).after
            stacked = planner.problems.stack(batch, expected, planner.fine)
            parts.append(PaintedPart(*stacked, painted_at, seen, expected))
        return learn_wet_paint(parts)

    def _learn(self, placement: Placement) -> None:
        """Corrects later motions by this placement; reports each brush whose height changes."""
        before = self._hand.placement.touch
        self._hand.learn(placement)
        now = self._hand.placement.touch
        for brush in now.depths:
            lower = now.correction(brush)
            if abs(lower - before.correction(brush)) >= _TOLD:
                self._tell(Remark(_tell_touch(brush, lower), "touch", brush))

    def _look(self) -> Tensor:
        self._executor.step_aside()
        expected, progress = None, self._progress
        if not self._interruptions.touched:  # else a person may have touched the canvas
            expected = progress.expectation(self._plans.planner)
        try:
            frame, canvas = self._observer.examine(
                self._hand.last_motion, PHOTOGRAPH_ROWS, expected, doubtful=self._looked_after == progress.painted
            )
        except FrameDoubtful:
            self._looked_after = progress.painted  # accepted by a person who goes on now
            raise
        before, self._moved = self._moved, self._observer.moved
        for sentence in self._moved:
            if sentence not in before:
                self._tell(Remark(sentence))
        self._journal.record_look(frame, self._observer.light)
        self._interruptions.touched = progress.person_unseen = False
        return canvas

    def _last_look(self) -> Tensor:
        """Looks after the last stroke on a simulated easel, which has nobody to ask."""
        try:
            return self._look()
        except CameraError as trouble:
            self._doubt(trouble)
            return self._glance()

    def _doubt(self, trouble: CameraError) -> None:
        painted = f"All {self._progress.painted} strokes are painted"
        self._progress.remark = f"{painted}, and the last photograph may not show them well: {trouble}"
        self._tell(Remark(self._progress.remark, "last look"))

    def _glance(self) -> Tensor:
        """Returns the canvas [3, H, W] as visible now, or as last seen; it decides nothing."""
        self._executor.step_aside()
        try:
            frame = self._observer.photograph(self._hand.last_motion)
            canvas = self._observer.see(frame.image, PHOTOGRAPH_ROWS)
        except CameraError:
            return self._progress.canvas.last_seen
        self._journal.record_look(frame, self._observer.light)
        return canvas


def _tell_touch(brush: str, lower: float) -> str:
    """Returns a sentence about a brush that is sent `lower` metres lower than its record; below 0: higher."""
    if abs(lower) < 0.00005:
        return f"Marks of the {brush} brush are as they were sent, so it is sent as it was calibrated again."
    way, marks = ("higher", "thicker") if lower < 0 else ("lower", "thinner")
    return (
        f"Marks of the {brush} brush are {marks} than they were sent, so it is sent {1000 * abs(lower):.1f} mm {way} "
        "than it was calibrated."
    )


def touches(strokes: Strokes, forbidden: NDArray[np.bool_], size: CanvasSize) -> NDArray[np.bool_]:
    """Returns True for each stroke [n] whose middle line comes within 4 mm of a forbidden place [H, W]."""
    rows, columns = forbidden.shape
    side = 2 * max(1, round(_CLEAR / size.height * rows)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    wide = cv2.dilate(forbidden.astype(np.uint8), disc) > 0
    path = strokes.path(torch.linspace(0, 1, _SAMPLES)).detach().numpy()
    column = np.clip((path[..., 0] / size.width * columns).astype(int), 0, columns - 1)
    row = np.clip(((1 - path[..., 1] / size.height) * rows).astype(int), 0, rows - 1)
    return np.asarray(wide[row, column].any(-1))
