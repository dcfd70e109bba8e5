"""The closed loop: plan, paint some strokes, look, plan the rest again (paper, Algorithm 1, `paint`).

Start reading here. Whatever moves is in `brushwork`, whatever sees in `eye`, whatever thinks in
`planning`; this file only says what follows what, and tells it to whoever listens.
"""

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor

from frida_painter.plan import Plan
from frida_painter.planning.optimize import Step
from frida_painter.planning.planner import Planner
from frida_painter.session.brushwork import Brushwork
from frida_painter.session.events import (
    Glimpsed,
    Looked,
    Notify,
    PaintsWanted,
    Planned,
    PlanningStep,
    Stopped,
    StrokePainted,
)
from frida_painter.session.eye import Eye

PHOTOGRAPH_ROWS = 864
GLIMPSE_ROWS = 540


@dataclass(frozen=True)
class Rhythm:
    """How a painting is divided: how often the painter looks and plans again, and glimpses for the film."""

    replans: int
    glimpses: int

    def batches(self, strokes: int) -> list[int]:
        """Strokes painted between two looks: `replans` + 1 batches that differ by at most one stroke."""
        count = min(self.replans + 1, strokes)
        return [strokes * (number + 1) // count - strokes * number // count for number in range(count)]

    def wants_glimpse(self, done: int, of: int) -> bool:
        """Whether the film gets a picture after stroke `done` of `of`."""
        return done * self.glimpses // of > (done - 1) * self.glimpses // of


@dataclass(frozen=True)
class Painting:
    """What came of it: the last photograph of the canvas [3, H, W], strokes painted, and those still planned."""

    photograph: Tensor
    painted: int
    rest: Plan | None


class PaintingSession:
    """One painting, from a bare canvas to the last stroke.

    `stop_asked` is heeded after every stroke and every planning iteration; `notify` hears what
    happens. Raises RobotError, CameraError, PlanError and their kinds; what is on the canvas stays.
    """

    def __init__(
        self,
        planner: Planner,
        brushwork: Brushwork,
        eye: Eye,
        rhythm: Rhythm,
        *,
        stop_asked: Callable[[], bool],
        notify: Notify,
    ) -> None:
        self.planner = planner
        self.brushwork = brushwork
        self.eye = eye
        self.rhythm = rhythm
        self._stop_asked = stop_asked
        self._notify = notify
        self._painted = 0
        self._rest: Plan | None = None

    def run(self, strokes: int, colors: int) -> Painting:
        """Paints exactly `strokes` strokes in `colors` paints, unless a person stops it."""
        canvas = self._look()
        try:
            self._rest = self._plan(canvas, strokes, colors)
            self._mix(self._rest)
            for batch_size in self.rhythm.batches(strokes):
                batch, before = self._rest.part(slice(batch_size)), canvas
                self._rest = self._paint(self._rest, batch_size, strokes)
                canvas = self._look()
                self._notify(Looked(canvas, self.planner.expected(batch, before), self._painted))
                self._aim(batch, before, canvas)
                self._rest = self._replan(self._rest, canvas)
        except _StopAsked:
            self._notify(Stopped(self._painted))
        self.brushwork.clean()
        return Painting(self._look(), self._painted, self._rest)

    def _look(self, rows: int = PHOTOGRAPH_ROWS) -> Tensor:
        """The canvas as it is now, seen without the arm, never from a photograph older than the last motion."""
        self.brushwork.step_aside()
        return self.eye.look(self.brushwork.last_motion, rows)

    def _plan(self, canvas: Tensor, strokes: int, colors: int) -> Plan:
        plan = self.planner.plan(canvas, strokes, colors, self._heeding("plan"))
        expected = self.planner.expected(plan, canvas)
        bare, planned = self.planner.judge(canvas), self.planner.judge(expected)
        self._notify(Planned(plan, 0, expected, bare, planned))
        return plan

    def _mix(self, plan: Plan) -> None:
        self._notify(PaintsWanted(plan.palette))
        self.brushwork.easel.attendant.fill_wells(plan.palette)

    def _paint(self, rest: Plan, count: int, of: int) -> Plan:
        """Paints the first `count` strokes of what is left, and returns what is left then."""
        first = self._painted
        for action in self.brushwork.prepare(rest.part(slice(count)), first, of):
            self.brushwork.perform(action)
            self._notify(action.done)
            if isinstance(action.done, StrokePainted):
                self._painted = action.done.done
                self._rest = rest.part(slice(self._painted - first, None))
                if self.rhythm.wants_glimpse(self._painted, of):
                    self._notify(Glimpsed(self._look(GLIMPSE_ROWS), self._painted, of, action.done.color))
                self._heed_stop()
        return rest.part(slice(count, None))

    def _aim(self, painted: Plan, before: Tensor, canvas: Tensor) -> None:
        """Sees where the strokes landed, so that the next ones land where they are meant to."""
        self.brushwork.placement = self.planner.locate(painted, self.brushwork.placement, before, canvas)

    def _replan(self, rest: Plan, canvas: Tensor) -> Plan:
        if len(rest) == 0:
            return rest
        before = self.planner.judge(self.planner.expected(rest, canvas))
        plan = self.planner.replan(rest, canvas, self._heeding("replan"))
        expected = self.planner.expected(plan, canvas)
        self._notify(Planned(plan, self._painted, expected, before, self.planner.judge(expected)))
        return plan

    def _heeding(self, phase: str) -> Callable[[Step], None]:
        """Passes planning steps on, and stops the planner when a person has asked for it."""

        def tell(step: Step) -> None:
            self._notify(PlanningStep(phase, step.iteration, step.of, step.loss, step.strokes))
            self._heed_stop()

        return tell

    def _heed_stop(self) -> None:
        if self._stop_asked():
            raise _StopAsked


class _StopAsked(Exception):
    """A person has asked to stop; never leaves this file."""
