"""A stroke model that is only a function: from the shapes of strokes to their magnitude maps."""

from collections.abc import Callable

from torch import Tensor

from frida_painter.brush.kinds import BrushKind
from frida_painter.errors import ConfigError
from frida_painter.frames import MapFrame
from frida_painter.strokes import StrokeLimits


class StrokeFunction:
    """Implements brush.stroke_model.StrokeModel by a function of (thickness, length, bend), for a brush.

    kind: the brush, with its limits; function: takes three tensors [n], thickness in [0, 1], length and bend
    in metres, and returns magnitudes [n, rows, columns] in [0, 1] over the cells of `frame`; frame: where a map
    lies around the start of its stroke, by default the brush's own. The function need not be differentiable:
    while a plan is optimised, a table stands in for it (brush/table.py).
    """

    def __init__(
        self, kind: BrushKind, function: Callable[[Tensor, Tensor, Tensor], Tensor], frame: MapFrame | None = None
    ) -> None:
        self.kind, self.function = kind, function
        self._frame = frame or kind.frame

    @property
    def brush(self) -> str:
        """Name of the brush."""
        return self.kind.name

    @property
    def frame(self) -> MapFrame:
        """Where a map lies around the start of its stroke."""
        return self._frame

    @property
    def limits(self) -> StrokeLimits:
        """What lengths and bends the brush can paint."""
        return self.kind.limits

    def __call__(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """The function's maps [n, rows, columns]. Raises ConfigError where they are of another shape or range."""
        maps = self.function(thickness, length, bend)
        wanted = (len(length), self._frame.rows, self._frame.columns)
        if tuple(maps.shape) != wanted:
            raise ConfigError(
                f"The stroke model of brush {self.brush!r} gave maps of shape {tuple(maps.shape)}; its function has to "
                f"return {wanted}, one map of rows and columns for each stroke."
            )
        if maps.numel():
            least, most = (float(value) for value in maps.detach().aminmax())
            if not (0 <= least <= most <= 1):
                raise ConfigError(
                    f"The stroke model of brush {self.brush!r} gave magnitudes from {least:g} to {most:g}; its "
                    "function has to keep them from 0, bare paper, to 1, covered."
                )
        return maps
