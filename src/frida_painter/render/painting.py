"""From strokes to the picture they would paint: the stroke model, the frames and the compositing in one call."""

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

# Strokes as maps of their coverage, and the maps' places on a picture: what all renderers lay.


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


def composite(
    magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor, *, bare_cells_answer: bool = True
) -> Tensor:
    """Lays strokes over a canvas in order, by the fastest path for these tensors.

    magnitude: the strokes' magnitude maps [n, h, w] in [0, 1], zero outside
    affine:    from canvas pixels (column, row, 1) to map cells (column, row), [n, 2, 3]
    color:     sRGB [n, 3] in [0, 1]
    canvas:    what is there before, [3, H, W]
    bare_cells_answer: False where the maps come from a model whose bare cells stay bare, and so has
               no use for the gradient to them; the compiled path then leaves part of it out
    returns    the picture [3, H, W]; differentiable in all four.

    Tensors on the CPU go to compiled scanlines if numba is installed, those on a GPU to compiled tiles
    if Triton is; all others go to plain PyTorch, on their own device. All equal `reference.composite`.
    """
    if compiles_for(canvas):
        # Imported here because loading the compiler takes a second that a CUDA user need not pay.
        from frida_painter.render import scanline

        return scanline.composite(magnitude, affine, color, canvas, bare_cells_answer=bare_cells_answer)
    if _in_tiles(canvas):
        from frida_painter.render import tiles

        return tiles.composite(magnitude, affine, color, canvas, bare_cells_answer=bare_cells_answer)
    from frida_painter.render import plain

    return plain.composite(magnitude, affine, color, canvas)


def _in_tiles(canvas: Tensor) -> bool:
    """Whether strokes are laid by tile_kernels.py."""
    return canvas.device.type == "cuda" and find_spec("triton") is not None


def render(
    strokes: Strokes, stroke_model: StrokeModel, canvas: Tensor, size: CanvasSize, rows: Rows = ALL_ROWS
) -> Tensor:
    """The picture [3, H, W] that strokes leave on a canvas of that size which now looks like `canvas` [3, H, W].

    rows: which of its rows are rendered; then H of the picture is how many these are, and they equal those of the
    whole picture but for rounding.
    The resolution is that of `canvas`: hand in a larger one to print the same plan larger.
    Differentiable in the seven parameters of every stroke and in the canvas; where no gradient is
    asked for, nothing is kept, so that any size fits which the picture itself fits.
    """
    grid = PixelGrid(size, *canvas.shape[1:])
    marks = marks_of(strokes, stroke_model, grid, rows)
    # A table's maps are cut off at zero, where their slope is zero as well.
    answers = not isinstance(stroke_model, StrokeTable)
    return composite(*marks, strokes.color, rows.of(canvas), bare_cells_answer=answers)


class Moments(NamedTuple):
    """What a picture is on average, mean [3, H, W], and how much it varies about that, variance [H, W]; of sRGB.

    The variance is the mean of those of the three channels: no squared error needs to know more.
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
    """Lays strokes of uncertain coverage over a canvas in order, by the fastest path for these tensors.

    As `composite`, `magnitude` being the mean coverage and `spread` how its variance follows from that; variance
    [H, W]: that of the canvas, None where it is certain. Equals `reference.composite_moments`.
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
    """Mean [3, H, W] and variance [H, W] of the picture that strokes leave, as `render` draws it.

    spread: of the marks' coverage, from stroke to stroke. Where they do not vary, the mean is `render`'s picture.
    rows: which rows are rendered, as `render` says.
    """
    if spread.share == 0:
        picture = render(strokes, stroke_model, canvas, size, rows)
        return Moments(picture, torch.zeros_like(picture[0]))
    grid = PixelGrid(size, *canvas.shape[1:])
    marks = marks_of(strokes, stroke_model, grid, rows)
    answers = not isinstance(stroke_model, StrokeTable)
    return composite_moments(*marks, strokes.color, rows.of(canvas), spread, bare_cells_answer=answers)


# A plan as a picture of any size.

LEAST_ROWS, MOST_ROWS = 16, 10_000


def render_on(plan: Plan, models: Mapping[str, StrokeModel], canvas: Tensor) -> Tensor:
    """The picture [3, H, W] that a plan leaves on a canvas of its size which now looks like `canvas` [3, H, W].

    models: what the marks of its brushes look like, by their names.
    """
    with torch.no_grad():
        for part in plan.filled_layers():
            canvas = render(part.strokes, models[part.layers[0].brush], canvas, plan.canvas)
    return canvas


def render_plan(plan: Plan, height: int = 1080, models: Mapping[str, StrokeModel] | None = None) -> Tensor:
    """The picture [3, height, W] that a plan paints on its bare canvas, as the simulation of its brushes sees it.

    models: what their marks look like, by their names; by default the models that they have. Raises ConfigError unless
    height is from 16 to 10000 pixels, and WeightsError where a brush of the plan has no model here.
    """
    if not LEAST_ROWS <= height <= MOST_ROWS:
        raise ConfigError(f"A picture {height} pixels high was asked for; it is from {LEAST_ROWS} to {MOST_ROWS} high.")
    grid = PixelGrid.of_height(plan.canvas, height)
    ground = torch.tensor(plan.ground)[:, None, None].expand(3, grid.rows, grid.columns).contiguous()
    return render_on(plan, models or load_stroke_models(plan.brushes), ground)
