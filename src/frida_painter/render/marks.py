"""Strokes as maps of their coverage, and the maps' places on a picture: what all renderers lay."""

from typing import NamedTuple

from torch import Tensor

from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.brush.table import StrokeTable
from frida_painter.frames import ALL_ROWS, PixelGrid, Rows, pixel_to_map
from frida_painter.strokes import Strokes


class Marks(NamedTuple):
    """Magnitude [n, h, w] in [0, 1], zero outside, and from a picture's pixels to its cells, [n, 2, 3].

    The latter as `pixel_to_map` tells it. Maps are those of the stroke model, or parts of them that hold all paint.
    """

    magnitude: Tensor
    affine: Tensor


def marks_of(strokes: Strokes, model: StrokeModel, grid: PixelGrid, rows: Rows = ALL_ROWS) -> Marks:
    """The marks that a model's brush makes of strokes on those rows of a picture; differentiable in the strokes."""
    affine = pixel_to_map(strokes.position, strokes.angle, grid, model.frame, rows)
    if not isinstance(model, StrokeTable):
        return Marks(model(strokes.thickness, strokes.length, strokes.bend), affine)
    magnitude, shift = model.windows(strokes.thickness, strokes.length, strokes.bend)
    return Marks(magnitude, affine - shift)
