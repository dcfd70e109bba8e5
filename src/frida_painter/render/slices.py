"""The renderer in plain PyTorch: each stroke touches only the slice of the canvas that its map reaches.

For CUDA, and for machines without numba. Equals `reference.composite`, with gradients written out
by hand so that one coverage per stroke slice is all that is kept. Strokes are sampled in batches
(sampling.py) and laid over the canvas one by one. See docs/explanation/renderer.md.
"""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from frida_painter.render.sampling import Box, batches, painted_boxes, pixel_boxes, whole_maps


def composite(magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor) -> Tensor:
    """Lays strokes over a canvas in order; signature and meaning of `reference.composite`.

    magnitude [n, h, w], affine [n, 2, 3], color [n, 3], canvas [3, H, W] -> [3, H, W], on the
    device and in the precision of `canvas`; differentiable (once) in all four. A place or colour
    that is not finite spoils the whole picture: all of it is NaN.
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
    """The picture; each batch's coverage is appended to `kept` if that is given."""
    picture = canvas.detach().clone(memory_format=torch.contiguous_format)
    paints = color.detach()[:, :, None, None].unbind()
    for batch in batches(boxes, magnitude.detach(), affine.detach()):
        coverage = batch.alpha()
        if kept is not None:
            kept.append(coverage)
        for i, alpha in batch.views(coverage):
            top, bottom, left, right = boxes[i]
            picture[:, top:bottom, left:right].lerp_(paints[i], alpha)
    # The reference lays 0 times the paint everywhere, so what is not finite spoils the whole picture.
    return torch.where(affine.isfinite().all() & color.isfinite().all(), picture, torch.nan)


class _Slices(torch.autograd.Function):
    """`composite` with its gradients; `marks` are the boxes of the paint, `reach` those of the whole maps."""

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
        # Paint that is not there may still be wanted: the gradient to a zero cell is not zero.
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
    """Where a box lies in the slice of the box around it."""
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
    """Fills in g . (c - C) over each stroke's reach, where C is the picture just below the stroke.

    Only the scalar g . C is carried from stroke to stroke, never the colours.
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
    """Goes down through the strokes; returns what all of them let through to the canvas, [H, W].

    Turns the slopes into gradients to the coverage, and fills in the gradient to the colours [n, 3].
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
