"""The closed loop: plan, paint some strokes, look, plan the rest again (paper, Algorithm 1, `paint`).

Start reading here. Whatever moves is in `brushwork`, whatever sees in `canvas_observer`, whatever thinks in
`planning`, whatever interrupts in `interruptions`, and when to look and plan again in `replan_policy`. What must
be on the disk before the robot moves is put into the `journal` by direct calls, for it can fail, and then nothing
moves; everything else is told to whoever listens, the journal among them. This file only says what follows what.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from torch import Tensor

from frida_painter.errors import FridaError, PlanError, StorageError
from frida_painter.palette import Palette
from frida_painter.plan import Plan
from frida_painter.planning.optimize import Step
from frida_painter.planning.planner import Planner
from frida_painter.session.brushwork import Brushwork
from frida_painter.session.canvas_memory import CanvasMemory, difference
from frida_painter.session.canvas_observer import CanvasObserver
from frida_painter.session.choreography import Action
from frida_painter.session.events import (
    Dipped,
    Event,
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
)
from frida_painter.session.interruptions import Interruptions, StopAsked
from frida_painter.session.journal import Journal
from frida_painter.session.replan_policy import CanvasSeen, ReplanPolicy
from frida_painter.session.timelapse import Timelapse

PHOTOGRAPH_ROWS = 864


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
        policy: ReplanPolicy,
        *,
        stop_asked: Callable[[], bool],
        notify: Notify,
        journal: Journal | None = None,
        pause_asked: Callable[[], bool] = lambda: False,
        go_on: Callable[[Paused], bool] = lambda paused: False,
        mixed: Callable[[Palette], Palette | None] = lambda wanted: None,
        timelapse: Timelapse | None = None,
    ) -> None:
        self.planner = planner
        self.brushwork = brushwork
        self.observer = observer
        self.policy = policy
        self.journal = journal or Journal.nowhere()
        self.timelapse = timelapse or Timelapse()
        self.interruptions = Interruptions(
            brushwork,
            self._tell,
            stop_asked=stop_asked,
            pause_asked=pause_asked,
            go_on=go_on,
            painted=lambda: self._painted,
        )
        self._mixed = mixed
        self._notify = notify
        self._plan: Plan | None = None
        self._painted = 0
        self._planned_at = 0  # strokes painted when it was last decided how the rest is painted
        self._began_at = 0.0  # s of the robot's clock
        self._canvas = CanvasMemory()

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
        return self.interruptions.retry(self._look)

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
        return None if self._canvas.before is None else Painting(self._canvas.before, self._painted, rest)

    def look_again(self, rounds: int = 1) -> None:
        """Looks at what a person has made of the canvas, and plans the rest again; while the painting has paused.

        rounds: of planning; more than one where the goal has changed.
        """
        self._look_and_plan_again(rounds, asked=True)

    def paint_instead(self, rest: Plan) -> None:
        """Takes the place of what was still to be painted, palette and canvas being the same; in a pause as well."""
        canvas = self._canvas.before
        assert canvas is not None
        before = self.planner.validation_loss(self.planner.expected(self.rest, canvas))
        self._adopt(rest, canvas, before)

    def _to_the_end(self, begin: Callable[[], None]) -> Painting:
        end: type[Finished | Stopped] = Finished
        try:
            begin()
            self._paint()
        except StopAsked:
            self._tell(Stopped(self._painted))
            end = Stopped
        except FridaError as trouble:
            self.journal.hear(Failed(str(trouble)))
            raise
        took = self.brushwork.last_motion - self._began_at
        if self.brushwork.load.paint is not None:
            self._clean()
        photograph = self.look()
        self.interruptions.retry(partial(self.journal.tell, end(self._painted)))
        rest = None if self._plan is None else self._plan.part(slice(self._painted, None))
        return Painting(photograph, self._painted, rest, took)

    def _begin(self, strokes: int, colors: int, plan: Plan | None) -> None:
        canvas = self._canvas.before = self.look()
        self._began_at = self.brushwork.last_motion
        plan = plan or self._arranged(self.planner.plan(canvas, strokes, colors, self._checking_interrupts("plan")))
        self._adopt(plan, canvas, self.planner.validation_loss(canvas))
        self._mix(plan)
        self._take_what_was_mixed(plan, canvas)

    def _take_what_was_mixed(self, plan: Plan, canvas: Tensor) -> None:
        """Plans with what a person has really mixed, where they tell."""
        mixed = self._mixed(plan.palette)
        if mixed is None:
            return
        before = self.planner.validation_loss(self.planner.expected(plan, canvas))
        again = self._arranged(self.planner.bind_to_palette(plan, canvas, mixed, self._checking_interrupts("plan")))
        self._adopt(again, canvas, before)
        self.brushwork.easel.operator.fill_wells(mixed)

    def _begin_again(self, where: ResumeState) -> None:
        self._plan, self._painted, self._planned_at = where.plan, where.painted, where.planned_at
        known = where.before is not None
        seen = (where.before, where.planned_at) if known else (where.now, where.painted)
        self._canvas = CanvasMemory(*seen)
        rest = where.plan.part(slice(where.painted, None))
        self._began_at = self.brushwork.last_motion
        self._tell(Resumed(where.plan, where.painted, self.planner.expected(rest, where.now)))
        self._schedule()
        self._clean()
        self._mix(where.plan)

    def _paint(self) -> None:
        while self._plan is not None and self._planned_at < len(self._plan):
            self._paint_until(self.policy.next_look(self._planned_at, len(self._plan)))
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
            self.interruptions.pause(str(trouble), trouble)
            return False
        done = self.brushwork.perform(action)
        self.interruptions.retry(partial(self.journal.ends, done))
        self._tell(done)
        if isinstance(done, StrokeLeftOut):
            self._canvas.left_out.add(done.done - 1)
        if not isinstance(done, Dipped):
            self._painted = done.done
            self._timelapse_frame(done)
            self.interruptions.check()
        return True

    def _look_and_plan_again(self, rounds: int = 1, *, asked: bool = False) -> None:
        assert self._plan is not None and self._canvas.before is not None
        canvas, rest, last = self.look(), self.rest, self._canvas.before
        batch = self._canvas.batch(self._plan, self._painted)
        expected = self.planner.expected(batch, last)
        self._tell(Looked(canvas, expected, self._painted))
        if len(batch):  # where strokes landed tells where the robot is to be sent
            known = self.brushwork.placement
            self.brushwork.placement = self.planner.locate(batch, known, last, canvas)
        self._canvas.before, self._canvas.strokes = canvas, self._painted
        seen = CanvasSeen(self._painted, len(rest), difference(canvas, expected))
        if len(rest) and (asked or self.policy.wants_replan(seen)):
            before = self.planner.validation_loss(self.planner.expected(rest, canvas))
            try:
                again = self._arranged(self.planner.replan(rest, canvas, self._checking_interrupts("replan"), rounds))
            except _Overtaken:
                return
            self._adopt(again, canvas, before)
        self._planned_at = self._painted

    def _arranged(self, rest: Plan) -> Plan:
        """The strokes that are left, those of the next batch in the order in which they are quickest to paint."""
        if len(rest) == 0:  # all that was left would have touched what is protected
            return rest
        until = self.policy.next_look(self._painted, self._painted + len(rest))
        return self.brushwork.arranged(rest, until - self._painted)

    def _adopt(self, rest: Plan, canvas: Tensor, before: float) -> None:
        """From now on, and whatever happens, what is left is painted by this plan, made for the canvas as it is.

        before: the objective with the plan as it was.
        """
        painted = None if self._plan is None or self._painted == 0 else self._plan.part(slice(self._painted))
        plan = rest if painted is None else painted.followed_by(rest)
        self.interruptions.retry(partial(self.journal.planned, plan, self._painted, self.brushwork.placement))
        self._plan, self._planned_at = plan, self._painted
        self._schedule()
        expected = self.planner.expected(rest, canvas)
        self._tell(Planned(rest, self._painted, expected, before, self.planner.validation_loss(expected)))

    def _schedule(self) -> None:
        """Tells how long the robot will take for what is left, with all looks on the way."""
        done, of = self._painted, len(self.rest) + self._painted

        def after(painted: int) -> int:
            number = done + painted
            looks = self.policy.next_look(number - 1, of) == number
            return int(self.timelapse.wants_frame(number, of)) + int(looks)

        self._tell(Scheduled(self.brushwork.timetable(self.rest, after), done))

    def _mix(self, plan: Plan) -> None:
        self._tell(PaintsWanted(plan.palette))
        self.brushwork.easel.operator.fill_wells(plan.palette)

    def _look(self) -> Tensor:
        self._step_aside()
        expected = None  # there is no plan yet, or a person may have touched the canvas
        if self._plan is not None and not self.interruptions.touched:
            expected = self._canvas.expectation(self.planner, self._plan, self._painted)
        frame, canvas = self.observer.examine(self.brushwork.last_motion, PHOTOGRAPH_ROWS, expected)
        self.journal.looked(frame, self.observer.light)
        self.interruptions.touched = False
        return canvas

    def _timelapse_frame(self, painted: StrokePainted | StrokeLeftOut) -> None:
        if isinstance(painted, StrokePainted) and self.timelapse.wants_frame(painted.done, painted.of):
            self.interruptions.retry(self._step_aside)
            frame = self.timelapse.frame(painted, self.brushwork, self.observer)
            if frame is not None:
                self._tell(frame)

    def _tell(self, event: Event) -> None:
        self.journal.hear(event)
        self._notify(event)

    def _step_aside(self) -> None:
        self.journal.tell(MotionBegan(("home",)))
        self.brushwork.step_aside()

    def _clean(self) -> None:
        what = tuple(motion.label for motion in self.brushwork.cleaning())
        self.interruptions.retry(partial(self.journal.tell, MotionBegan(what)))
        self.brushwork.clean()

    def _checking_interrupts(self, phase: str) -> Callable[[Step], None]:
        """Passes planning steps on, and stops the planner when a person has asked for it."""

        def tell(step: Step) -> None:
            self._tell(PlanningStep(phase, step.iteration, step.of, step.loss, step.strokes))
            plan = self._plan
            self.interruptions.check()
            if self._plan is not plan:
                raise _Overtaken

        return tell


class _Overtaken(Exception):
    """In a pause a person had something else planned than what was being planned; never leaves this file."""
