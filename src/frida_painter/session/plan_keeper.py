"""Keeps the plan that is painted: has it made, has what is left planned again, and puts each new one in its place.

A plan is adopted in one order: it is on the disk first, painting goes by it from then on, and then everybody is told,
with how long the robot will take.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from frida_painter.errors import ConfigError
from frida_painter.palette import Palette
from frida_painter.perception.margin import is_evenly
from frida_painter.plan import Plan
from frida_painter.planning.optimize import Step
from frida_painter.planning.planner import Planner
from frida_painter.session.brushwork import Brushwork
from frida_painter.session.canvas_observer import Timelapse
from frida_painter.session.canvas_start import TOLERANCE
from frida_painter.session.choreography import BrushLoad
from frida_painter.session.events import Notify, Planned, PlanningStep, Scheduled
from frida_painter.session.interruptions import Interruptions
from frida_painter.session.journal import Journal
from frida_painter.session.painting import PaintingProgress
from frida_painter.session.replan_policy import ReplanPolicy
from frida_painter.session.timing import Looks


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
