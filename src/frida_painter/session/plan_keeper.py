"""Keeps the plan that is painted: has it made, has what is left planned again, and puts each new one in its place.

A plan is adopted in one order: it is on the disk first, painting goes by it from then on, and then everybody is told,
with how long the robot will take.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from torch import Tensor

from frida_painter.errors import CameraError, ConfigError, FrameDoubtful, PaintingPaused
from frida_painter.palette import Palette
from frida_painter.perception.flatfield import is_evenly
from frida_painter.plan import Plan
from frida_painter.planning.optimize import Step
from frida_painter.planning.placement import Placement
from frida_painter.planning.planner import Planner
from frida_painter.session.choreography import BrushLoad, Looks
from frida_painter.session.events import (
    LastLookDoubted,
    Looked,
    Notify,
    Planned,
    PlanningStep,
    Scheduled,
    TouchCorrected,
)
from frida_painter.session.executor import BatchExecutor, Interruptions
from frida_painter.session.hand import Brushwork
from frida_painter.session.journal import Journal
from frida_painter.session.observer import PHOTOGRAPH_ROWS, TOLERANCE, CanvasObserver, Timelapse
from frida_painter.session.painting import PaintingProgress, difference
from frida_painter.session.replan_policy import CanvasSeen, ReplanPolicy


class PlanKeeper:
    """Plans through `planner`, which may be another one after a pause, and keeps the plan in `progress`.

    budget: seconds of the robot's clock that the whole painting may take, None for any number.
    A person may stop or pause at every planning step. In a pause they may have something else adopted than
    what is being planned: then what is being planned is given up.
    """

    def __init__(
        self,
        planner: Planner,
        brushwork: Brushwork,
        policy: ReplanPolicy,
        timelapse: Timelapse,
        journal: Journal,
        interruptions: Interruptions,
        progress: PaintingProgress,
        tell: Notify,
        budget: float | None = None,
    ) -> None:
        self.planner, self._budget = planner, budget
        self._brushwork, self._policy, self._timelapse = brushwork, policy, timelapse
        self._journal, self._interruptions = journal, interruptions
        self._progress, self._tell = progress, tell

    def begin(self, strokes: int, colors: int, made: Plan | None = None) -> None:
        """Adopts a plan of so many strokes: the one that was made for such a canvas, or a new one for what is seen.

        Raises ConfigError where the painting cannot be had within the budget.
        """
        canvas = self._progress.canvas.last_seen
        made = made if made is not None and is_evenly(canvas, made.ground, TOLERANCE) else None
        plan = made or self._arranged(self.planner.plan(canvas, strokes, colors, self._checking_interrupts("plan")))
        self._adopt(self._within_budget(plan), self.planner.validation_loss(canvas))

    def bind_to_palette(self, mixed: Palette) -> None:
        """Adopts what is left in the paints that a person has really mixed."""
        bound = None
        while bound is None:  # overtaken in a pause: what has been adopted since gets these paints
            rest, canvas = self._progress.rest, self._progress.canvas.last_seen
            before = self._loss()
            with suppress(_Overtaken):
                again = self.planner.bind_to_palette(rest, canvas, mixed, self._checking_interrupts("plan"))
                bound = self._within_budget(self._arranged(again))
        self._adopt(bound, before)

    def replan(self, rounds: int = 1) -> None:
        """Plans what is left again, in so many rounds, for the canvas as it was last seen, and adopts that."""
        rest, canvas, before = self._progress.rest, self._progress.canvas.last_seen, self._loss()
        with suppress(_Overtaken):
            hear = self._checking_interrupts("replan")
            again = self.planner.replan(rest, canvas, hear, rounds, fresh=self._progress.begins_layer)
            after = self._adopt(self._within_budget(self._arranged(again)), before)
            self._progress.gain = 10 * math.log10(before / after) if min(before, after) > 0 else 0.0

    def replace(self, rest: Plan) -> None:
        """Adopts another rest than what was planned, in the same paints."""
        self._adopt(rest, self._loss())

    def keep(self) -> None:
        """After a look what is left stays as it is; where strokes land is known better now, and that is noted."""
        progress = self._progress

        def note() -> None:  # in a pause for want of room another plan may be adopted
            if progress.plan is not None and progress.painted < progress.strokes:
                self._journal.kept(progress.plan, progress.painted, self._brushwork.placement)

        self._interruptions.retry(note)
        progress.planned_at = progress.painted

    def schedule(self) -> None:
        """Tells how long the robot will take for what is left, with all looks on the way."""
        done, of, rest = self._progress.painted, self._progress.strokes, self._progress.rest
        table = self._brushwork.timetable(rest, self._looks(done, of))
        if self._progress.must_dry:
            table = table.after_drying(self._progress.wet_for(self._brushwork.drying))
        self._tell(Scheduled(table, done))

    def _looks(self, done: int, of: int) -> Looks:
        """How often the arm goes aside after so many of the strokes that come after stroke `done`, asked in turn."""
        taken = self._timelapse.due(done, of)

        def after(painted: int, leaves: bool) -> int:
            nonlocal taken
            number = done + painted
            looks = self._policy.next_look(number - 1, of) == number
            films = self._timelapse.wants_frame(number, of, taken, leaves=leaves or looks)
            if films:
                taken = self._timelapse.due(number, of)
            return int(films) + int(looks)

        return after

    def _within_budget(self, rest: Plan) -> Plan:
        """The arranged plan of what is left, without as many strokes as it takes for all to be painted in the budget.

        What is left then is settled anew. Raises ConfigError where not a stroke is painted yet, and none could be.
        """
        fitting = self._fitting(rest)
        if len(fitting) == len(rest):
            return rest
        canvas, hear = self._progress.canvas.last_seen, self._checking_interrupts("plan")
        settled = self.planner.replan(fitting, canvas, hear)
        return self._fitting(self._arranged(settled))

    def _fitting(self, rest: Plan) -> Plan:
        """The arranged plan without the strokes that would be missed least, until there is time enough for the rest."""
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
            rest = self._arranged(self.planner.without_weakest(rest, canvas, count))
        return rest

    def _seconds(self, rest: Plan) -> float:
        """How long the robot takes for what was painted and this, as it is told before it begins."""
        plan = self._progress.followed_by(rest)
        return self._brushwork.timetable(plan, self._looks(0, len(plan)), BrushLoad()).total

    def _adopt(self, rest: Plan, before: float) -> float:
        """From now on, and whatever happens, what is left is painted by this plan, made for the canvas as it is.

        before: the validation loss with the plan as it was; returned: that with this one.
        """
        progress = self._progress
        plan, placement = progress.followed_by(rest), self._brushwork.placement
        self._interruptions.retry(partial(self._journal.planned, plan, progress.painted, placement))
        progress.plan, progress.planned_at = plan, progress.painted
        self.schedule()
        canvas, unseen = progress.canvas.last_seen, 0
        if len(rest):
            unseen = self._policy.next_look(progress.painted, progress.strokes) - progress.painted
        expected, after = self.planner.expected(rest, canvas), self.planner.expected_loss(rest, canvas)
        forecast = self.planner.forecast(rest, canvas, placement, unseen)
        self._tell(Planned(rest, progress.painted, expected, before, after, forecast))
        return after

    def _loss(self) -> float:
        """The validation loss of what would be on the canvas after what is left."""
        return self.planner.expected_loss(self._progress.rest, self._progress.canvas.last_seen)

    def _arranged(self, rest: Plan) -> Plan:
        """The strokes that are left, those of the next batch in the order that is best to paint."""
        if len(rest) == 0:  # all that was left would have touched what is protected
            return rest
        painted = self._progress.painted
        batch = self._policy.next_look(painted, painted + len(rest)) - painted
        fading = self.planner.fading(rest, self._progress.canvas.last_seen)
        return self._brushwork.arranged(rest, min(batch, rest.layer_end(0)), fading)

    def _checking_interrupts(self, phase: str) -> Callable[[Step], None]:
        """Passes planning steps on, and stops the planner when a person has asked for it."""

        def tell(step: Step) -> None:
            self._tell(PlanningStep(phase, step.iteration, step.of, step.loss, step.parts))
            plan = self._progress.plan
            self._interruptions.check()
            if self._progress.plan is not plan:
                raise _Overtaken

        return tell


class _Overtaken(Exception):
    """In a pause a person had something else planned than what was being planned; never leaves this file."""


# Watches what comes of the plan: looks at the canvas, and compares it with what the strokes were to make of it.

_TOLD = 0.0004  # metres; less changes a mark by less than two marks of one stroke differ


class ExecutionMonitor:
    """Looks through `observer`, the arm being aside, at the canvas of `progress`.

    plans: whose planner tells what should be seen; executor: that moves the arm aside. Where the camera or the disk
    fails, the painting pauses and looks again afterwards. Where all strokes are on the canvas nothing is decided by a
    look any more: then whatever can be seen is taken, with a remark.
    """

    def __init__(
        self,
        plans: PlanKeeper,
        executor: BatchExecutor,
        brushwork: Brushwork,
        observer: CanvasObserver,
        journal: Journal,
        interruptions: Interruptions,
        progress: PaintingProgress,
        tell: Notify,
    ) -> None:
        self._plans, self._executor = plans, executor
        self._brushwork, self._observer = brushwork, observer
        self._journal, self._interruptions = journal, interruptions
        self._progress, self._tell = progress, tell
        self._looked_after: int | None = None  # since it could not be told whether the canvas was moved

    def look(self) -> Tensor:
        """The canvas [3, H, W] as it is now, never from a photograph older than the last motion; it is journalled.

        Only a painting whose strokes are all on the canvas may get one that is not as it should be, or the one before.
        """
        if self._progress.remark:
            return self._interruptions.retry(self._glance)
        try:
            return self._interruptions.retry(self._last_look if self._is_last_and_simulated else self._look)
        except PaintingPaused as nobody:
            if not (self._progress.is_complete and isinstance(nobody.__cause__, CameraError)):
                raise
            self._doubt(nobody.__cause__)
            return self._interruptions.retry(self._glance)

    def observe(self) -> CanvasSeen:
        """Looks, tells what was seen and what was expected, and learns where strokes really land."""
        canvas, progress, planner = self.look(), self._progress, self._plans.planner
        batch, last = progress.batch, progress.canvas.last_seen
        expected = planner.expected(batch, last)
        self._tell(Looked(canvas, expected, progress.painted))
        if len(batch) and not progress.remark:  # where they landed tells where the robot is to be sent
            self._learn(planner.locate(batch, self._brushwork.placement, last, canvas))
        progress.canvas.saw(canvas, progress.painted)
        return CanvasSeen(progress.painted, len(progress.rest), difference(canvas, expected), progress.gain)

    def _learn(self, placement: Placement) -> None:
        """The robot is sent by what is known now; a person is told where a brush is sent lower or higher."""
        before = self._brushwork.placement.touch
        self._brushwork.learn(placement)
        now = self._brushwork.placement.touch
        for brush in now.depths:
            lower = now.correction(brush)
            if abs(lower - before.correction(brush)) >= _TOLD:
                self._tell(TouchCorrected(brush, lower, self._progress.painted))

    def _look(self) -> Tensor:
        self._executor.step_aside()
        expected, progress = None, self._progress
        if progress.plan is not None and not self._interruptions.touched:  # else a person may have touched the canvas
            expected = progress.canvas.expectation(self._plans.planner, progress.plan, progress.painted)
        try:
            frame, canvas = self._observer.examine(
                self._brushwork.last_motion, PHOTOGRAPH_ROWS, expected, doubtful=self._looked_after == progress.painted
            )
        except FrameDoubtful:
            self._looked_after = progress.painted  # whoever has the painting go on now, until more is painted
            raise
        self._journal.looked(frame, self._observer.light)
        self._interruptions.touched = False
        return canvas

    @property
    def _is_last_and_simulated(self) -> bool:
        return self._progress.is_complete and self._brushwork.easel.simulated

    def _last_look(self) -> Tensor:
        """A look after the last stroke, where there is nobody to ask."""
        try:
            return self._look()
        except CameraError as trouble:
            self._doubt(trouble)
            return self._glance()

    def _doubt(self, trouble: CameraError) -> None:
        doubted = LastLookDoubted(str(trouble), self._progress.painted)
        self._progress.remark = doubted.sentence
        self._tell(doubted)

    def _glance(self) -> Tensor:
        """The canvas [3, H, W] as it can be seen now, and else as it was last seen; nothing is decided by it."""
        self._executor.step_aside()
        try:
            frame = self._observer.photograph(self._brushwork.last_motion)
            canvas = self._observer.see(frame.image, PHOTOGRAPH_ROWS)
        except CameraError:
            return self._progress.canvas.last_seen
        self._journal.looked(frame, self._observer.light)
        return canvas
