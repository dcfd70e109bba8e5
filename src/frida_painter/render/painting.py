"""Rendering of strokes and plans: stroke model, frames and compositing in one call."""

from collections.abc import Mapping
from importlib.util import find_spec
from typing import NamedTuple

import torch
from torch import Tensor

from frida_painter.brush.kinds import CoverageSpread, StrokeModel
from frida_painter.brush.table import StrokeTable
from frida_painter.brush.weights import load_stroke_models
from frida_painter.canvas_size import CanvasSize
from frida_painter.compiled import compiles_for
from frida_painter.errors import ConfigError
from frida_painter.frames import ALL_ROWS, PixelGrid, Rows, pixel_to_map
from frida_painter.plan import Plan
from frida_painter.strokes import Strokes

# Marks: coverage maps of strokes with their places on the picture; the input of all renderers


class Marks(NamedTuple):
    """Coverage maps of strokes and their places on a picture.

    magnitude [n, h, w]: coverage in [0, 1], zero outside; whole maps of the stroke model, or windows with all paint
    affine [n, 2, 3]: maps from picture pixels to cells, as from `pixel_to_map`
    """

    magnitude: Tensor
    affine: Tensor


def marks_of(strokes: Strokes, model: StrokeModel, grid: PixelGrid, rows: Rows = ALL_ROWS) -> Marks:
    """Returns the marks of strokes on these rows of a picture. Differentiable in the strokes."""
    affine = pixel_to_map(strokes.position, strokes.angle, grid, model.frame, rows)
    if not isinstance(model, StrokeTable):
        return Marks(model(strokes.thickness, strokes.length, strokes.bend), affine)
    magnitude, shift = model.windows(strokes.thickness, strokes.length, strokes.bend)
    return Marks(magnitude, affine - shift)


def composite(
    magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor, *, bare_cells_answer: bool = True
) -> Tensor:
    """Paints strokes in order on a canvas, by the fastest method for these tensors.

    magnitude [n, h, w]: coverage maps in [0, 1], zero outside
    affine [n, 2, 3]: maps from canvas pixels (column, row, 1) to map cells (column, row)
    color [n, 3]: sRGB in [0, 1]
    canvas [3, H, W]: picture before the strokes
    bare_cells_answer: False if cells without paint need no gradient, because the stroke model keeps them at
    zero. The compiled methods then skip a part of it.
    Returns the picture [3, H, W]. Differentiable in all four tensors.

    CPU tensors use compiled scanlines if numba is installed. CUDA tensors use compiled tiles if Triton is
    installed. All other tensors use PyTorch on their device. All methods equal `reference.composite`.
    """
    if compiles_for(canvas):
        # Imported here because the compiler takes a second to load, which CUDA users do not need.
        from frida_painter.render import scanline

        return scanline.composite(magnitude, affine, color, canvas, bare_cells_answer=bare_cells_answer)
    if _in_tiles(canvas):
        from frida_painter.render import tiles

        return tiles.composite(magnitude, affine, color, canvas, bare_cells_answer=bare_cells_answer)
    from frida_painter.render import plain

    return plain.composite(magnitude, affine, color, canvas)


def _in_tiles(canvas: Tensor) -> bool:
    """Returns True if tile_kernels.py paints the strokes."""
    return canvas.device.type == "cuda" and find_spec("triton") is not None


def render(
    strokes: Strokes, stroke_model: StrokeModel, canvas: Tensor, size: CanvasSize, rows: Rows = ALL_ROWS
) -> Tensor:
    """Renders strokes on a canvas and returns the picture that they leave, [3, H, W].

    canvas [3, H, W]: picture of the canvas before the strokes; it sets the resolution
    size: size of the canvas
    rows: rows to render, by default all. The result then has only these rows, equal to those of the whole
    picture except for rounding.

    Differentiable in the seven parameters of each stroke and in the canvas. Without gradients nothing else is
    stored, so memory limits only the picture itself.
    """
    grid = PixelGrid(size, *canvas.shape[1:])
    marks = marks_of(strokes, stroke_model, grid, rows)
    # Maps of a table are clipped at zero; their gradient is zero there as well.
    answers = not isinstance(stroke_model, StrokeTable)
    return composite(*marks, strokes.color, rows.of(canvas), bare_cells_answer=answers)


