"""The closed loop: plan, paint some strokes, look, plan the rest again (paper, Algorithm 1, `paint`).

Start reading here. Whatever moves is in `brushwork`, whatever sees in `eye`, whatever thinks in
`planning`, and what must outlast a crash goes into the `journal`; this file only says what follows
what, and tells it to whoever listens.
"""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from torch import Tensor

from frida_painter.errors import CameraError, FridaError, PaintingPaused, PlanError, StorageError
from frida_painter.palette import Palette
from frida_painter.perception.frame_check import Expected
from frida_painter.plan import Plan
from frida_painter.planning.optimize import Step
from frida_painter.planning.planner import Planner
from frida_painter.session.brushwork import Brushwork
from frida_painter.session.canvas_observer import CanvasObserver
from frida_painter.session.choreography import Action
from frida_painter.session.events import (
    Dipped,
    Failed,
    Finished,
    Looked,
    MotionBegan,
    Notify,
    PaintsWanted,
    Paused,
    Planned,
    PlanningStep,
    Resumed,
    Scheduled,
    Stopped,
    StrokeLeftOut,
    StrokePainted,
    TimelapseFrame,
)
from frida_painter.session.journal import Journal
from frida_painter.session.replan_policy import ReplanPolicy

PHOTOGRAPH_ROWS = 864
TIMELAPSE_ROWS = 540

_T = TypeVar("_T")


@dataclass(frozen=True)
class Painting:
    """What came of it: the last photograph of the canvas [3, H, W], strokes painted, and those still planned.

    robot_seconds: of the robot's clock, from the first plan to the last look.
    """

    photograph: Tensor
    painted: int
    rest: Plan | None
    robot_seconds: float = 0.0


@dataclass(frozen=True)
class ResumeState:
    """Where a painting stood when it broke off.

    plan: of all its strokes, of which `painted` are on the canvas; planned_at: how many there were when
    it was made; before: the canvas [3, H, W] as it was then, None where that is not known any more;
    now: the canvas as it is.
    """

    plan: Plan
    painted: int
    planned_at: int
    before: Tensor | None
    now: Tensor


