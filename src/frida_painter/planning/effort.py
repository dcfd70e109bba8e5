"""How much work a plan is worth."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from frida_painter.planning.binding import binding_iterations
from frida_painter.planning.initialize import Growth

_WHERE_A_LAYER_BEGINS = 3


@dataclass(frozen=True)
class Effort:
    """How many iterations are spent on what.

    growth: on the start; refining: joint steps after each of `relocations` rounds in which weak
    strokes move; drawing: steps after each round in which colours are drawn towards the paints;
    binding: steps once they are paints; rounds: in which strokes of several layers move to better places;
    settling: joint steps after each of them, and after each look; before_settling: which part of the effort each
    layer is grown with before that; polishing: last steps at full resolution; replanning: the same after
    each look. docs/lab/planning.md has the measurements.
    """

    growth: Growth = field(default_factory=Growth)
    relocations: int = 3
    refining: int = 25
    drawing: int = 20
    binding: int = 40
    rounds: int = 5
    settling: int = 40
    before_settling: float = 0.3
    polishing: int = 80
    replanning: int = 40

    def scaled(self, factor: float) -> "Effort":
        """The same effort with `factor` times as many iterations."""
        growth = Growth(self.growth.rounds, math.ceil(self.growth.settling * factor), self.growth.proposals)
        names = "refining", "drawing", "binding", "settling", "polishing", "replanning"
        counts = {name: math.ceil(getattr(self, name) * factor) for name in names}
        return replace(self, growth=growth, **counts)

    def judged_by_networks(self) -> "Effort":
        """The same for goals that networks judge: what they see is grown, and settled in fewer rounds."""
        return replace(self, rounds=min(self.rounds, 3), settling=self.refining, before_settling=0.6)

    def growing_of(self, layers: int) -> "Effort":
        """What each of so many layers is grown with: less where they are settled together afterwards."""
        return self if layers == 1 else self.scaled(self.before_settling)

    def growing(self, strokes: int) -> int:
        """Iterations while so many strokes grow."""
        return min(self.growth.rounds, strokes) * self.growth.settling

    def rounds_of(self, layers: int) -> int:
        """Rounds in which so many layers of a plan are settled together."""
        return self.rounds if layers > 1 else 0

    def planning(self, sizes: Sequence[int], *, new_paints: bool) -> int:
        """Iterations of a plan of layers of so many strokes, of which later ones have paints of their own or not."""
        effort = self.growing_of(len(sizes))
        mixing = binding_iterations(effort.drawing, effort.binding)
        later = mixing if new_paints else effort.binding
        settled = self.rounds_of(len(sizes)) * self.settling + self.polishing
        return sum(map(effort.free_iterations, sizes)) + mixing + later * (len(sizes) - 1) + settled

    def rounds_of_a_look(self, asked: int, *, fresh: bool) -> int:
        """Rounds in which the rest is planned again where so many are asked for; fresh: whether a layer begins."""
        return max(asked, min(_WHERE_A_LAYER_BEGINS, self.rounds)) if fresh else asked

    @property
    def of_a_look(self) -> int:
        """Iterations in which the rest is planned again, where nothing else is said."""
        return self.settling + self.replanning

    def free_iterations(self, strokes: int) -> int:
        """Iterations until so many strokes are where they are to be, in colours of their own."""
        return self.growing(strokes) + self.relocations * self.refining
