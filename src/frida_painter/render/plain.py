"""Renderer in PyTorch: each stroke touches only the part of the canvas that its map reaches.

For machines without numba, and for GPUs without Triton. Equals `reference.composite`. The gradients are written
by hand, so that only one coverage per stroke is stored. Strokes are sampled in batches and then painted one by
one. See docs/explanation/renderer.md.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn.functional import grid_sample, pad

from frida_painter.brush.kinds import CoverageSpread

# Sampling of magnitude maps over boxes of pixels, many strokes at a time

Box = tuple[int, int, int, int]  # pixel rows [top, bottom), columns [left, right)
BATCH_PIXELS = 2**17


def whole_maps(magnitude: Tensor) -> Tensor:
    """Returns the box of all cells of each map: [n, 4] (top, bottom, left, right)."""
    n, h, w = magnitude.shape
    none = magnitude.new_zeros((), dtype=torch.float64)  # made on the device of the maps, without a transfer
    return torch.stack((none, none + h, none, none + w)).expand(n, 4)


def painted_boxes(magnitude: Tensor) -> Tensor:
    """Returns the smallest box with all nonzero cells of each map: [n, 4]; NaN if there are none."""
    painted = magnitude != 0
    edges: list[Tensor] = []
    for side in (painted.any(2), painted.any(1)):  # [n, h], [n, w]
        edges += [side.int().argmax(1), side.shape[1] - side.flip(1).int().argmax(1)]
    boxes = torch.stack(edges, 1).double()
    return torch.where(painted.flatten(1).any(1)[:, None], boxes, torch.nan)


def pixel_boxes(affine: Tensor, cells: Tensor, canvas: Tensor) -> list[Box]:
    """Returns `pixel_extents` as Python numbers; waits for the device."""
    return [(box[0], box[1], box[2], box[3]) for box in pixel_extents(affine, cells, canvas).tolist()]


def pixel_extents(affine: Tensor, cells: Tensor, canvas: Tensor) -> Tensor:
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


class Batch:
    """Some strokes whose boxes are sampled together, each at the size of the largest box.

    grid_sample uses coordinates in [-1, 1]. Maps are padded to 2^k + 1 cells, so the conversion only shifts the
    exponent. So a sample on a whole cell stays there exactly; the gradient jumps at these places.
    """

    def __init__(self, strokes: Sequence[int], boxes: Sequence[Box], magnitude: Tensor, affine: Tensor) -> None:
        self.strokes = list(strokes)
        self.boxes = [boxes[i] for i in strokes]
        self.rows = max(bottom - top for top, bottom, _, _ in self.boxes)
        self.columns = max(right - left for _, _, left, right in self.boxes)
        self.magnitude = magnitude
        h, w = magnitude.shape[1:]
        self.sides = [2 ** max(1, math.ceil(math.log2(max(cells - 1, 1)))) for cells in (w, h)]
        self.half = affine.new_tensor(self.sides)[:, None] / 2  # [2, 1]
        self.place = affine[self.strokes] / self.half  # [k, 2, 3]
        corner = affine.new_tensor([(left, top) for top, _, left, _ in self.boxes])  # [k, 2]
        count = torch.arange(max(self.rows, self.columns), dtype=affine.dtype, device=affine.device)
        self.column = corner[:, 0:1] + count[: self.columns]  # [k, columns]
        self.row = corner[:, 1:2] + count[: self.rows]  # [k, rows]

    def maps(self) -> Tensor:
        """Returns the padded maps: [k, 1, 2^a + 1, 2^b + 1]."""
        h, w = self.magnitude.shape[1:]
        return pad(self.magnitude[self.strokes], (0, self.sides[0] + 1 - w, 0, self.sides[1] + 1 - h))[:, None]

    def grid(self) -> Tensor:
        """Returns the map coordinates of each pixel of the boxes: [k, rows, columns, 2]."""
        across = self.place[:, :, 0:1] * self.column[:, None]  # [k, 2, columns]
        down = self.place[:, :, 1:2] * self.row[:, None]  # [k, 2, rows]
        grid = across[:, :, None, :] + down[:, :, :, None]  # [k, 2, rows, columns]
        return grid.add_(self.place[:, :, 2, None, None]).sub_(1).permute(0, 2, 3, 1)

    def alpha(self) -> Tensor:
        """Returns the coverage over the boxes: [k, rows, columns]."""
        return grid_sample(self.maps(), self.grid(), padding_mode="zeros", align_corners=True)[:, 0]

    def pull(self, slope: Tensor) -> tuple[Tensor, Tensor]:
        """Converts the gradient of the coverage [k, rows, columns] to gradients of the inputs.

        Returns those of maps [k, h, w] and of affine maps [k, 2, 3].
        """
        to_map, to_grid = torch.ops.aten.grid_sampler_2d_backward(
            slope[:, None], self.maps(), self.grid(), 0, 0, True, [True, True]
        )
        by_column, by_row = to_grid.sum(1), to_grid.sum(2)  # [k, columns, 2], [k, rows, 2]
        by_x = (by_column * self.column[..., None]).sum(1)
        by_y = (by_row * self.row[..., None]).sum(1)
        h, w = self.magnitude.shape[1:]
        return to_map[:, 0, :h, :w], torch.stack((by_x, by_y, by_row.sum(1)), -1) / self.half

    def views(self, boxed: Tensor) -> Iterator[tuple[int, Tensor]]:
        """Yields each stroke with its part of a tensor [k, rows, columns]."""
        for i, (top, bottom, left, right), one in zip(self.strokes, self.boxes, boxed.unbind(), strict=True):
            yield i, one[: bottom - top, : right - left]


def batches(boxes: list[Box], magnitude: Tensor, affine: Tensor, *, by_shape: bool = False) -> Iterator[Batch]:
    """Yields all strokes with a box in batches that fit in the cache.

    by_shape: True to group boxes of similar shape, which wastes less; False to keep the order of the strokes
    """
    visible = [i for i, (top, bottom, _, _) in enumerate(boxes) if top < bottom]
    if by_shape:
        visible.sort(key=lambda i: (boxes[i][1] - boxes[i][0]) / (boxes[i][3] - boxes[i][2]))
    picked: list[int] = []
    rows = columns = 0
    for i in visible:
        top, bottom, left, right = boxes[i]
        taller, wider = max(rows, bottom - top), max(columns, right - left)
        if picked and (len(picked) + 1) * taller * wider > BATCH_PIXELS:
            yield Batch(picked, boxes, magnitude, affine)
            picked, taller, wider = [], bottom - top, right - left
        picked.append(i)
        rows, columns = taller, wider
    if picked:
        yield Batch(picked, boxes, magnitude, affine)


def composite(magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor) -> Tensor:
    """Paints strokes in order on a canvas, as `reference.composite`.

    magnitude [n, h, w], affine [n, 2, 3], color [n, 3], canvas [3, H, W]: see `reference.composite`
    Returns the picture [3, H, W] on the device and in the precision of `canvas`. Differentiable once in all
    four tensors. If an affine map or a colour is not finite, the whole picture is NaN.
    """
    magnitude, affine, color = magnitude.to(canvas.dtype), affine.to(canvas.dtype), color.to(canvas.dtype)
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in (magnitude, affine, color, canvas)):
        apply: Callable[..., Tensor] = _Slices.apply
        return apply(magnitude, affine, color, canvas)
    boxes = pixel_boxes(affine, painted_boxes(magnitude), canvas)
    return _lay(magnitude, affine, color, canvas, boxes, kept=None)


def _lay(
    magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor, boxes: list[Box], kept: list[Tensor] | None
) -> Tensor:
    """Returns the picture; appends the coverage of each batch to `kept` if that is given."""
    picture = canvas.detach().clone(memory_format=torch.contiguous_format)
    paints = color.detach()[:, :, None, None].unbind()
    for batch in batches(boxes, magnitude.detach(), affine.detach()):
        coverage = batch.alpha()
        if kept is not None:
            kept.append(coverage)
        for i, alpha in batch.views(coverage):
            top, bottom, left, right = boxes[i]
            picture[:, top:bottom, left:right].lerp_(paints[i], alpha)
    # The reference paints every pixel, so one value that is not finite makes the whole picture NaN.
    return torch.where(affine.isfinite().all() & color.isfinite().all(), picture, torch.nan)


class _Slices(torch.autograd.Function):
    """`composite` with gradients. `marks` are the boxes of the paint, `reach` those of the whole maps."""

    @staticmethod
    def forward(ctx: Any, magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor) -> Tensor:
        ctx.marks = pixel_boxes(affine, painted_boxes(magnitude), canvas)
        kept: list[Tensor] = []
        picture = _lay(magnitude, affine, color, canvas, ctx.marks, kept)
        ctx.save_for_backward(magnitude, affine, color, canvas, *kept)
        return picture

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        magnitude, affine, color, canvas, *kept = ctx.saved_tensors
        wants_map, wants_affine, _, _ = ctx.needs_input_grad
        marks: list[Box] = ctx.marks
        in_batches = zip(batches(marks, magnitude, affine), kept, strict=True)
        alphas = {i: alpha for batch, boxed in in_batches for i, alpha in batch.views(boxed)}
        # Cells without paint may still need a gradient: it is not zero.
        reach = pixel_boxes(affine, whole_maps(magnitude), canvas) if wants_map else marks
        asked = batches(reach, magnitude, affine, by_shape=True) if wants_map or wants_affine else ()
        slopes = [(batch, canvas.new_zeros(len(batch.strokes), batch.rows, batch.columns)) for batch in asked]
        rises = {i: rise for batch, slope in slopes for i, rise in batch.views(slope)}
        gradient = gradient.contiguous()
        if rises:
            _find_slopes(gradient, color, canvas, reach, marks, alphas, rises)
        to_map, to_affine, to_color = torch.zeros_like(magnitude), torch.zeros_like(affine), torch.zeros_like(color)
        through = _pull_through(gradient, reach, marks, alphas, rises, to_color)
        for batch, slope in slopes:
            to_map[batch.strokes], to_affine[batch.strokes] = batch.pull(slope)
        every = to_map, to_affine, to_color, gradient * through
        return tuple(part if wanted else None for part, wanted in zip(every, ctx.needs_input_grad, strict=True))


def slices_inside(box: Box, around: Box) -> tuple[slice, slice]:
    """Returns the place of a box inside a larger box, as slices."""
    top, left = around[0], around[2]
    return slice(box[0] - top, box[1] - top), slice(box[2] - left, box[3] - left)


def _find_slopes(
    gradient: Tensor,
    color: Tensor,
    canvas: Tensor,
    reach: list[Box],
    marks: list[Box],
    alphas: dict[int, Tensor],
    rises: dict[int, Tensor],
) -> None:
    """Writes g . (c - C) over each stroke's reach to `rises`; C is the picture just below the stroke.

    Carries only the scalar g . C from stroke to stroke, not the colours.
    """
    below = (gradient * canvas).sum(0)  # [H, W]
    paints = color.tolist()
    for i in sorted(rises):
        top, bottom, left, right = reach[i]
        red, green, blue = gradient[:, top:bottom, left:right].unbind()
        under = below[top:bottom, left:right]
        rise = torch.sub(red * paints[i][0], under, out=rises[i])
        rise.add_(green, alpha=paints[i][1]).add_(blue, alpha=paints[i][2])
        if i in alphas:
            inside = slices_inside(marks[i], reach[i])
            under[inside].addcmul_(alphas[i], rise[inside])


def _pull_through(
    gradient: Tensor,
    reach: list[Box],
    marks: list[Box],
    alphas: dict[int, Tensor],
    rises: dict[int, Tensor],
    to_color: Tensor,
) -> Tensor:
    """Goes down through the strokes and returns the visible share of the canvas, [H, W].

    Converts `rises` to gradients of the coverage. Writes the gradients of the colours to `to_color` [n, 3].
    """
    through = torch.ones_like(gradient[0])
    for i in range(len(reach) - 1, -1, -1):
        if i in rises:
            top, bottom, left, right = reach[i]
            rises[i].mul_(through[top:bottom, left:right])
        if i in alphas:
            top, bottom, left, right = marks[i]
            seen = through[top:bottom, left:right]
            share = seen * alphas[i]
            torch.sum(gradient[:, top:bottom, left:right] * share, (1, 2), out=to_color[i])
            seen.sub_(share)
    return through


# Strokes of uncertain coverage: mean and variance of the picture, equal to `reference.composite_moments`


def composite_moments(
    magnitude: Tensor,
    affine: Tensor,
    color: Tensor,
    canvas: Tensor,
    spread: CoverageSpread,
    variance: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """Paints strokes of mean coverage `magnitude` in order on a canvas, as `reference.composite_moments`.

    Tensors as in `composite`. Differentiable once in all five tensors.
    """
    magnitude, affine, color = magnitude.to(canvas.dtype), affine.to(canvas.dtype), color.to(canvas.dtype)
    variance = torch.zeros_like(canvas[0]) if variance is None else variance
    tensors = magnitude, affine, color, canvas, variance
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in tensors):
        apply: Callable[..., tuple[Tensor, Tensor]] = _Moments.apply
        return apply(*tensors, spread)
    boxes = pixel_boxes(affine, painted_boxes(magnitude), canvas)
    covers = {i: cover for batch in batches(boxes, magnitude, affine) for i, cover in batch.views(batch.alpha())}
    return _climb(affine, color, canvas, variance, spread, boxes, covers, visit=lambda i, mean, variance: None)


class _Moments(torch.autograd.Function):
    """`composite_moments` with gradients. `marks` are the boxes of the paint, `reach` those of the whole maps."""

    @staticmethod
    def forward(
        ctx: Any,
        magnitude: Tensor,
        affine: Tensor,
        color: Tensor,
        canvas: Tensor,
        variance: Tensor,
        spread: CoverageSpread,
    ) -> tuple[Tensor, Tensor]:
        ctx.marks, ctx.spread = pixel_boxes(affine, painted_boxes(magnitude), canvas), spread
        kept = [batch.alpha() for batch in batches(ctx.marks, magnitude, affine)]
        ctx.save_for_backward(magnitude, affine, color, canvas, variance, *kept)
        covers = _Moments._covers(ctx.marks, magnitude, affine, kept)
        return _climb(affine, color, canvas, variance, spread, ctx.marks, covers, visit=lambda i, mean, variance: None)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, of_mean: Tensor, of_variance: Tensor) -> tuple[Tensor | None, ...]:
        magnitude, affine, color, canvas, uncertain, *kept = ctx.saved_tensors
        marks: list[Box] = ctx.marks
        covers = _Moments._covers(marks, magnitude, affine, kept)
        # Cells without paint may still need a gradient: it is not zero.
        reach = pixel_boxes(affine, whole_maps(magnitude), canvas) if ctx.needs_input_grad[0] else marks
        below: dict[int, tuple[Tensor, Tensor]] = {}

        def remember(i: int, mean: Tensor, variance: Tensor) -> None:
            top, bottom, left, right = reach[i]
            below[i] = mean[:, top:bottom, left:right].clone(), variance[top:bottom, left:right].clone()

        _climb(affine, color, canvas, uncertain, ctx.spread, marks, covers, visit=remember)
        asked = batches(reach, magnitude, affine, by_shape=True)
        slopes = [(batch, canvas.new_zeros(len(batch.strokes), batch.rows, batch.columns)) for batch in asked]
        rises = {i: rise for batch, slope in slopes for i, rise in batch.views(slope)}
        to_mean, to_variance = of_mean.clone(), of_variance.clone()
        to_map, to_affine, to_color = torch.zeros_like(magnitude), torch.zeros_like(affine), torch.zeros_like(color)
        share, full = ctx.spread
        for i in sorted(rises, reverse=True):
            top, bottom, left, right = reach[i]
            from_mean, from_variance = (part[..., top:bottom, left:right] for part in (to_mean, to_variance))
            cover = torch.zeros_like(from_mean[0])
            if i in covers:
                cover[slices_inside(marks[i], reach[i])] = covers[i]
            mean, varied = below[i]
            away, keeps, bare = mean - color[i][:, None, None], 1 - cover, full - cover
            doubt = share * cover * bare.clamp(min=0)
            rising = torch.where(bare > 0, share * (bare - cover), 0)
            by_variance = rising * (varied + away.square().mean(0)) - 2 * keeps * varied
            rises[i].copy_(from_variance * by_variance - (from_mean * away).sum(0))
            crossed = 2 / 3 * doubt * away * from_variance
            to_color[i] = (cover * from_mean - crossed).sum((1, 2))
            from_mean.mul_(keeps).add_(crossed)
            from_variance.mul_(keeps.square() + doubt)
        for batch, slope in slopes:
            to_map[batch.strokes], to_affine[batch.strokes] = batch.pull(slope)
        every = to_map, to_affine, to_color, to_mean, to_variance, None
        return tuple(part if wanted else None for part, wanted in zip(every, ctx.needs_input_grad, strict=True))

    @staticmethod
    def _covers(marks: list[Box], magnitude: Tensor, affine: Tensor, kept: list[Tensor]) -> dict[int, Tensor]:
        """Returns the coverage of each visible stroke over its box."""
        in_batches = zip(batches(marks, magnitude, affine), kept, strict=True)
        return {i: cover for batch, boxed in in_batches for i, cover in batch.views(boxed)}


def _climb(
    affine: Tensor,
    color: Tensor,
    canvas: Tensor,
    uncertain: Tensor,
    spread: CoverageSpread,
    boxes: list[Box],
    covers: dict[int, Tensor],
    *,
    visit: Callable[[int, Tensor, Tensor], None],
) -> tuple[Tensor, Tensor]:
    """Returns the moments; calls `visit` with the moments below each stroke before it is painted.

    canvas [3, H, W], uncertain [H, W]: mean and variance of the canvas
    """
    mean = canvas.detach().clone(memory_format=torch.contiguous_format)
    variance = uncertain.detach().clone(memory_format=torch.contiguous_format)
    paints = color.detach()[:, :, None, None].unbind()
    for i, (top, bottom, left, right) in enumerate(boxes):
        visit(i, mean, variance)
        if i not in covers:
            continue
        under, varies, cover = mean[:, top:bottom, left:right], variance[top:bottom, left:right], covers[i].detach()
        away, doubt = under - paints[i], spread.variance(cover)
        varies.mul_((1 - cover).square() + doubt).add_(doubt * away.square().mean(0))
        under.sub_(cover * away)
    # The reference paints every pixel, so one value that is not finite makes the whole picture NaN.
    sound = affine.isfinite().all() & color.isfinite().all()
    return torch.where(sound, mean, torch.nan), torch.where(sound, variance, torch.nan)
