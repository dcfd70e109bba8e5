"""Mean and variance of the picture that strokes of uncertain coverage leave, in plain PyTorch.

For CUDA, and for machines without numba, as slices.py is for certain ones. Equals `reference.composite_moments`.
"""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from frida_painter.brush.spread import CoverageSpread
from frida_painter.render.sampling import Box, batches, painted_boxes, pixel_boxes, whole_maps
from frida_painter.render.slices import slices_inside


def composite_moments(
    magnitude: Tensor,
    affine: Tensor,
    color: Tensor,
    canvas: Tensor,
    spread: CoverageSpread,
    variance: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """Lays strokes of mean coverage `magnitude` over a canvas in order; as `reference.composite_moments`.

    Tensors as in `slices.composite`; differentiable (once) in all five.
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
    """`composite_moments` with its gradients; `marks` are the boxes of the paint, `reach` those of the whole maps."""

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
        # Paint that is not there may still be wanted: the gradient to a zero cell is not zero.
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
        """The coverage of each stroke that can be seen, over its box."""
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
    """The moments; `visit` is shown those under each stroke before it is laid down.

    canvas [3, H, W], uncertain [H, W]: mean and variance of the canvas.
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
    # The reference lays 0 times the paint everywhere, so what is not finite spoils the whole picture.
    sound = affine.isfinite().all() & color.isfinite().all()
    return torch.where(sound, mean, torch.nan), torch.where(sound, variance, torch.nan)
