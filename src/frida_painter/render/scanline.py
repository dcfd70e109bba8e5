"""The renderer on the CPU: compiled scanlines that touch only the pixels which strokes cover.

Equals `reference.composite`. The geometry is in spans.py, the loops are in kernels.py, and
docs/renderer.md tells why the gradients are what they are. Nothing in here computes with torch,
whose own threads spin for a while after each operation and would take the cores from the scanlines'.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from frida_painter.render import kernels
from frida_painter.render.spans import Array, Spans, find_spans, painted_boxes, whole_maps

# Packed pixels that are sampled and then blended in one go: few enough to stay in the cache.
_BATCH = 2**18
# Packed pixels whose gradients are held at a time on the way back.
_STRIP = 2**22
_PIECES_PER_THREAD = 4


def composite(
    magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor, *, bare_cells_answer: bool = True
) -> Tensor:
    """Lays strokes over a canvas in order; signature and meaning of `reference.composite`.

    magnitude [n, h, w], affine [n, 2, 3], color [n, 3], canvas [3, H, W] -> [3, H, W]; all on the
    CPU, in the precision of `canvas` (float32 or float64); differentiable (once) in all four. A
    stroke whose place is not finite leaves no picture: all of it is NaN. Runs on as many threads as
    torch does, with the same bits for any number of them.

    bare_cells_answer: whether the gradient to cells without paint is wanted beyond the smallest box
    that holds a map's paint. It is not zero, but a stroke model whose bare cells stay bare under
    small changes multiplies it by zero, and need not pay for it: a third of the time.
    """
    magnitude, affine, color = magnitude.to(canvas.dtype), affine.to(canvas.dtype), color.to(canvas.dtype)
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in (magnitude, affine, color, canvas)):
        apply: Callable[..., Tensor] = _Scanline.apply
        return apply(magnitude, affine, color, canvas, bare_cells_answer)
    picture = array(canvas).copy()
    _lay(magnitude, affine, color, picture, keep=False)
    return torch.from_numpy(picture)


class _Scanline(torch.autograd.Function):
    """`composite` with its gradients; of the forward pass it keeps one coverage per covered pixel."""

    @staticmethod
    def forward(
        ctx: Any, magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor, bare_cells_answer: bool
    ) -> Tensor:
        picture = array(canvas).copy()
        alpha, ctx.marks = _lay(magnitude, affine, color, picture, keep=True)
        ctx.bare_cells_answer = bare_cells_answer
        ctx.save_for_backward(magnitude, affine, color, canvas, alpha)
        return torch.from_numpy(picture)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        magnitude, affine, color, canvas, alpha = (array(tensor) for tensor in ctx.saved_tensors)
        wants_map, wants_affine, wants_color, wants_canvas, _ = ctx.needs_input_grad
        marks: Spans = ctx.marks
        g = array(gradient)
        bands = -(-canvas.shape[1] // kernels.BAND)
        through = np.ones_like(canvas[0])
        color_parts = np.zeros((bands, *color.shape), canvas.dtype)
        to_map = np.zeros_like(magnitude) if wants_map else None
        to_affine = np.zeros_like(affine) if wants_affine else None
        # Paint that is not there may still be wanted: the gradient to a zero cell is not zero.
        boxes = whole_maps(magnitude) if wants_map and ctx.bare_cells_answer else painted_boxes(magnitude)
        slope = np.empty(0, canvas.dtype)
        with Team() as team:
            for strip, reach in strips(affine, boxes, canvas.shape):
                if wants_map or wants_affine:
                    if len(slope) < reach.offset[-1]:
                        slope = np.empty(reach.offset[-1], canvas.dtype)
                    team.share(strip, kernels.find_slopes, marks, alpha, reach, color, canvas, g, slope)
                team.share(strip, kernels.pull_through, marks, alpha, reach, g, through, slope, color_parts)
                pull_back(team, magnitude, affine, marks, reach, slope, to_map, to_affine, canvas.shape[2])
        return (
            None if to_map is None else torch.from_numpy(to_map),
            None if to_affine is None else torch.from_numpy(to_affine),
            torch.from_numpy(color_parts.sum(0)) if wants_color else None,
            torch.from_numpy(g * through) if wants_canvas else None,
            None,
        )


def _lay(magnitude: Tensor, affine: Tensor, color: Tensor, picture: Array, *, keep: bool) -> tuple[Tensor, Spans]:
    """Paints on the picture; returns the packed coverages (all of them if they are to be kept), and where they lie."""
    paints = array(color)
    return lay(magnitude, affine, color, (picture,), kernels.blend, paints, keep=keep)


def lay(
    magnitude: Tensor,
    affine: Tensor,
    color: Tensor,
    pictures: tuple[Array, ...],
    blend: Callable[..., None],
    *arguments: object,
    keep: bool,
) -> tuple[Tensor, Spans]:
    """Samples the strokes batch by batch, and has `blend` lay them over bands of the pictures, each [3, H, W].

    blend is a kernel that takes (begin, end, strokes, marks, base, alpha, *arguments, *pictures). Returns the packed
    coverages (all of them if they are to be kept), and where they lie.
    """
    maps, places = array(magnitude), array(affine)
    _, height, width = pictures[0].shape
    marks = find_spans(places, painted_boxes(maps), range(height), width)
    pixels = marks.offset[marks.segment]  # [n + 1], where each stroke's packed pixels begin
    batches = _batches(pixels)
    largest = max((int(pixels[last] - pixels[first]) for first, last in batches), default=0)
    kept = torch.empty(int(pixels[-1]) if keep else largest, dtype=magnitude.dtype)
    alpha, columns, bands = kept.numpy(), column_numbers(width, places), -(-height // kernels.BAND)
    with Team() as team:
        for first, last in batches:
            base = 0 if keep else int(pixels[first])
            team.share(range(first, last), kernels.sample, maps, places, columns, marks, base, alpha)
            team.share(range(bands), blend, (first, last), marks, base, alpha, *arguments, *pictures)
    # The reference lays 0 times the paint everywhere, so what is not finite spoils the whole picture.
    if not (np.isfinite(places).all() and bool(torch.isfinite(color).all())):
        for picture in pictures:
            picture.fill(np.nan)
    return kept, marks


def pull_back(
    team: "Team",
    magnitude: Array,
    affine: Array,
    marks: Spans,
    reach: Spans,
    slope: Array,
    to_map: Array | None,
    to_affine: Array | None,
    width: int,
) -> None:
    """From gradients to the coverage, packed as `reach`, to those of the maps and places that are wanted."""
    every, columns = range(len(magnitude)), column_numbers(width, affine)
    if to_affine is not None:
        team.share(every, kernels.pull_to_affine, magnitude, affine, columns, marks, reach, slope, to_affine)
    if to_map is not None:
        team.share(every, kernels.pull_to_map, affine, columns, reach, slope, to_map)


def strips(affine: Array, boxes: Array, shape: tuple[int, ...]) -> Iterator[tuple[range, Spans]]:
    """The canvas [3, H, W] in strips of whole bands, each with the spans of about _STRIP packed pixels on it."""
    _, height, width = shape
    bands = -(-height // kernels.BAND)
    whole = find_spans(affine, boxes, range(height), width)
    count = min(bands, int(whole.offset[-1]) // _STRIP + 1)
    if count == 1:
        yield range(bands), whole
        return
    edges = [bands * k // count for k in range(count + 1)]
    for begin, end in pairwise(edges):
        rows = range(begin * kernels.BAND, min(end * kernels.BAND, height))
        yield range(begin, end), find_spans(affine, boxes, rows, width)


def _batches(pixels: Array) -> list[tuple[int, int]]:
    """Ranges of strokes of about _BATCH packed pixels each, at least one stroke; pixels [n + 1]."""
    batches, first = [], 0
    while first < len(pixels) - 1:
        last = max(first + 1, int(np.searchsorted(pixels, pixels[first] + _BATCH, side="right")) - 1)
        batches.append((first, last))
        first = last
    return batches


def column_numbers(width: int, like: Array) -> Array:
    """0, 1, 2, ..., some lanes beyond the width, because samples are located in whole vectors."""
    return np.arange(width + kernels.LANES, dtype=like.dtype)


def array(tensor: Tensor) -> Array:
    """The numbers of a tensor, without its gradient."""
    return tensor.detach().contiguous().numpy()


class Team:
    """As many threads as torch has been given, for as long as the `with` lasts; none for one."""

    def __enter__(self) -> "Team":
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
        pieces = min(len(whole), self.threads * _PIECES_PER_THREAD)
        edges = [whole[len(whole) * k // pieces] for k in range(pieces)] + [whole.stop]
        running = [self.pool.submit(kernel, begin, end, *arguments) for begin, end in pairwise(edges)]
        for piece in running:
            piece.result()
