"""Renderer for a GPU: one program for each tile of the canvas paints all strokes in order.

Equals `reference.composite` and `reference.composite_moments`. The host never waits for the device: for
example, it does not ask how many pixels a stroke covers. The kernels are in tile_kernels.py and need Triton,
which comes with PyTorch for CUDA. See docs/explanation/renderer.md.
"""

import math
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from frida_painter.brush.kinds import CERTAIN, CoverageSpread
from frida_painter.render import tile_kernels

TILE = 16
"""Rows and columns of a tile, in pixels."""
_BINS = 32  # the lists of a canvas then take little memory
_MARGIN = 2.0**61  # limit for integer sums of gradients


def composite(
    magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor, *, bare_cells_answer: bool = True
) -> Tensor:
    """Paints strokes in order on a canvas, as `painting.composite`."""
    tensors = magnitude, affine, color, canvas
    return composite_moments(*tensors, CERTAIN, bare_cells_answer=bare_cells_answer)[0]


def composite_moments(
    magnitude: Tensor,
    affine: Tensor,
    color: Tensor,
    canvas: Tensor,
    spread: CoverageSpread,
    variance: Tensor | None = None,
    *,
    bare_cells_answer: bool = True,
) -> tuple[Tensor, Tensor]:
    """Paints strokes of mean coverage `magnitude` in order on a canvas, as `reference.composite_moments`.

    Tensors as in `reference.composite`. Differentiable once in all five tensors. Gradients are integer sums, so
    they have the same bits each time.
    """
    magnitude, affine, color = magnitude.to(canvas.dtype), affine.to(canvas.dtype), color.to(canvas.dtype)
    variance = torch.zeros_like(canvas[0]) if variance is None else variance
    if len(magnitude) == 0:
        return canvas.clone(), variance.clone()
    moments = torch.cat((canvas, variance[None]))
    tensors = magnitude.contiguous(), affine.contiguous(), color.contiguous(), moments
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in tensors):
        apply: Callable[..., tuple[Tensor, Tensor]] = _Tiles.apply
        return apply(*tensors, spread, bare_cells_answer)
    return _lay(*tensors, _boxes(tensors[0], tensors[1], canvas, bare=False), spread, kept=None)


class _Tiles(torch.autograd.Function):
    """`composite_moments` with gradients. Of the moments on the way, it keeps those below each sqrt(n)-th stroke."""

    @staticmethod
    def forward(
        ctx: Any,
        magnitude: Tensor,
        affine: Tensor,
        color: Tensor,
        canvas: Tensor,  # mean and variance, [4, H, W]
        spread: CoverageSpread,
        bare_cells_answer: bool,
    ) -> tuple[Tensor, Tensor]:
        tensors = magnitude, affine, color, canvas
        ctx.spread, ctx.bare = spread, bare_cells_answer and ctx.needs_input_grad[0]
        boxes = _boxes(magnitude, affine, canvas, bare=ctx.bare)
        segments = -(-len(magnitude) // _segment(len(magnitude)))
        kept = canvas.new_empty(segments, 4, *canvas.shape[1:])
        ctx.save_for_backward(*tensors, boxes, kept)
        return _lay(*tensors, boxes, spread, kept)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, of_mean: Tensor, of_variance: Tensor) -> tuple[Tensor | None, ...]:
        magnitude, affine, color, canvas, boxes, kept = ctx.saved_tensors
        n, rows, columns = magnitude.shape
        _, height, width = canvas.shape
        gradients = torch.cat((of_mean, of_variance[None])).contiguous()
        scale = _scale(magnitude, affine, color, canvas, gradients)
        counts, lists, side, across = _bins(boxes, canvas)
        to_maps = torch.zeros_like(magnitude, dtype=torch.int64)
        to_strokes = torch.zeros(n, 9, dtype=torch.int64, device=canvas.device)
        to_canvas = torch.empty_like(canvas)
        states = canvas.new_empty(_segment(n), 4, height, width)
        tile_kernels.pull[_grid(canvas)](
            magnitude, affine, color, boxes, counts, lists, _numbers(ctx.spread, canvas), kept, states, gradients,
            scale, to_maps, to_strokes, to_canvas,
            n, side, across, height, width, rows, columns, _segment(n), len(kept),
            BARE_ANSWERS=ctx.bare, ROWS=TILE, COLUMNS=TILE,
        )  # fmt: skip
        summed = to_strokes.to(canvas.dtype) / scale
        every = to_maps.to(canvas.dtype) / scale, summed[:, :6].reshape(n, 2, 3), summed[:, 6:], to_canvas
        wanted = (part if wants else None for part, wants in zip(every, ctx.needs_input_grad, strict=False))
        return *wanted, None, None


def _lay(
    magnitude: Tensor,
    affine: Tensor,
    color: Tensor,
    canvas: Tensor,
    boxes: Tensor,
    spread: CoverageSpread,
    kept: Tensor | None,
) -> tuple[Tensor, Tensor]:
    """Returns the moments; writes those below the first stroke of each segment to kept [segments, 4, H, W]."""
    n, rows, columns = magnitude.shape
    _, height, width = canvas.shape
    moments = canvas.new_empty(4, height, width)
    counts, lists, side, across = _bins(boxes, canvas)
    tile_kernels.lay[_grid(canvas)](
        magnitude, affine, color, boxes, counts, lists, _numbers(spread, canvas), canvas, moments,
        moments if kept is None else kept,
        n, side, across, height, width, rows, columns, _segment(n),
        KEEP=kept is not None, ROWS=TILE, COLUMNS=TILE,
    )  # fmt: skip
    # The reference paints every pixel, so one value that is not finite makes the whole picture NaN.
    sound = affine.isfinite().all() & color.isfinite().all()
    moments = torch.where(sound, moments, torch.nan)
    return moments[:3], moments[3]


