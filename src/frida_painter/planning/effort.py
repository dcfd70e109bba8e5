"""Effort of a plan: the numbers of iterations of its stages."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from frida_painter.planning.initialize import Growth
from frida_painter.planning.refine import binding_iterations

_WHERE_A_LAYER_BEGINS = 3


@dataclass(frozen=True)
class Effort:
    """Numbers of iterations and rounds of each stage; docs/lab/planning.md has the measurements.

    growth: growth of the start.
    relocations: rounds in which weak strokes move.
    refining: joint steps after each of these rounds.
    drawing: steps after each round that draws colours towards the paints.
    binding: steps after the colours have become paints.

    rounds: rounds in which strokes of several layers move to better places.
    settling: joint steps after each of these rounds, also in a replan.
    before_settling: factor of the effort for growing each layer before the rounds.
    polishing: last steps of a plan, at full resolution.
    replanning: last steps of a replan, at full resolution.
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

    def scale(self, factor: float) -> "Effort":
        """Returns this effort with `factor` times as many iterations."""
        growth = Growth(self.growth.rounds, math.ceil(self.growth.settling * factor), self.growth.proposals)
        names = "refining", "drawing", "binding", "settling", "polishing", "replanning"
        counts = {name: math.ceil(getattr(self, name) * factor) for name in names}
        return replace(self, growth=growth, **counts)

    def for_network_objectives(self) -> "Effort":
        """Returns the effort for goals that networks judge: more iterations for growth, fewer rounds of settling."""
        return replace(self, rounds=min(self.rounds, 3), settling=self.refining, before_settling=0.6)

    def growing_of(self, layers: int) -> "Effort":
        """Returns the effort for growing each of several layers: less if they are settled together afterwards."""
        return self if layers == 1 else self.scale(self.before_settling)

    def growing(self, strokes: int) -> int:
        """Number of iterations that grow this number of strokes."""
        return min(self.growth.rounds, strokes) * self.growth.settling

    def rounds_of(self, layers: int) -> int:
        """Number of rounds that settle this number of layers together; 0 for one layer."""
        return self.rounds if layers > 1 else 0

    def planning(self, sizes: Sequence[int], *, new_paints: bool) -> int:
        """Number of iterations of a plan with layers of these sizes.

        new_paints: True if later layers have palettes of their own.
        """
        effort = self.growing_of(len(sizes))
        mixing = binding_iterations(effort.drawing, effort.binding)
        later = mixing if new_paints else effort.binding
        settled = self.rounds_of(len(sizes)) * self.settling + self.polishing
        return sum(map(effort.free_iterations, sizes)) + mixing + later * (len(sizes) - 1) + settled

    def rounds_of_a_look(self, asked: int, *, fresh: bool) -> int:
        """Number of rounds of a replan.

        asked: smallest number of rounds.
        fresh: True if a layer begins; it gets at least 3 rounds, or `rounds` if that is fewer.
        """
        return max(asked, min(_WHERE_A_LAYER_BEGINS, self.rounds)) if fresh else asked

    @property
    def of_a_look(self) -> int:
        """Default number of iterations for a replan."""
        return self.settling + self.replanning

    def free_iterations(self, strokes: int) -> int:
        """Number of iterations that place this number of strokes, in colours of their own."""
        return self.growing(strokes) + self.relocations * self.refining
