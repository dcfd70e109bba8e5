"""Rendering of strokes and plans: stroke model, frames and compositing in one call."""

import io
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from PIL import Image
from torch import Tensor, nn

from frida_painter.brush.kinds import CoverageSpread, StrokeModel, growth_of, spread_of
from frida_painter.brush.table import StrokeTable, cached_table
from frida_painter.brush.weights import AnyBrush, load_models_of, load_stroke_model, weights_of
from frida_painter.canvas_size import AnyCanvas, CanvasSize
from frida_painter.errors import ConfigError, PlanError
from frida_painter.frames import ALL_ROWS, PixelGrid, Rows, pixel_to_map, scale_maps
from frida_painter.render import reference
from frida_painter.render.exporter import ExporterKind, ExportOptions
from frida_painter.strokes.family import describe_families
from frida_painter.strokes.palette import AnyColor, as_color
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import Strokes
from frida_painter.system.devices import compiles_for
from frida_painter.system.images import AnyPicture, as_picture, to_uint8

# Marks: coverage maps of strokes with their places on the picture; the input of all renderers


class Marks(NamedTuple):
    """Coverage maps of strokes and their places on a picture.

    magnitude [n, h, w]: coverage in [0, 1], zero outside; whole maps of the stroke model, or windows with all paint
    affine [n, 2, 3]: maps from picture pixels to cells, as from `pixel_to_map`
    """

    magnitude: Tensor
    affine: Tensor


