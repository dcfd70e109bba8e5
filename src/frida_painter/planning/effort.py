"""How much work a plan is worth."""

import math
from dataclasses import dataclass, field

from frida_painter.planning.initialize import Growth


@dataclass(frozen=True)
class Effort:
    """How many iterations are spent on what.

    growth: on the start; refining: joint steps after each of `relocations` rounds in which weak
    strokes move; drawing: steps after each round in which colours are drawn towards the paints;
    binding: steps once they are paints; polishing: last steps at full resolution; replanning:
    steps after each look, and last ones of a later layer.
    """

    growth: Growth = field(default_factory=Growth)
    relocations: int = 3
    refining: int = 25
    drawing: int = 20
    binding: int = 40
    polishing: int = 80
    replanning: int = 40

    def scaled(self, factor: float) -> "Effort":
        """The same effort with `factor` times as many iterations."""
        growth = Growth(self.growth.rounds, math.ceil(self.growth.settling * factor), self.growth.proposals)
        counts = self.refining, self.drawing, self.binding, self.polishing, self.replanning
        return Effort(growth, self.relocations, *(math.ceil(count * factor) for count in counts))

    def growing(self, strokes: int) -> int:
        """Iterations while so many strokes grow."""
        return min(self.growth.rounds, strokes) * self.growth.settling

    def free_iterations(self, strokes: int) -> int:
        """Iterations until so many strokes are where they are to be, in colours of their own."""
        return self.growing(strokes) + self.relocations * self.refining