class Moments(NamedTuple):
    """Mean [3, H, W] and variance [H, W] of a picture in sRGB.

    The variance is the mean over the three channels, which is enough for squared errors.
    """

    mean: Tensor
    variance: Tensor


def composite_moments(
    magnitude: Tensor,
    affine: Tensor,
    color: Tensor,
    canvas: Tensor,
    spread: CoverageSpread,
    variance: Tensor | None = None,
    *,
    bare_cells_answer: bool = True,
) -> Moments:
    """Paints strokes of uncertain coverage in order on a canvas, by the fastest method for these tensors.

    Tensors as in `composite`, but `magnitude` is the mean coverage.
    spread: variance of the coverage as a function of its mean
    variance [H, W]: variance of the canvas; None for zero
    Equals `reference.composite_moments`.
    """
    if compiles_for(canvas):
        from frida_painter.render import scanline

        given = magnitude, affine, color, canvas, spread, variance
        return Moments(*scanline.composite_moments(*given, bare_cells_answer=bare_cells_answer))
    if _in_tiles(canvas):
        from frida_painter.render import tiles

        given = magnitude, affine, color, canvas, spread, variance
        return Moments(*tiles.composite_moments(*given, bare_cells_answer=bare_cells_answer))
    from frida_painter.render import plain

    return Moments(*plain.composite_moments(magnitude, affine, color, canvas, spread, variance))


def render_moments(
    strokes: Strokes,
    stroke_model: StrokeModel,
    canvas: Tensor,
    size: CanvasSize,
    spread: CoverageSpread,
    rows: Rows = ALL_ROWS,
) -> Moments:
    """Renders mean [3, H, W] and variance [H, W] of the picture, like `render`.

    spread: variance of the coverage from stroke to stroke. Without variance the mean is the picture of `render`.
    rows: rows to render, as in `render`
    """
    if spread.share == 0:
        picture = render(strokes, stroke_model, canvas, size, rows)
        return Moments(picture, torch.zeros_like(picture[0]))
    grid = PixelGrid(size, *canvas.shape[1:])
    marks = marks_of(strokes, stroke_model, grid, rows)
    answers = not isinstance(stroke_model, StrokeTable)
    return composite_moments(*marks, strokes.color, rows.of(canvas), spread, bare_cells_answer=answers)


# Plans as pictures of any size

MIN_ROWS, MAX_ROWS = 16, 10_000


def render_on(plan: Plan, models: Mapping[str, StrokeModel], canvas: Tensor) -> Tensor:
    """Renders a plan on a canvas and returns the picture that it leaves, [3, H, W], without gradients.

    models: stroke models by brush
    canvas [3, H, W]: picture of the canvas before the strokes
    """
    with torch.no_grad():
        for part in plan.filled_layers():
            canvas = render(part.strokes, models[part.layers[0].brush], canvas, plan.canvas)
    return canvas


def render_plan(plan: Plan, height: int = 1080, models: Mapping[str, StrokeModel] | None = None) -> Tensor:
    """Renders a plan on its bare canvas as a picture [3, height, W].

    height: from 16 to 10000 pixels
    models: stroke models by brush; by default those that ship with the brushes
    Raises ConfigError if the height is out of range, and WeightsError if a brush has no stroke model.
    """
    if not MIN_ROWS <= height <= MAX_ROWS:
        raise ConfigError(f"A picture {height} pixels high was asked for; it is from {MIN_ROWS} to {MAX_ROWS} high.")
    grid = PixelGrid.of_height(plan.canvas, height)
    ground = torch.tensor(plan.ground)[:, None, None].expand(3, grid.rows, grid.columns).contiguous()
    return render_on(plan, models or load_stroke_models(plan.brushes), ground)
