"""Renderer for the CPU: compiled scanlines that touch only the pixels of the strokes.

Equals `reference.composite`. The loops are in kernels.py; docs/explanation/renderer.md derives the gradients.
This module does not compute with torch, because torch's threads spin after each operation and would take the
cores.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from frida_painter.brush.kinds import CoverageSpread
from frida_painter.render import kernels
from frida_painter.render.kernels import Array, Spans, find_spans, painted_boxes, whole_maps
from frida_painter.system.devices import array

# Number of packed pixels in a batch, few enough for the cache.
_BATCH = 2**18
_PIECES_PER_THREAD = 4


def composite(
    magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor, *, bare_cells_answer: bool = True
) -> Tensor:
    """Paints strokes in order on a canvas, as `reference.composite`.

    magnitude [n, h, w], affine [n, 2, 3], color [n, 3], canvas [3, H, W]: on the CPU, see `reference.composite`
    bare_cells_answer: True to compute the gradient of cells outside the smallest box with all paint of a map.
    It is not zero, but a stroke model that keeps bare cells at zero multiplies it by zero. False saves a third
    of the time.
    Returns the picture [3, H, W] in the precision of `canvas` (float32 or float64). Differentiable once in all
    four tensors.

    If an affine map or a colour is not finite, the whole picture is NaN. Runs on torch's number of threads; the
    bits are the same for any number.
    """
    return _paint(magnitude, affine, color, (canvas,), None, bare_cells_answer)[0]


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

    Tensors, threads and `bare_cells_answer` as in `composite`. Differentiable once in all five tensors.
    """
    moments = canvas, torch.zeros_like(canvas[0]) if variance is None else variance
    mean, variance = _paint(magnitude, affine, color, moments, spread, bare_cells_answer)
    return mean, variance


def _paint(
    magnitude: Tensor,
    affine: Tensor,
    color: Tensor,
    pictures: tuple[Tensor, ...],
    spread: CoverageSpread | None,
    bare_cells_answer: bool,
) -> tuple[Tensor, ...]:
    """Returns the pictures after the strokes: the canvas; or mean and variance, if there is a `spread`."""
    tensors = *(tensor.to(pictures[0].dtype) for tensor in (magnitude, affine, color)), *pictures
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in tensors):
        apply: Callable[..., tuple[Tensor, ...]] = _Scanlines.apply
        return apply(spread, bare_cells_answer, *tensors)
    return _lay(spread, *tensors)[0]


class _Scanlines(torch.autograd.Function):
    """`_paint` with gradients. The forward pass keeps three numbers for each covered pixel."""

    @staticmethod
    def forward(
        ctx: Any, spread: CoverageSpread | None, bare_cells_answer: bool, magnitude: Tensor, *others: Tensor
    ) -> tuple[Tensor, ...]:
        whole = bare_cells_answer and ctx.needs_input_grad[2]
        painted, laid = _lay(spread, magnitude, *others, keep=True, whole=whole)
        ctx.spread = spread
        ctx.save_for_backward(torch.from_numpy(laid.sampled), magnitude, *others)
        ctx.laid = laid._replace(sampled=laid.sampled[:, :0])
        return painted

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        sampled, magnitude, affine, color, *pictures = (array(tensor) for tensor in ctx.saved_tensors)
        _, _, wants_map, wants_affine, *_ = ctx.needs_input_grad
        laid: _Laid = ctx.laid._replace(sampled=sampled)
        bands = _bands_of(pictures[0])
        to_color = np.zeros((len(bands), *color.shape), color.dtype)
        given = laid.spans, sampled[0], color
        to_pictures: tuple[Array, ...]
        to_affine = np.zeros_like(affine[: None if wants_affine else 0])
        to_map = np.empty_like(magnitude[: None if wants_map else 0])
        with Team() as team:
            if ctx.spread is None:
                gradient, through = array(gradients[0]), np.ones_like(pictures[0][0])
                slope = np.empty(sampled.shape[1] if wants_map or wants_affine else 0, color.dtype)
                team.share(bands, kernels.pull_through, *given, *pictures, gradient, through, slope, to_color)
                to_pictures = (gradient * through,)
            else:
                to_pictures, slope = tuple(array(each).copy() for each in gradients), np.empty_like(sampled[0])
                blur = _numbers(ctx.spread, color)
                team.share(bands, kernels.pull_through_moments, *given, blur, *pictures, *to_pictures, slope, to_color)
            if wants_affine or wants_map:
                width = int(laid.spans.first.max(initial=0) + np.diff(laid.spans.offset).max(initial=0))
                places = affine, laid.boxes, _column_numbers(width, affine), laid.spans, laid.sampled
                strokes = range(len(magnitude))
                team.share(strokes, kernels.scatter_to_strokes, *places, slope, to_affine, to_map)
        every = zip((to_map, to_affine, to_color.sum(0), *to_pictures), ctx.needs_input_grad[2:], strict=True)
        return None, None, *(torch.from_numpy(each) if wants else None for each, wants in every)


