"""A painting as it is made: how far it is, where it goes on after it broke off, and what came of it."""

from dataclasses import dataclass, field

from torch import Tensor

from frida_painter import images
from frida_painter.errors import PlanError
from frida_painter.palette import Palette
from frida_painter.perception.frame_check import Expected
from frida_painter.plan import Plan
from frida_painter.planning.planner import Planner


@dataclass
class CanvasMemory:
    """before: the canvas [3, H, W] as it was last seen, with `strokes` of the plan on it; None before the first look.

    left_out: strokes, by index, that whoever paints by hand left out.
    """

    before: Tensor | None = None
    strokes: int = 0
    left_out: set[int] = field(default_factory=set)

    @property
    def last_seen(self) -> Tensor:
        """The canvas [3, H, W] as it was last seen. Raises PlanError before the first look."""
        if self.before is None:
            raise PlanError("The canvas has not been looked at yet; look at it before anything is planned for it.")
        return self.before

    def saw(self, canvas: Tensor, painted: int) -> None:
        """The canvas [3, H, W] was looked at, with `painted` strokes of the plan on it."""
        self.before, self.strokes = canvas, painted

    def batch(self, plan: Plan, painted: int) -> Plan:
        """What was painted since, `painted` strokes of the plan being done."""
        return plan.part([index for index in range(self.strokes, painted) if index not in self.left_out])

    def expectation(self, planner: Planner, plan: Plan, painted: int) -> Expected | None:
        """What should be seen now; None before the first look."""
        if self.before is None:
            return None
        batch = self.batch(plan, painted)
        return Expected(self.before, planner.expected(batch, self.before) if len(batch) else self.before)


def difference(seen: Tensor, expected: Tensor) -> float:
    """Mean difference of two pictures [3, H, W], over pixels and channels, at the second one's size."""
    rows, columns = expected.shape[1:]
    return float((images.fit(seen, rows, columns) - expected).abs().mean())


@dataclass(frozen=True)
class Painting:
    """What came of it: the last photograph of the canvas [3, H, W], strokes painted, and those still planned.

    robot_seconds: of the robot's clock, from the first plan to the last look; remark: a sentence on a photograph that
    does not show the canvas as it should, "" where it does.
    """

    photograph: Tensor
    painted: int
    rest: Plan | None
    robot_seconds: float = 0.0
    remark: str = ""


@dataclass(frozen=True)
class ResumeState:
    """Where a painting stood when it broke off.

    plan: of all its strokes, of which `painted` are on the canvas; planned_at: how many there were when
    it was made; before: the canvas [3, H, W] as it was then, None where that is not known any more;
    now: the canvas as it is; wet: seconds that its last layer still dries, None where it did not begin to.
    """

    plan: Plan
    painted: int
    planned_at: int
    before: Tensor | None
    now: Tensor
    wet: float | None = None


@dataclass
class PaintingProgress:
    """How far a painting is.

    plan: of all its strokes, painted ones first, None before the first plan is adopted; painted: strokes that are done;
    planned_at: how many were done when it was last decided how the rest is painted; dried_at: how many were done when
    the paint was last let dry; wet: seconds that it still dries, where it has begun to; wells: what is in them, None
    where that is not known; canvas: what is remembered of it; gain: dB by which the last replan lowered the expected
    loss, None before there was one; remark: what is to be said of the photograph of the finished canvas, if anything.
    """

    plan: Plan | None = None
    painted: int = 0
    planned_at: int = 0
    dried_at: int = 0
    wet: float | None = None
    wells: Palette | None = None
    canvas: CanvasMemory = field(default_factory=CanvasMemory)
    gain: float | None = None
    remark: str = ""

    @property
    def is_complete(self) -> bool:
        """Whether all strokes of a plan are done."""
        return self.plan is not None and 0 < self.strokes <= self.painted

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

    @property
    def begins_layer(self) -> bool:
        """Whether the next stroke is the first of a layer that goes on the paint of another."""
        if self.plan is None or not 0 < self.painted < len(self.plan):
            return False
        return self.plan.layer_end(self.painted - 1) == self.painted

    @property
    def layer_number(self) -> int:
        """The number of the next stroke's layer, from 0."""
        return int(self._known_plan.layer[self.painted])

    @property
    def layer_end(self) -> int:
        """How many strokes are painted when the layer of the next one is done."""
        return self._known_plan.layer_end(self.painted)

    @property
    def must_dry(self) -> bool:
        """Whether the paint on the canvas has to dry before the next stroke."""
        return self.begins_layer and self.dried_at != self.painted

    def wet_for(self, drying: float) -> float:
        """Seconds that the paint on the canvas still dries, of `drying` in all."""
        return drying if self.wet is None else self.wet

    def followed_by(self, rest: Plan) -> Plan:
        """The plan of all strokes: those that are done, and then `rest`."""
        return rest if self.plan is None or self.painted == 0 else self.plan.part(slice(self.painted)).followed_by(rest)

    def go_on_from(self, where: ResumeState) -> None:
        """It is as far as it was when it broke off."""
        self.plan, self.painted, self.planned_at = where.plan, where.painted, where.planned_at
        self.wet, self.dried_at = (None, where.painted) if where.wet == 0 else (where.wet, 0)
        known = where.before is not None
        self.canvas = CanvasMemory(*((where.before, where.planned_at) if known else (where.now, where.painted)))

    def as_painting(self, photograph: Tensor, robot_seconds: float = 0.0) -> Painting:
        """What has come of it by now, by a photograph of the canvas [3, H, W]."""
        rest = None if self.plan is None else self.rest
        return Painting(photograph, self.painted, rest, robot_seconds, self.remark)

    @property
    def _known_plan(self) -> Plan:
        if self.plan is None:
            raise PlanError("Nothing has been planned yet; wait until the first plan is made.")
        return self.plan