class PaintingSession:
    """One painting, from a bare canvas, or from where it broke off, to the last stroke.

    `stop_asked` and `pause_asked` are heeded after every stroke and every planning iteration; `notify`
    hears what happens; `go_on` is asked, and waits for a person's answer, when the painting has paused:
    on a person's wish, or because the disk or the camera failed; `mixed` is asked, and waits, when the
    palette is settled, and answers with what was really mixed, or None for just that. Raises
    PaintingPaused where `go_on` answers no, and RobotError, PlanError and their kinds; what is on the
    canvas stays, and in the journal.
    Before it answers, `go_on` may have the session `look_again`, or `paint_instead`.
    """

    def __init__(
        self,
        planner: Planner,
        brushwork: Brushwork,
        observer: CanvasObserver,
        rhythm: ReplanPolicy,
        *,
        stop_asked: Callable[[], bool],
        notify: Notify,
        journal: Journal | None = None,
        pause_asked: Callable[[], bool] = lambda: False,
        go_on: Callable[[Paused], bool] = lambda paused: False,
        mixed: Callable[[Palette], Palette | None] = lambda wanted: None,
    ) -> None:
        self.planner = planner
        self.brushwork = brushwork
        self.observer = observer
        self.rhythm = rhythm
        self.journal = journal or Journal.nowhere()
        self._stop_asked = stop_asked
        self._pause_asked = pause_asked
        self._go_on = go_on
        self._mixed = mixed
        self._notify = notify
        self._plan: Plan | None = None
        self._painted = 0
        self._planned_at = 0
        self._began_at = 0.0  # s of the robot's clock
        self._before: Tensor | None = None  # the canvas as it was last seen
        self._seen = 0  # strokes that were on it
        self._touched = False
        self._left_out: set[int] = set()  # strokes, by index, by whoever paints by hand

    def run(self, strokes: int, colors: int, plan: Plan | None = None) -> Painting:
        """Paints exactly `strokes` strokes in `colors` paints on a bare canvas, unless a person stops it.

        plan: one of so many strokes that was made before, and is painted instead of a new one.
        """
        return self._to_the_end(lambda: self._begin(strokes, colors, plan))

    def resume(self, where: ResumeState) -> Painting:
        """Paints what is left of a painting, with a clean brush and wells filled anew."""
        return self._to_the_end(lambda: self._begin_again(where))

    def look(self) -> Tensor:
        """The canvas as it is now, seen without the arm, never from a photograph older than the last motion."""
        return self._retry_after_pause(self._look)

    @property
    def rest(self) -> Plan:
        """What is still to be painted. Raises PlanError where nothing has been planned yet."""
        if self._plan is None:
            raise PlanError("Nothing has been planned yet; wait until the first plan is made.")
        return self._plan.part(slice(self._painted, None))

    @property
    def so_far(self) -> Painting | None:
        """What has come of it, as it was last seen; None where the canvas was never seen."""
        rest = None if self._plan is None else self._plan.part(slice(self._painted, None))
        return None if self._before is None else Painting(self._before, self._painted, rest)

    def look_again(self, rounds: int = 1) -> None:
        """Looks at what a person has made of the canvas, and plans the rest again; while the painting has paused.

        rounds: of planning; more than one where the goal has changed.
        """
        self._look_and_plan_again(rounds)

    def paint_instead(self, rest: Plan) -> None:
        """Takes the place of what was still to be painted, palette and canvas being the same; in a pause as well."""
        assert self._plan is not None and self._before is not None
        before = self.planner.judge(self.planner.expected(self.rest, self._before))
        self._adopt(self._plan.part(slice(self._painted)).followed_by(rest))
        expected = self.planner.expected(rest, self._before)
        self._notify(Planned(rest, self._painted, expected, before, self.planner.judge(expected)))

    def _to_the_end(self, begin: Callable[[], None]) -> Painting:
        end: type[Finished | Stopped] = Finished
        try:
            begin()
            self._paint()
        except _StopAsked:
            self._notify(Stopped(self._painted))
            end = Stopped
        except FridaError as trouble:
            with contextlib.suppress(StorageError):
                self.journal.tell(Failed(str(trouble)))
            raise
        took = self.brushwork.last_motion - self._began_at
        if self.brushwork.load.paint is not None:
            self._clean()
        photograph = self.look()
        self._retry_after_pause(partial(self.journal.tell, end(self._painted)))
        rest = None if self._plan is None else self._plan.part(slice(self._painted, None))
        return Painting(photograph, self._painted, rest, took)

    def _begin(self, strokes: int, colors: int, plan: Plan | None) -> None:
        canvas = self._before = self.look()
        self._began_at = self.brushwork.last_motion
        plan = plan or self._arranged(self.planner.plan(canvas, strokes, colors, self._checking_interrupts("plan")))
        self._adopt(plan)
        expected = self.planner.expected(plan, canvas)
        self._notify(Planned(plan, 0, expected, self.planner.judge(canvas), self.planner.judge(expected)))
        self._mix(plan)
        self._take_what_was_mixed(plan, canvas)

    def _take_what_was_mixed(self, plan: Plan, canvas: Tensor) -> None:
        """Plans with what a person has really mixed, where they tell."""
        mixed = self._mixed(plan.palette)
        if mixed is None:
            return
        before = self.planner.judge(self.planner.expected(plan, canvas))
        again = self._arranged(self.planner.bind_to_palette(plan, canvas, mixed, self._checking_interrupts("plan")))
        self._adopt(again)
        expected = self.planner.expected(again, canvas)
        self._notify(Planned(again, 0, expected, before, self.planner.judge(expected)))
        self.brushwork.easel.operator.fill_wells(mixed)

    def _begin_again(self, where: ResumeState) -> None:
        self._plan, self._painted, self._planned_at = where.plan, where.painted, where.planned_at
        known = where.before is not None
        self._before, self._seen = (where.before, where.planned_at) if known else (where.now, where.painted)
        rest = where.plan.part(slice(where.painted, None))
        self._began_at = self.brushwork.last_motion
        self._notify(Resumed(where.plan, where.painted, self.planner.expected(rest, where.now)))
        self._schedule()
        self._clean()
        self._mix(where.plan)

    def _paint(self) -> None:
        while self._plan is not None and self._planned_at < len(self._plan):
            self._paint_until(self.rhythm.next_look(self._planned_at, len(self._plan)))
            self._look_and_plan_again()

    def _paint_until(self, end: int) -> None:
        """Paints until `end` strokes are on the canvas. After a pause the brush is clean, and all is set anew."""
        while self._plan is not None and self._painted < min(end, len(self._plan)):
            left = self._plan.part(slice(self._painted, end))
            for action in self.brushwork.prepare(left, self._painted, len(self._plan)):
                if not self._perform(action, self._plan) or self.brushwork.load is not action.load:
                    break

    def _perform(self, action: Action, plan: Plan) -> bool:
        """Notes and does it; False where it was not done, because it could not be noted, and there was a pause."""
        try:
            self.journal.begins(action, plan)
        except StorageError as trouble:
            self._pause(str(trouble), trouble)
            return False
        done = self.brushwork.perform(action)
        self._retry_after_pause(partial(self.journal.ends, done))
        self._notify(done)
        if isinstance(done, StrokeLeftOut):
            self._left_out.add(done.done - 1)
        if not isinstance(done, Dipped):
            self._painted = done.done
            self._timelapse_frame(done)
            self._check_interrupts()
        return True

    def _look_and_plan_again(self, rounds: int = 1) -> None:
        assert self._plan is not None and self._before is not None
        canvas = self.look()
        batch, rest = self._batch(self._plan), self._plan.part(slice(self._painted, None))
        self._notify(Looked(canvas, self.planner.expected(batch, self._before), self._painted))
        if len(batch):  # where strokes landed tells where the robot is to be sent
            known = self.brushwork.placement
            self.brushwork.placement = self.planner.locate(batch, known, self._before, canvas)
        self._before, self._seen = canvas, self._painted
        if len(rest):
            before = self.planner.judge(self.planner.expected(rest, canvas))
            try:
                again = self._arranged(self.planner.replan(rest, canvas, self._checking_interrupts("replan"), rounds))
            except _Overtaken:
                return
            self._adopt(self._plan.part(slice(self._painted)).followed_by(again))
            expected = self.planner.expected(again, canvas)
            self._notify(Planned(again, self._painted, expected, before, self.planner.judge(expected)))
        self._planned_at = self._painted

    def _arranged(self, rest: Plan) -> Plan:
        """The strokes that are left, those of the next batch in the order in which they are quickest to paint."""
        if len(rest) == 0:  # all that was left would have touched what is protected
            return rest
        until = self.rhythm.next_look(self._painted, self._painted + len(rest))
        return self.brushwork.arranged(rest, until - self._painted)

    def _adopt(self, plan: Plan) -> None:
        """From now on, and whatever happens, painting goes by this plan of all strokes."""
        self._retry_after_pause(partial(self.journal.planned, plan, self._painted, self.brushwork.placement))
        self._plan, self._planned_at = plan, self._painted
        self._schedule()

    def _schedule(self) -> None:
        """Tells how long the robot will take for what is left, with all looks on the way."""
        done, of, looks = self._painted, len(self.rest) + self._painted, self.rhythm.looks

        def after(painted: int) -> int:
            return looks(done + painted, of)

        self._notify(Scheduled(self.brushwork.timetable(self.rest, after), done))

    def _mix(self, plan: Plan) -> None:
        self._notify(PaintsWanted(plan.palette))
        self.brushwork.easel.operator.fill_wells(plan.palette)

    def _look(self) -> Tensor:
        self._step_aside()
        frame, canvas = self.observer.examine(self.brushwork.last_motion, PHOTOGRAPH_ROWS, self._expectation())
        self.journal.looked(frame, self.observer.light)
        self._touched = False
        return canvas

    def _expectation(self) -> Expected | None:
        """What should be seen; None where there is no plan yet, or a person may have touched the canvas."""
        if self._plan is None or self._before is None or self._touched:
            return None
        batch = self._batch(self._plan)
        return Expected(self._before, self.planner.expected(batch, self._before) if len(batch) else self._before)

    def _batch(self, plan: Plan) -> Plan:
        """What was painted since the canvas was last seen."""
        return plan.part([index for index in range(self._seen, self._painted) if index not in self._left_out])

    def _timelapse_frame(self, painted: StrokePainted | StrokeLeftOut) -> None:
        """A picture for the film, which nothing is decided by, and without which the painting goes on."""
        if isinstance(painted, StrokePainted) and self.rhythm.wants_timelapse_frame(painted.done, painted.of):
            self._retry_after_pause(self._step_aside)
            with contextlib.suppress(CameraError):
                picture = self.observer.look(self.brushwork.last_motion, TIMELAPSE_ROWS)
                self._notify(TimelapseFrame(picture, painted.done, painted.of, painted.color))

    def _step_aside(self) -> None:
        self.journal.tell(MotionBegan(("home",)))
        self.brushwork.step_aside()

    def _clean(self) -> None:
        what = tuple(motion.label for motion in self.brushwork.cleaning())
        self._retry_after_pause(partial(self.journal.tell, MotionBegan(what)))
        self.brushwork.clean()

    def _checking_interrupts(self, phase: str) -> Callable[[Step], None]:
        """Passes planning steps on, and stops the planner when a person has asked for it."""

        def tell(step: Step) -> None:
            self._notify(PlanningStep(phase, step.iteration, step.of, step.loss, step.strokes))
            plan = self._plan
            self._check_interrupts()
            if self._plan is not plan:
                raise _Overtaken

        return tell

    def _check_interrupts(self) -> None:
        if self._stop_asked():
            raise _StopAsked
        if self._pause_asked():
            self._pause("You asked for a pause.")

    def _retry_after_pause(self, work: Callable[[], _T]) -> _T:
        """Does what needs the disk or the camera; where they fail, pauses and, when told to go on, tries again."""
        while True:
            try:
                return work()
            except (StorageError, CameraError) as trouble:
                self._pause(str(trouble), trouble)

    def _pause(self, reason: str, cause: FridaError | None = None) -> None:
        """Lifts the brush, cleans it, moves the arm aside and waits until a person has the painting go on."""
        with contextlib.suppress(StorageError):
            self.journal.tell(Paused(reason, self._painted))
        if self.brushwork.load.paint is not None:
            self.brushwork.clean()
        self.brushwork.step_aside()
        self._touched = True  # whoever is asked may paint along, now or while answering
        paused = Paused(reason, self._painted)
        self._notify(paused)
        if not self._go_on(paused):
            raise PaintingPaused(f"{reason} The painting has paused after {self._painted} strokes.") from cause
        self._touched = True


class _Overtaken(Exception):
    """In a pause a person had something else planned than what was being planned; never leaves this file."""


class _StopAsked(Exception):
    """A person has asked to stop; never leaves this file."""
