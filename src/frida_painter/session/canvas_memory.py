"""What the painter remembers of the canvas: how it looked last, and which strokes were put on it since."""

from dataclasses import dataclass, field

from torch import Tensor

from frida_painter import images
from frida_painter.errors import PlanError
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
