"""The renderer on the CPU: compiled scanlines that touch only the pixels which strokes cover.

Equals `reference.composite`. The geometry is in spans.py, the loops are in kernels.py, and
docs/renderer.md tells why the gradients are what they are.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from frida_painter.render import kernels
from frida_painter.render.spans import Array, Spans, find_spans

# Packed pixels that are sampled and then blended in one go: few enough to stay in the cache.
_BATCH = 2**18
_PIECES_PER_THREAD = 4


def composite(magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor) -> Tensor:
    """Lays strokes over a canvas in order; signature and meaning of `reference.composite`.

    magnitude [n, h, w], affine [n, 2, 3], color [n, 3], canvas [3, H, W] -> [3, H, W]; all on the
    CPU, in the precision of `canvas` (float32 or float64); differentiable (once) in all four. A
    stroke whose place is not finite leaves no picture: all of it is NaN. Runs on as many threads as
    torch does, with the same bits for any number of them.
    """
    magnitude, affine, color = magnitude.to(canvas.dtype), affine.to(canvas.dtype), color.to(canvas.dtype)
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in (magnitude, affine, color, canvas)):
        apply: Callable[..., Tensor] = _Scanline.apply
        return apply(magnitude, affine, color, canvas)
    picture, _, _ = _lay(magnitude, affine, color, canvas, keep=False)
    return picture


class _Scanline(torch.autograd.Function):
    """`composite` with its gradients; of the forward pass it keeps one coverage per covered pixel."""

    @staticmethod
    def forward(ctx: Any, magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor) -> Tensor:
        picture, alpha, ctx.spans = _lay(magnitude, affine, color, canvas, keep=True)
        ctx.save_for_backward(magnitude, affine, color, canvas, alpha)
        return picture

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        magnitude, affine, color, canvas, alpha = (_array(tensor) for tensor in ctx.saved_tensors)
        wants_map, wants_affine, wants_color, wants_canvas = ctx.needs_input_grad
        spans: Spans = ctx.spans
        slopes_wanted = wants_map or wants_affine
        g = _array(gradient)
        n, (_, height, width) = len(color), canvas.shape
        bands = -(-height // kernels.BAND)
        columns = np.arange(width, dtype=canvas.dtype)
        slope = np.empty(len(alpha) if slopes_wanted else 0, canvas.dtype)
        through = np.ones((height, width), canvas.dtype)
        color_parts = np.zeros((bands if wants_color else 0, n, 3), canvas.dtype)
        to_map = np.empty_like(magnitude) if wants_map else None
        to_affine = np.zeros_like(affine) if wants_affine else None
        with _Team() as team:
            if slopes_wanted:
                team.share(range(bands), kernels.find_slopes, spans, alpha, color, canvas, g, slope)
            team.share(range(bands), kernels.pull_through, spans, alpha, g, through, slope, color_parts)
            if to_affine is not None:
                team.share(range(n), kernels.pull_to_affine, magnitude, affine, columns, spans, slope, to_affine)
            if to_map is not None:
                team.share(range(n), kernels.pull_to_map, affine, columns, spans, slope, to_map)
        return (
            None if to_map is None else torch.from_numpy(to_map),
            None if to_affine is None else torch.from_numpy(to_affine),
            torch.from_numpy(color_parts.sum(0)) if wants_color else None,
            gradient * torch.from_numpy(through) if wants_canvas else None,
        )


def _lay(
    magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor, *, keep: bool
) -> tuple[Tensor, Tensor, Spans]:
    """The picture, the packed coverages (all of them if they are to be kept), and where they lie."""
    marks, places, paints = _array(magnitude), _array(affine), _array(color)
    picture = canvas.detach().clone(memory_format=torch.contiguous_format)
    _, height, width = canvas.shape
    spans = find_spans(places, marks.shape[1:], (height, width))
    pixels = spans.offset[spans.segment]  # [n + 1], where each stroke's packed pixels begin
    batches = _batches(pixels)
    largest = max((int(pixels[last] - pixels[first]) for first, last in batches), default=0)
    alpha = torch.empty(int(pixels[-1]) if keep else largest, dtype=canvas.dtype)
    columns = np.arange(width, dtype=places.dtype)
    bands = -(-height // kernels.BAND)
    with _Team() as team:
        for first, last in batches:
            base = 0 if keep else pixels[first]
            strokes = first, last
            team.share(range(first, last), kernels.sample, marks, places, columns, spans, base, alpha.numpy())
            team.share(range(bands), kernels.blend, strokes, spans, base, alpha.numpy(), paints, picture.numpy())
    if not np.isfinite(places).all():
        picture.fill_(torch.nan)
    return picture, alpha, spans


def _batches(pixels: Array) -> list[tuple[int, int]]:
    """Ranges of strokes of about _BATCH packed pixels each, at least one stroke; pixels [n + 1]."""
    batches, first = [], 0
    while first < len(pixels) - 1:
        last = max(first + 1, int(np.searchsorted(pixels, pixels[first] + _BATCH, side="right")) - 1)
        batches.append((first, last))
        first = last
    return batches


def _array(tensor: Tensor) -> Array:
    return tensor.detach().contiguous().numpy()


class _Team:
    """As many threads as torch has been given, for as long as the `with` lasts; none for one."""

    def __enter__(self) -> "_Team":
        self.threads = torch.get_num_threads()
        self.pool = ThreadPoolExecutor(self.threads) if self.threads > 1 else None
        return self

    def __exit__(self, *_: object) -> None:
        if self.pool is not None:
            self.pool.shutdown()

    def share(self, whole: range, kernel: Callable[..., None], *arguments: object) -> None:
        """Runs kernel(begin, end, *arguments) over ranges that make up the whole."""
        if self.pool is None:
            kernel(whole.start, whole.stop, *arguments)
            return
        edges = (
            np.linspace(whole.start, whole.stop, min(len(whole), self.threads * _PIECES_PER_THREAD) + 1)
            .astype(int)
            .tolist()
        )
        pieces = [self.pool.submit(kernel, a, b, *arguments) for a, b in zip(edges, edges[1:], strict=False)]
        for piece in pieces:
            piece.result()
