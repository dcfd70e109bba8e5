"""Effort of a plan: the numbers of iterations of its stages."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

DRAWING = (0.7, 0.45, 0.2, 0.1)
"""Share of the way from a stroke's colour to its paint that each round of drawing colours together leaves."""


@dataclass(frozen=True)
class Effort:
    """Numbers of iterations and rounds of each stage; docs/lab/planning.md has the measurements.

    growing: rounds in which strokes are placed, each larger than the one before.
    growing_together: joint steps after each of these rounds.
    proposals: proposals weighed for each placed stroke.
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

    growing: int = 8
    growing_together: int = 25
    proposals: int = 12
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
        names = "growing_together", "refining", "drawing", "binding", "settling", "polishing", "replanning"
        return replace(self, **{name: math.ceil(getattr(self, name) * factor) for name in names})

    def for_network_objectives(self) -> "Effort":
        """Returns the effort for goals that networks judge: more iterations for growth, fewer rounds of settling."""
        return replace(self, rounds=min(self.rounds, 3), settling=self.refining, before_settling=0.6)

    def growing_of(self, layers: int) -> "Effort":
        """Returns the effort for growing each of several layers: less if they are settled together afterwards."""
        return self if layers == 1 else self.scale(self.before_settling)

    def rounds_of(self, layers: int) -> int:
        """Number of rounds that settle this number of layers together; 0 for one layer."""
        return self.rounds if layers > 1 else 0

    def planning(self, sizes: Sequence[int], *, new_paints: bool) -> int:
        """Number of iterations of a plan with layers of these sizes.

        new_paints: True if later layers have palettes of their own.
        """
        effort = self.growing_of(len(sizes))
        free = [min(effort.growing, size) * effort.growing_together for size in sizes]
        free += [effort.relocations * effort.refining] * len(sizes)
        mixing = len(DRAWING) * effort.drawing + effort.binding
        later = mixing if new_paints else effort.binding
        settled = self.rounds_of(len(sizes)) * self.settling + self.polishing
        return sum(free) + mixing + later * (len(sizes) - 1) + settled
