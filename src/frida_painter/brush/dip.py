"""How much one dip of a brush paints before the next one."""

from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from frida_painter.errors import ConfigError

_MOST = 1000


@dataclass(frozen=True)
class Dip:
    """What one dip is good for before the next one.

    holds: square metres that it paints, or where by_strokes a number of strokes, whatever their size.
    Raises ConfigError where that cannot be.
    """

    holds: float
    by_strokes: bool = False

    def __post_init__(self) -> None:
        least, most = (1, _MOST) if self.by_strokes else (0.0, 1.0)
        if not (least <= self.holds <= most and self.holds > 0):
            unit = "strokes" if self.by_strokes else "m2"
            raise ConfigError(f"A dip that holds {self.holds:g} {unit} was given; it is from {least:g} to {most:g}.")

    @classmethod
    def of_strokes(cls, count: int) -> Self:
        """One that is good for so many strokes."""
        return cls(float(count), by_strokes=True)

    def used_by(self, areas: Tensor) -> Tensor:
        """How much of it strokes use that paint these areas, m2 [n]."""
        return torch.ones_like(areas) if self.by_strokes else areas

    def __str__(self) -> str:
        return f"{self.holds:.0f} strokes" if self.by_strokes else f"{self.holds * 1e4:.1f} cm²"


def painted_area(length: Tensor, thickness: Tensor, width: float) -> Tensor:
    """What strokes paint, m2 [n]: their length times the width of a mark of their thickness."""
    return length * width * (0.25 + 0.75 * thickness)
