"""A painting as it is made: how far it is, where it goes on after it broke off, and what came of it."""

from dataclasses import dataclass, field

from torch import Tensor

from frida_painter.errors import PlanError
from frida_painter.plan import Plan
from frida_painter.session.canvas_memory import CanvasMemory


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


@dataclass
class PaintingProgress:
    """How far a painting is.

    plan: of all its strokes, painted ones first, None before the first plan is adopted; painted: strokes that are done;
    planned_at: how many were done when it was last decided how the rest is painted; canvas: what is remembered of it.
    """

    plan: Plan | None = None
    painted: int = 0
    planned_at: int = 0
    canvas: CanvasMemory = field(default_factory=CanvasMemory)

    @property
    def strokes(self) -> int:
        """How many strokes the whole plan has; 0 before there is one."""
        return 0 if self.plan is None else len(self.plan)

    @property
    def rest(self) -> Plan:
        """What is still to be painted. Raises PlanError where nothing has been planned yet."""
        return self._known_plan.part(slice(self.painted, None))

    @property
    def batch(self) -> Plan:
        """What was painted since the last look. Raises PlanError where nothing has been planned yet."""
        return self.canvas.batch(self._known_plan, self.painted)

    def followed_by(self, rest: Plan) -> Plan:
        """The plan of all strokes: those that are done, and then `rest`."""
        return rest if self.plan is None or self.painted == 0 else self.plan.part(slice(self.painted)).followed_by(rest)

    def go_on_from(self, where: ResumeState) -> None:
        """It is as far as it was when it broke off."""
        self.plan, self.painted, self.planned_at = where.plan, where.painted, where.planned_at
        known = where.before is not None
        self.canvas = CanvasMemory(*((where.before, where.planned_at) if known else (where.now, where.painted)))

    def as_painting(self, photograph: Tensor, robot_seconds: float = 0.0) -> Painting:
        """What has come of it by now, by a photograph of the canvas [3, H, W]."""
        return Painting(photograph, self.painted, None if self.plan is None else self.rest, robot_seconds)

    @property
    def _known_plan(self) -> Plan:
        if self.plan is None:
            raise PlanError("Nothing has been planned yet; wait until the first plan is made.")
        return self.plan
