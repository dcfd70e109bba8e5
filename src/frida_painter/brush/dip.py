"""How much one dip of a brush paints before the next one."""

from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from frida_painter.errors import ConfigError

_MOST = 1000
_STAYS_FULL = 0.3  # of what a dip paints; after that marks fade evenly


@dataclass(frozen=True)
class Dip:
    """What one dip is good for before the next one.

    holds: square metres that it paints, or where by_strokes a number of strokes, whatever their size; fades: the share
    of their paint that marks lack at its end, from 0 to 1. Raises ConfigError where that cannot be.
    """

    holds: float
    by_strokes: bool = False
    fades: float = 0.0

    def __post_init__(self) -> None:
        least, most = (1, _MOST) if self.by_strokes else (0.0, 1.0)
        if not (least <= self.holds <= most and self.holds > 0):
            unit = "strokes" if self.by_strokes else "m2"
            raise ConfigError(f"A dip that holds {self.holds:g} {unit} was given; it is from {least:g} to {most:g}.")
        if not 0 <= self.fades <= 1:
            raise ConfigError(f"A dip that fades by {self.fades:g} was given; it is from 0 to 1.")

    @classmethod
    def of_strokes(cls, count: int) -> Self:
        """One that is good for so many strokes."""
        return cls(float(count), by_strokes=True)

    def used_by(self, areas: Tensor) -> Tensor:
        """How much of it strokes use that paint these areas, m2 [n]."""
        return torch.ones_like(areas) if self.by_strokes else areas

    def lacking(self, left: float, use: float) -> float:
        """The share of its paint that a mark lacks in its middle, which uses so much of what is left of the dip."""
        spent = 1 - (left - use / 2) / self.holds
        return min(1.0, self.fades * max(0.0, spent - _STAYS_FULL) / (1 - _STAYS_FULL))

    def until(self, lacking: float) -> Self:
        """The dip as it is where the brush is dipped again before marks lack more than that share of their paint."""
        if self.fades <= lacking:
            return self
        share = _STAYS_FULL + (1 - _STAYS_FULL) * lacking / self.fades
        return replace(self, holds=max(share * self.holds, float(self.by_strokes)), fades=lacking)

    def __str__(self) -> str:
        return f"{self.holds:.0f} strokes" if self.by_strokes else f"{self.holds * 1e4:.1f} cm²"


def painted_area(length: Tensor, thickness: Tensor, width: float) -> Tensor:
    """What strokes paint, m2 [n]: their length times the width of a mark of their thickness."""
    return length * width * (0.25 + 0.75 * thickness)
