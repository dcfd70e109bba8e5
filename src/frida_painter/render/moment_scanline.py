"""Mean and variance of the picture that strokes of uncertain coverage leave, on the CPU by compiled scanlines.

Equals `reference.composite_moments`. The loops are in moment_kernels.py; sampling, spans and the way back to maps
and places are those of the plain renderer (scanline.py).
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from frida_painter.brush.spread import CoverageSpread
from frida_painter.render import kernels, moment_kernels
from frida_painter.render.scanline import Team, array, lay, pull_back, strips
from frida_painter.render.spans import Spans, painted_boxes, whole_maps


def composite_moments(
    magnitude: Tensor,
    affine: Tensor,
    color: Tensor,
    canvas: Tensor,
    spread: CoverageSpread,
    *,
    bare_cells_answer: bool = True,
) -> tuple[Tensor, Tensor]:
    """Lays strokes of mean coverage `magnitude` over a canvas in order; as `reference.composite_moments`.

    Tensors, threads and `bare_cells_answer` as in `scanline.composite`; differentiable (once) in all four tensors.
    """
    magnitude, affine, color = magnitude.to(canvas.dtype), affine.to(canvas.dtype), color.to(canvas.dtype)
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in (magnitude, affine, color, canvas)):
        apply: Callable[..., tuple[Tensor, Tensor]] = _Moments.apply
        return apply(magnitude, affine, color, canvas, spread, bare_cells_answer)
    moments, _, _ = _lay(magnitude, affine, color, canvas, spread, keep=False)
    return moments


class _Moments(torch.autograd.Function):
    """`composite_moments` with its gradients; of the forward pass it keeps one coverage per covered pixel."""

    @staticmethod
    def forward(
        ctx: Any,
        magnitude: Tensor,
        affine: Tensor,
        color: Tensor,
        canvas: Tensor,
        spread: CoverageSpread,
        bare_cells_answer: bool,
    ) -> tuple[Tensor, Tensor]:
        moments, alpha, ctx.marks = _lay(magnitude, affine, color, canvas, spread, keep=True)
        ctx.spread, ctx.bare_cells_answer = spread, bare_cells_answer
        ctx.save_for_backward(magnitude, affine, color, canvas, alpha)
        return moments

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, of_mean: Tensor, of_variance: Tensor) -> tuple[Tensor | None, ...]:
        magnitude, affine, color, canvas, alpha = (array(tensor) for tensor in ctx.saved_tensors)
        wants_map, wants_affine, wants_color, wants_canvas, _, _ = ctx.needs_input_grad
        marks: Spans = ctx.marks
        to_mean, to_variance = array(of_mean).copy(), array(of_variance).copy()
        bands = -(-canvas.shape[1] // kernels.BAND)
        color_parts = np.zeros((bands, *color.shape), canvas.dtype)
        to_map = np.zeros_like(magnitude) if wants_map else None
        to_affine = np.zeros_like(affine) if wants_affine else None
        boxes = whole_maps(magnitude) if wants_map and ctx.bare_cells_answer else painted_boxes(magnitude)
        spread = _numbers(ctx.spread, canvas)
        with Team() as team:
            for strip, reach in strips(affine, boxes, canvas.shape):
                pixels = int(reach.offset[-1])
                below = np.empty((6, pixels), canvas.dtype)
                slope = np.empty(pixels if wants_map or wants_affine else 0, canvas.dtype)
                team.share(strip, moment_kernels.climb, marks, alpha, reach, color, spread, canvas, below)
                team.share(
                    strip, moment_kernels.descend,
                    marks, alpha, reach, color, spread, below, to_mean, to_variance, slope, color_parts,
                )  # fmt: skip
                pull_back(team, magnitude, affine, marks, reach, slope, to_map, to_affine, canvas.shape[2])
        return (
            None if to_map is None else torch.from_numpy(to_map),
            None if to_affine is None else torch.from_numpy(to_affine),
            torch.from_numpy(color_parts.sum(0)) if wants_color else None,
            torch.from_numpy(to_mean) if wants_canvas else None,
            None,
            None,
        )


def _lay(
    magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor, spread: CoverageSpread, *, keep: bool
) -> tuple[tuple[Tensor, Tensor], Tensor, Spans]:
    """The moments, the packed coverages (all of them if they are to be kept), and where they lie."""
    mean = array(canvas).copy()
    variance = np.zeros_like(mean)
    numbers = _numbers(spread, mean)
    pictures = mean, variance
    alpha, marks = lay(magnitude, affine, color, pictures, moment_kernels.blend, array(color), numbers, keep=keep)
    return (torch.from_numpy(mean), torch.from_numpy(variance)), alpha, marks


def _numbers(spread: CoverageSpread, like: np.ndarray[Any, Any]) -> tuple[Any, Any]:
    """Share and full in the precision of an array, so that the loops compute in no other."""
    return like.dtype.type(spread.share), like.dtype.type(spread.full)