def marks_of(strokes: Strokes, model: StrokeModel, grid: PixelGrid, rows: Rows = ALL_ROWS) -> Marks:
    """Returns the marks of strokes of one kind on these rows of a picture. Differentiable in the strokes.

    Raises PlanError if the strokes belong to another family than the model.
    """
    families = () if strokes.taught is None else strokes.taught.families
    known = () if model.limits.family is None else (model.limits.family,)
    if len(strokes) and families != known:
        raise PlanError(
            f"Strokes of {describe_families(families)} were given to a stroke model of {describe_families(known)}; "
            "plan anew with that family."
        )
    affine = pixel_to_map(strokes.position, strokes.angle, grid, model.frame, rows)
    growth, shape = growth_of(model, strokes.length), strokes.shape
    if len(strokes) == 0 and model.limits.family is not None:
        shape = strokes.angle.new_zeros(0, model.limits.family.codes)
    if growth is not None:
        affine = scale_maps(affine, model.frame, growth)
    given = strokes.thickness, strokes.length, shape
    if isinstance(model, StrokeTable):
        magnitude, shift = model.windows(*given)
        return Marks(magnitude, affine - shift)
    return Marks(model(*given), affine)


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

    CPU tensors use compiled scanlines. CUDA tensors use compiled tiles if Triton is installed. All other tensors use
    `reference.composite`, which the others equal, on their device: much slower.
    """
    given = magnitude, affine, color, canvas
    picture: Tensor = _find_renderer(canvas).composite(*given, bare_cells_answer=bare_cells_answer)
    return picture


def _find_renderer(canvas: Tensor) -> Any:
    """Returns the module that paints strokes fastest on this canvas; each loads its compiler at its first use."""
    if compiles_for(canvas):
        from frida_painter.render import scanline

        return scanline
    if canvas.device.type == "cuda" and find_spec("triton") is not None:
        from frida_painter.render import tiles

        return tiles
    return reference


def render(
    strokes: Strokes, stroke_model: StrokeModel, canvas: Tensor, size: CanvasSize, rows: Rows = ALL_ROWS
) -> Tensor:
    """Renders strokes on a canvas and returns the picture that they leave, [3, H, W].

    canvas [3, H, W]: picture of the canvas before the strokes; it sets the resolution
    size: size of the canvas
    rows: rows to render, by default all. The result then has only these rows, equal to those of the whole
    picture except for rounding.

    Differentiable in the seven parameters of each stroke and in the canvas. Without gradients nothing else is
    stored, so memory limits only the picture itself. The arguments are not converted; `render_strokes` does that.
    """
    marks = marks_of(strokes, stroke_model, PixelGrid(size, *canvas.shape[1:]), rows)
    # Maps of a table are clipped at zero; their gradient is zero there as well.
    answers = not isinstance(stroke_model, StrokeTable)
    return composite(*marks, strokes.color, rows.of(canvas), bare_cells_answer=answers)


def render_strokes(
    strokes: Strokes,
    stroke_model: AnyBrush,
    canvas: AnyPicture,
    size: AnyCanvas,
    rows: Rows = ALL_ROWS,
    *,
    exact: bool = False,
) -> Tensor:
    """Renders strokes on a canvas and returns the picture that they leave, [3, H, W].

    stroke_model: brush, such as "broad", or a model, which is asked itself
    canvas: picture of the canvas before the strokes; it sets the resolution
    size: size of the canvas, such as "14x11in"
    rows: rows to render, by default all. The result then has only these rows.
    exact: True to ask the network of a named brush, some hundred times slower than its table

    Differentiable in the seven parameters of each stroke and in the canvas. It is computed in the precision of the
    stroke model. Raises ImageError, ConfigError and WeightsError.

        >>> import frida_painter as fp, torch
        >>> one, color = torch.ones(1), torch.tensor([[0.8, 0.1, 0.1]], requires_grad=True)
        >>> strokes = fp.Strokes(torch.tensor([[0.03, 0.05]]), 0 * one, 0.04 * one, 0 * one, 0.5 * one, color)
        >>> picture = fp.render_strokes(strokes, "fine", torch.ones(3, 90, 120), "12x9cm")
        >>> picture.mean().backward()
        >>> picture.shape, bool(color.grad.min() > 0)
        (torch.Size([3, 90, 120]), True)
    """
    model, below = _find_model(stroke_model, exact), as_picture(canvas)
    kind = _precision_of(model, below.dtype)
    return render(strokes.to(kind), model, below.to(kind), CanvasSize.of(size), rows)


def _find_model(brush: AnyBrush, exact: bool) -> StrokeModel:
    """Returns the stroke model of a brush; of a name or a file, unless `exact`, the table that the planner uses."""
    if exact or not isinstance(brush, str | Path):
        return load_stroke_model(brush)
    return _read_table(str(brush), *(path.stat().st_mtime_ns for path in weights_of(str(brush)) if path.exists()))


@cache
def _read_table(brush: str, *changed: int) -> StrokeTable:
    """Returns the table of a brush. changed: times at which its files of weights changed."""
    return cached_table(load_stroke_model(brush))


def _precision_of(model: StrokeModel, default: torch.dtype) -> torch.dtype:
    """Returns the precision in which a stroke model computes: that of its weights, if it has any."""
    weights = chain(model.parameters(), model.buffers()) if isinstance(model, nn.Module) else ()
    return next((part.dtype for part in weights if part.is_floating_point()), default)


class RenderedBatch(NamedTuple):
    """Pictures of b lists of strokes; without the first dimension for one list.

    picture [b, 3, H, W]: expected picture
    variance [b, H, W]: variance of its pixels, because no two marks of one stroke are the same
    alpha [b, H, W]: share of each pixel that is covered with paint, in [0, 1]
    """

    picture: Tensor
    variance: Tensor
    alpha: Tensor


def render_batch(
    brush: AnyBrush,
    strokes: Strokes | Sequence[Strokes],
    canvas: AnyCanvas = "14x11in",
    *,
    rows: int = 256,
    ground: AnyColor | AnyPicture = "white",
    exact: bool = False,
) -> RenderedBatch:
    """Renders strokes, or each of several lists of strokes, on a canvas: picture, variance and coverage.

    brush, exact: as in `render_strokes`
    strokes: one list of strokes, or a list of them, which may differ in length
    canvas: size of the canvas
    rows: height of the pictures in pixels, from 16 to 10000
    ground: colour of the bare canvas, or a picture [3, H, W] of the canvas, which sets the resolution

    Differentiable in the strokes. Raises ConfigError, ImageError and WeightsError.

        >>> import frida_painter as fp, torch
        >>> strokes = fp.Strokes.from_array([[0.02, 0.05, 0.0, 0.04, 0.0, 0.5, 0.8, 0.1, 0.1]])
        >>> one = fp.render_batch("broad", strokes, "12x9cm", rows=90)
        >>> several = fp.render_batch("broad", [strokes, strokes[:0]], "12x9cm", rows=90)
        >>> one.picture.shape, several.variance.shape, float(several.alpha[1].max())
        (torch.Size([3, 90, 120]), torch.Size([2, 90, 120]), 0.0)
    """
    model, size = _find_model(brush, exact), CanvasSize.of(canvas)
    if not isinstance(strokes, Strokes):
        if not strokes or not all(isinstance(one, Strokes) for one in strokes):
            raise PlanError("A batch of strokes is a list of Strokes, and at least one; give [strokes, strokes].")
        made = [render_batch(model, one, size, rows=rows, ground=ground) for one in strokes]
        return RenderedBatch(*(torch.stack(part) for part in zip(*made, strict=True)))
    if _is_picture(ground):
        below = as_picture(cast(AnyPicture, ground))
    else:
        below = _toned(as_color(cast(AnyColor, ground)), size, rows)
    kind = _precision_of(model, below.dtype)
    given, below = strokes.to(kind), below.to(kind).to(strokes.length.device)
    moments = render_moments(given, model, below, size, spread_of(model))
    black = given.with_groups(color=torch.zeros_like(given.color))
    bare = render(black, model, torch.ones_like(below), size)[0]
    return RenderedBatch(*moments, 1 - bare)


def _is_picture(ground: AnyColor | AnyPicture) -> bool:
    """Returns True for a picture of a canvas, False for a colour."""
    if isinstance(ground, str):
        return bool(Path(ground).suffix)
    return isinstance(ground, Path | Image.Image) or (isinstance(ground, Tensor | np.ndarray) and ground.ndim > 1)


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
    given = magnitude, affine, color, canvas, spread, variance
    return Moments(*_find_renderer(canvas).composite_moments(*given, bare_cells_answer=bare_cells_answer))


def render_moments(
    strokes: Strokes,
    stroke_model: StrokeModel,
    canvas: Tensor,
    size: CanvasSize,
    spread: CoverageSpread,
    rows: Rows = ALL_ROWS,
    variance: Tensor | None = None,
) -> Moments:
    """Renders mean [3, H, W] and variance [H, W] of the picture, like `render`.

    spread: variance of the coverage from stroke to stroke. Without variance the mean is the picture of `render`.
    rows: rows to render, as in `render`
    variance: variance of the canvas on these rows; None for zero
    """
    if spread.share == 0:
        picture = render(strokes, stroke_model, canvas, size, rows)
        return Moments(picture, torch.zeros_like(picture[0]))
    marks = marks_of(strokes, stroke_model, PixelGrid(size, *canvas.shape[1:]), rows)
    answers = not isinstance(stroke_model, StrokeTable)
    return composite_moments(*marks, strokes.color, rows.of(canvas), spread, variance, bare_cells_answer=answers)


# Plans as pictures of any size

MIN_ROWS, MAX_ROWS = 16, 10_000
_NOTEBOOK_ROWS = 360


def render_on(plan: Plan, models: Mapping[str, StrokeModel], canvas: Tensor) -> Tensor:
    """Renders a plan on a canvas and returns the picture that it leaves, [3, H, W], without gradients.

    models: stroke models by the kind of strokes (`Layer.kind`)
    canvas [3, H, W]: picture of the canvas before the strokes
    """
    with torch.no_grad():
        for part in plan.filled_layers():
            canvas = render(part.strokes, models[part.layers[0].kind], canvas, plan.canvas)
    return canvas


def render_plan(plan: Plan | str | Path, height: int = 1080, models: Mapping[str, AnyBrush] | None = None) -> Tensor:
    """Renders a plan on its bare canvas as a picture [3, height, W].

    plan: a plan, its file, or the folder of a painting
    height: from 16 to 10000 pixels
    models: brushes by the kind of strokes; by default those that ship with the project
    Raises ConfigError if the height is out of range, and WeightsError if a brush has no stroke model.

        >>> import frida_painter as fp
        >>> plan = fp.make_planner("photo.jpg", canvas="12x9cm", strokes=5, render_height=64).plan()
        >>> fp.render_plan(plan, height=90).shape[1]
        90
    """
    plan = plan if isinstance(plan, Plan) else Plan.load(plan)
    ground = _toned(plan.ground, plan.canvas, height)
    known = {kind: load_stroke_model(brush) for kind, brush in (models or {}).items()}
    return render_on(plan, known or load_models_of(plan), ground)


def _toned(color: tuple[float, float, float], size: CanvasSize, height: int) -> Tensor:
    """Returns the picture [3, height, W] of a bare canvas in that colour. Raises ConfigError."""
    if not MIN_ROWS <= height <= MAX_ROWS:
        raise ConfigError(f"A picture {height} pixels high was asked for; it is from {MIN_ROWS} to {MAX_ROWS} high.")
    grid = PixelGrid.of_height(size, height)
    return torch.tensor(color)[:, None, None].expand(3, grid.rows, grid.columns).contiguous()


def _draw_png(plan: Plan, options: ExportOptions) -> bytes:
    """Returns a plan as a PNG file, as a notebook shows it. Raises WeightsError."""
    content = io.BytesIO()
    Image.fromarray(to_uint8(render_plan(plan, _NOTEBOOK_ROWS))).save(content, format="PNG")
    return content.getvalue()


PNG = ExporterKind("png", "A picture of the plan.", _draw_png)