def _boxes(magnitude: Tensor, affine: Tensor, canvas: Tensor, *, bare: bool) -> Tensor:
    """Returns the box of pixels whose samples can touch each stroke's painted cells, or all cells: int32 [n, 4]."""
    cells = _whole_maps(magnitude) if bare else _painted_boxes(magnitude)
    return _pixel_extents(affine, cells, canvas).int()


def _bins(boxes: Tensor, canvas: Tensor) -> tuple[Tensor, Tensor, int, int]:
    """Returns the strokes that meet each bin, a square of whole tiles; there are at most _BINS x _BINS bins.

    boxes [n, 4]: from `_boxes`
    Returns the numbers of strokes [bins], lists [bins, n] that begin with them in painting order, the side of a bin in
    pixels, and the number of bins across.
    """
    across, down = _grid(canvas)
    tiles = -(-max(across, down) // _BINS)
    across, down, side = -(-across // tiles), -(-down // tiles), tiles * TILE
    top, bottom, left, right = boxes.unbind(1)

    def meets(first: Tensor, past: Tensor, bins: int) -> Tensor:
        start = side * torch.arange(bins, device=boxes.device)[:, None]
        return (first < start + side) & (past > start)  # [bins, n]

    met = (meets(top, bottom, down)[:, None] & meets(left, right, across)).flatten(0, 1)
    return met.sum(1).int(), torch.argsort(~met, dim=1, stable=True).int(), side, across


def _scale(magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor, gradients: Tensor) -> Tensor:
    """Returns the factor [1] from gradients to integers, so that no sum overflows; NaN if an input is not finite.

    It follows from upper bounds of the gradients. Gradients of the colours and of the mean are sums over pixels
    of the gradient that reaches the canvas, which no stroke increases. Gradients of an affine map have that
    bound for each row or column.
    """
    apart = 2 * torch.maximum(canvas.abs().amax(), color.abs().amax()).clamp(min=0.5)
    strongest = magnitude.abs().amax().clamp(min=1)
    by_plane = gradients.abs().sum((1, 2))
    of_mean, of_variance = by_plane[:3].sum(), by_plane[3]
    most = (apart * of_mean + 6 * apart.square() * of_variance) * strongest * max(canvas.shape)
    return (_MARGIN / most.clamp(min=1e-9) + 0 * affine.sum()).reshape(1)


def _numbers(spread: CoverageSpread, like: Tensor) -> Tensor:
    """Returns share and full for the kernels, [2]; made on the device, without a transfer."""
    return torch.stack((like.new_full((), spread.share), like.new_full((), spread.full)))


def _segment(strokes: int) -> int:
    """Returns the number of strokes of a segment, about the square root of all, which needs the least memory."""
    return max(1, math.isqrt(strokes))


def _grid(canvas: Tensor) -> tuple[int, int]:
    _, height, width = canvas.shape
    return -(-width // TILE), -(-height // TILE)


def _whole_maps(magnitude: Tensor) -> Tensor:
    """Returns the box of all cells of each map: [n, 4] (top, bottom, left, right)."""
    n, h, w = magnitude.shape
    none = magnitude.new_zeros((), dtype=torch.float64)  # made on the device of the maps, without a transfer
    return torch.stack((none, none + h, none, none + w)).expand(n, 4)


def _painted_boxes(magnitude: Tensor) -> Tensor:
    """Returns the smallest box with all nonzero cells of each map: [n, 4]; NaN if there are none."""
    painted = magnitude != 0
    edges: list[Tensor] = []
    for side in (painted.any(2), painted.any(1)):  # [n, h], [n, w]
        edges += [side.int().argmax(1), side.shape[1] - side.flip(1).int().argmax(1)]
    boxes = torch.stack(edges, 1).double()
    return torch.where(painted.flatten(1).any(1)[:, None], boxes, torch.nan)


def _pixel_extents(affine: Tensor, cells: Tensor, canvas: Tensor) -> Tensor:
    """Returns the box of pixels whose samples can touch each box of cells [n, 4]: [n, 4]; zeros if there are none."""
    _, height, width = canvas.shape
    place = affine.detach().double()
    a, b, c, d, e, f = place.flatten(1).unbind(1)
    determinant = a * e - b * d
    # Largest shift of the border by rounding, in cells.
    slack = 8 * torch.finfo(affine.dtype).eps * place.abs().sum((1, 2)) * max(height, width)
    top, bottom, left, right = cells.unbind(1)
    above, below = top - 1 - slack - f, bottom + slack - f
    before, past = left - 1 - slack - c, right + slack - c

    def extent(by_column: Tensor, by_row: Tensor, pixels: int) -> tuple[Tensor, Tensor]:
        across = torch.stack((by_column * before, by_column * past))
        down = torch.stack((by_row * above, by_row * below))
        least, most = across.amin(0) + down.amin(0), across.amax(0) + down.amax(0)
        # A degenerate map has no inverse: all pixels are examined.
        first = torch.where(least.isfinite(), least.floor(), 0).clamp(0, pixels)
        return first, torch.where(most.isfinite(), most.ceil() + 1, pixels).clamp(0, pixels)

    first_column, past_column = extent(e / determinant, -b / determinant, width)
    first_row, past_row = extent(-d / determinant, a / determinant, height)
    visible = (first_row < past_row) & (first_column < past_column) & slack.isfinite() & ~cells.isnan().any(1)
    boxes = torch.stack((first_row, past_row, first_column, past_column), 1)
    return torch.where(visible[:, None], boxes, 0).long()
