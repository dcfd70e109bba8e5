"""State of a painting: its progress, and its result."""

from dataclasses import dataclass, field
from typing import Self

from torch import Tensor

from frida_painter.errors import PlanError
from frida_painter.perception.frame_check import Expected
from frida_painter.planning.planner import Planner
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.system import images


@dataclass
class CanvasMemory:
    """Last seen state of the canvas.

    before: picture [3, H, W] from the last look, with `strokes` strokes of the plan on it; None before the first
    look.
    left_out: indices of strokes that were left out by a person, or given up.
    """

    before: Tensor | None = None
    strokes: int = 0
    left_out: set[int] = field(default_factory=set)

    @property
    def last_seen(self) -> Tensor:
        """Canvas [3, H, W] at the last look. Raises PlanError before the first look."""
        if self.before is None:
            raise PlanError("The canvas has not been looked at yet; look at it before anything is planned for it.")
        return self.before

    def saw(self, canvas: Tensor, painted: int) -> None:
        """Stores the canvas [3, H, W] of a look, with `painted` strokes of the plan on it."""
        self.before, self.strokes = canvas, painted


def difference(seen: Tensor, expected: Tensor) -> float:
    """Returns the mean difference of two pictures [3, H, W], over pixels and channels, at the second one's size."""
    rows, columns = expected.shape[1:]
    return float((images.fit(seen, rows, columns) - expected).abs().mean())


@dataclass(frozen=True)
class Painting:
    """Result of a painting.

    photograph [3, H, W]: last photograph of the canvas.
    painted: number of painted strokes.
    rest: strokes that are still planned.
    robot_seconds: seconds of the robot's clock, from the first plan to the last look.
    remark: sentence about a photograph that may not show the canvas well, else "".
    """

    photograph: Tensor
    painted: int
    rest: Plan | None
    robot_seconds: float = 0.0
    remark: str = ""

    def __repr__(self) -> str:
        rows, columns = self.photograph.shape[1:]
        left = "no plan" if self.rest is None else f"{len(self.rest)} strokes left"
        return f"Painting({self.painted} strokes painted, {left}, photograph of {columns} x {rows} pixels)"


@dataclass
class PaintingProgress:
    """Progress of a painting.

    plan: plan of all strokes, painted ones first; None before the first plan is adopted.
    painted: number of strokes that are done.
    planned_at: value of `painted` when the rest was last planned, or kept.
    dried_at: value of `painted` when the paint was last left to dry.
    wet: seconds that the paint still dries, None if drying did not begin.
    resumed_at: value of `painted` when this session began; older paint counts as dry.

    wells: paints in the wells, None if unknown.
    canvas: last seen state of the canvas.
    gain: dB by which the last replan lowered the expected loss, None before the first one.
    remark: sentence about the photograph of the finished canvas, or "".
    person: number of strokes of a person on the canvas.
    person_unseen: True if some of them were painted after the last look.
    answers: True if the rest of the plan answers a person, and is not on the way to the goal.

    most: greatest number of strokes of a painting without a goal, whose plan grows with every answer to a person; None
    for a painting with a goal.
    ended: True if a person ended a painting without a goal.
    """

    plan: Plan | None = None
    painted: int = 0
    planned_at: int = 0
    dried_at: int = 0
    wet: float | None = None
    resumed_at: int = 0
    wells: Palette | None = None
    canvas: CanvasMemory = field(default_factory=CanvasMemory)
    gain: float | None = None
    remark: str = ""
    person: int = 0
    person_unseen: bool = False
    answers: bool = False
    most: int | None = None
    ended: bool = False

    @property
    def is_complete(self) -> bool:
        """True if all strokes of the painting are done."""
        if self.most is not None and not self.ended and self.painted < self.most:
            return False
        return self.plan is not None and 0 < self.strokes <= self.painted

    @property
    def strokes(self) -> int:
        """Number of strokes of the whole plan; 0 before the first plan."""
        return 0 if self.plan is None else len(self.plan)

    @property
    def rest(self) -> Plan:
        """Strokes that are not painted yet. Raises PlanError before the first plan."""
        return self._known_plan.part(slice(self.painted, None))

    @property
    def batch(self) -> Plan:
        """Strokes painted since the last look. Raises PlanError before the first plan."""
        since, left_out = range(self.canvas.strokes, self.painted), self.canvas.left_out
        return self._known_plan.part([index for index in since if index not in left_out])

    def expectation(self, planner: Planner) -> Expected | None:
        """Returns the expected canvas; None before the first look, and before the first plan."""
        if (before := self.canvas.before) is None or self.plan is None:
            return None
        batch = self.batch
        return Expected(before, planner.expected(batch, before) if len(batch) else before)

    @property
    def begins_layer(self) -> bool:
        """True if the next stroke is the first of a layer on top of another one."""
        if self.plan is None or not 0 < self.painted < len(self.plan):
            return False
        return self.plan.layer_end(self.painted - 1) == self.painted

    @property
    def layer_end(self) -> int:
        """Number of painted strokes at the end of the next stroke's layer."""
        return self._known_plan.layer_end(self.painted)

    @property
    def must_dry(self) -> bool:
        """True if the paint on the canvas must dry before the next stroke."""
        return self.begins_layer and self.dried_at != self.painted

    def wet_for(self, drying: float) -> float:
        """Returns the seconds that the paint still dries, of `drying` in all."""
        return drying if self.wet is None else self.wet

    def followed_by(self, rest: Plan) -> Plan:
        """Returns the plan of all strokes: the painted ones, then `rest`."""
        return rest if self.plan is None or self.painted == 0 else self.plan.part(slice(self.painted)).followed_by(rest)

    @classmethod
    def resume(
        cls, plan: Plan, painted: int, planned_at: int, before: Tensor | None, now: Tensor, wet: float | None = None,
        left_out: frozenset[int] = frozenset(),
    ) -> Self:  # fmt: skip
        """Returns the progress of a painting that broke off.

        plan: plan of all its strokes; `painted` of them are on the canvas.
        before: canvas [3, H, W] when the plan was made, None if unknown. now: current canvas.
        left_out: indices of strokes before `painted` that are not on the canvas.
        """
        wet, dried_at = (None, painted) if wet == 0 else (wet, 0)
        seen = (now, painted) if before is None else (before, planned_at)
        return cls(plan, painted, planned_at, dried_at, wet, painted, None, CanvasMemory(*seen, set(left_out)))

    def go_on_from(self, resumed: Self) -> None:
        """Takes up the progress of the same painting before it broke off."""
        vars(self).update(vars(resumed), most=self.most)

    def as_painting(self, photograph: Tensor, robot_seconds: float = 0.0) -> Painting:
        """Returns the result so far, with a photograph of the canvas [3, H, W]."""
        rest = None if self.plan is None else self.rest
        return Painting(photograph, self.painted, rest, robot_seconds, self.remark)

    @property
    def _known_plan(self) -> Plan:
        if self.plan is None:
            raise PlanError("Nothing has been planned yet; wait until the first plan is made.")
        return self.plan