def _numbers(spread: CoverageSpread, like: Array) -> tuple[Any, Any]:
    """Returns share and full of `spread` in the precision of an array, so that the loops compute in it."""
    return like.dtype.type(spread.share), like.dtype.type(spread.full)


class _Laid(NamedTuple):
    """Places of the pixels of painted strokes.

    spans: packed pixels
    sampled [3, packed]: coverage, and its derivatives along map columns and map rows
    boxes [n, 4]: boxes of the cells that count
    """

    spans: Spans
    sampled: Array
    boxes: Array


def _lay(
    spread: CoverageSpread | None,
    magnitude: Tensor,
    affine: Tensor,
    color: Tensor,
    *below: Tensor,
    keep: bool = False,
    whole: bool = False,
) -> tuple[tuple[Tensor, ...], _Laid]:
    """Samples the strokes batch by batch and paints them; returns the pictures, and the places of the strokes.

    below: pictures before the strokes: the canvas; or mean and variance, if there is a `spread`
    keep: True to keep the coverage of all batches, not only of one
    whole: True if cells without paint count as well
    """
    maps, places, pictures = array(magnitude), array(affine), [array(each).copy() for each in below]
    arguments = array(color), *(() if spread is None else (_numbers(spread, pictures[0]),)), *pictures
    blend = kernels.blend if spread is None else kernels.blend_moments
    _, height, width = pictures[0].shape
    boxes = whole_maps(maps) if whole else painted_boxes(maps)
    spans = find_spans(places, boxes, height, width)
    pixels = spans.offset[spans.segment]  # [n + 1], start of each stroke's packed pixels
    batches = _batches(pixels)
    largest = max((int(pixels[last] - pixels[first]) for first, last in batches), default=0)
    sampled = np.empty((3, spans.pixels if keep else largest), maps.dtype)
    columns, bands = _column_numbers(width, places), _bands_of(pictures[0])
    with Team() as team:
        for first, last in batches:
            base = 0 if keep else int(pixels[first])
            team.share(range(first, last), kernels.sample, maps, places, boxes, columns, spans, base, sampled)
            team.share(bands, blend, (first, last), spans, base, sampled[0], *arguments)
    # The reference paints every pixel, so one value that is not finite makes the whole picture NaN.
    if not (np.isfinite(places).all() and bool(torch.isfinite(color).all())):
        for picture in pictures:
            picture.fill(np.nan)
    return tuple(map(torch.from_numpy, pictures)), _Laid(spans, sampled, boxes)


def _bands_of(picture: Array) -> range:
    """Returns the range of band numbers of a picture [3, H, W]."""
    return range(-(-picture.shape[1] // kernels.BAND))


def _batches(pixels: Array) -> list[tuple[int, int]]:
    """Returns ranges of strokes of about _BATCH packed pixels, at least one stroke each.

    pixels [n + 1]: start of each stroke's packed pixels
    """
    batches, first = [], 0
    while first < len(pixels) - 1:
        last = max(first + 1, int(np.searchsorted(pixels, pixels[first] + _BATCH, side="right")) - 1)
        batches.append((first, last))
        first = last
    return batches


def _column_numbers(width: int, like: Array) -> Array:
    """Returns 0, 1, 2, ...; longer than `width`, because samples are located in whole vectors."""
    return np.arange(width + kernels.LANES, dtype=like.dtype)


class Team:
    """Threads for the kernels, for a `with` block: as many as torch uses. With one thread it starts none."""

    def __enter__(self) -> "Team":
        self.threads = torch.get_num_threads()
        self.pool = ThreadPoolExecutor(self.threads) if self.threads > 1 else None
        return self

    def __exit__(self, *_: object) -> None:
        if self.pool is not None:
            self.pool.shutdown()

    def share(self, whole: range, kernel: Callable[..., None], *arguments: object) -> None:
        """Runs kernel(begin, end, *arguments) over parts of the range `whole`."""
        if self.pool is None:
            kernel(whole.start, whole.stop, *arguments)
            return
        pieces = min(len(whole), self.threads * _PIECES_PER_THREAD)
        edges = [whole[len(whole) * k // pieces] for k in range(pieces)] + [whole.stop]
        running = [self.pool.submit(kernel, begin, end, *arguments) for begin, end in pairwise(edges)]
        for piece in running:
            piece.result()
