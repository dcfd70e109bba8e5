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
from frida_painter.compiled import array
from frida_painter.render import moment_kernels
from frida_painter.render.scanline import Laid, Team, bands_of, lay, pull_to_strokes


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
    """Lays strokes of mean coverage `magnitude` over a canvas in order; as `reference.composite_moments`.

    Tensors, threads and `bare_cells_answer` as in `scanline.composite`; differentiable (once) in all five tensors.
    """
    magnitude, affine, color = magnitude.to(canvas.dtype), affine.to(canvas.dtype), color.to(canvas.dtype)
    tensors = magnitude, affine, color, canvas, torch.zeros_like(canvas[0]) if variance is None else variance
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in tensors):
        apply: Callable[..., tuple[Tensor, Tensor]] = _Moments.apply
        return apply(*tensors, spread, bare_cells_answer)
    moments, _ = _lay(*tensors, spread)
    return moments


class _Moments(torch.autograd.Function):
    """`composite_moments` with its gradients; of the forward pass it keeps three numbers per covered pixel."""

    @staticmethod
    def forward(
        ctx: Any,
        magnitude: Tensor,
        affine: Tensor,
        color: Tensor,
        canvas: Tensor,
        variance: Tensor,
        spread: CoverageSpread,
        bare_cells_answer: bool,
    ) -> tuple[Tensor, Tensor]:
        whole = bare_cells_answer and ctx.needs_input_grad[0]
        moments, laid = _lay(magnitude, affine, color, canvas, variance, spread, keep=True, whole=whole)
        ctx.spread = spread
        ctx.save_for_backward(magnitude, affine, color, canvas, variance, torch.from_numpy(laid.sampled))
        ctx.laid = laid._replace(sampled=laid.sampled[:, :0])
        return moments

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, of_mean: Tensor, of_variance: Tensor) -> tuple[Tensor | None, ...]:
        magnitude, affine, color, canvas, variance, sampled = (array(tensor) for tensor in ctx.saved_tensors)
        wants_map, wants_affine, wants_color, wants_canvas, wants_variance, *_ = ctx.needs_input_grad
        laid: Laid = ctx.laid._replace(sampled=sampled)
        to_mean, to_variance = array(of_mean).copy(), array(of_variance).copy()
        bands = bands_of(canvas)
        to_color, slope = np.zeros((len(bands), *color.shape), canvas.dtype), np.empty_like(sampled[0])
        spread = _numbers(ctx.spread, canvas)
        with Team() as team:
            team.share(
                bands, moment_kernels.pull_through,
                laid.spans, sampled[0], color, spread, canvas, variance, to_mean, to_variance, slope, to_color,
            )  # fmt: skip
            to_affine, to_map = pull_to_strokes(team, magnitude, affine, laid, slope, wants_affine, wants_map)
        return (
            to_map,
            to_affine,
            torch.from_numpy(to_color.sum(0)) if wants_color else None,
            torch.from_numpy(to_mean) if wants_canvas else None,
            torch.from_numpy(to_variance) if wants_variance else None,
            None,
            None,
        )


def _lay(
    magnitude: Tensor,
    affine: Tensor,
    color: Tensor,
    canvas: Tensor,
    variance: Tensor,
    spread: CoverageSpread,
    **how: Any,
) -> tuple[tuple[Tensor, Tensor], Laid]:
    """The moments, and how the strokes were laid; `how` is told to `lay`."""
    moments = array(canvas).copy(), array(variance).copy()
    numbers = _numbers(spread, moments[0])
    laid = lay(magnitude, affine, color, moments, moment_kernels.blend, array(color), numbers, **how)
    return (torch.from_numpy(moments[0]), torch.from_numpy(moments[1])), laid


def _numbers(spread: CoverageSpread, like: np.ndarray[Any, Any]) -> tuple[Any, Any]:
    """Share and full in the precision of an array, so that the loops compute in no other."""
    return like.dtype.type(spread.share), like.dtype.type(spread.full)
