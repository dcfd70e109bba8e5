"""What a stroke model is: from the shape of a stroke to the mark that it leaves."""

from typing import Protocol

from torch import Tensor

from frida_painter.frames import MapFrame
from frida_painter.strokes import StrokeLimits


class StrokeModel(Protocol):
    """Maps (thickness, length, bend) to magnitude maps; differentiable in all three.

    frame says where the map lies around the stroke's start, limits what the brush can do, and
    brush which one it is.
    """

    @property
    def brush(self) -> str:
        """Name of the brush."""

    @property
    def frame(self) -> MapFrame:
        """Where a map lies around the start of its stroke."""

    @property
    def limits(self) -> StrokeLimits:
        """What lengths and bends the brush can paint."""

    def __call__(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """thickness [n] in [0, 1], length [n] and bend [n] in metres -> magnitude [n, rows, columns] in [0, 1]."""
