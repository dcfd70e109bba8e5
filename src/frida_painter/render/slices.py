"""The renderer in plain PyTorch: each stroke touches only the slice of the canvas that its map reaches.

For CUDA, and for machines without numba. Equals `reference.composite`, with gradients written out
by hand so that one coverage per stroke slice is all that is kept. See docs/renderer.md.
"""

import math
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn.functional import grid_sample, pad

Box = tuple[int, int, int, int]  # rows [top, bottom), columns [left, right)


def composite(magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor) -> Tensor:
    """Lays strokes over a canvas in order; signature and meaning of `reference.composite`.

    magnitude [n, h, w], affine [n, 2, 3], color [n, 3], canvas [3, H, W] -> [3, H, W], on the
    device and in the precision of `canvas`; differentiable (once) in all four.
    """
    magnitude, affine, color = magnitude.to(canvas.dtype), affine.to(canvas.dtype), color.to(canvas.dtype)
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in (magnitude, affine, color, canvas)):
        apply: Callable[..., Tensor] = _Slices.apply
        return apply(magnitude, affine, color, canvas)
    boxes = boxes_of(affine, magnitude.shape[1:], canvas.shape[1:])
    return _lay(magnitude, affine, color, canvas, boxes, kept=None)


def boxes_of(affine: Tensor, cells: torch.Size, pixels: torch.Size) -> list[Box]:
    """For each stroke a box of pixels that holds every pixel whose sample can fall on its map.

    affine [n, 2, 3]; cells (h, w) of a map and pixels (H, W) of the canvas. Strokes off the
    canvas get an empty box.
    """
    height, width = pixels
    (a, b, c), (d, e, f) = affine.detach().double().unbind(1)[0].unbind(1), affine.detach().double()[:, 1].unbind(1)
    determinant = a * e - b * d
    # Rounding in the map's coordinates moves the border by this many cells at most.
    slack = 8 * torch.finfo(affine.dtype).eps * (affine.detach().double().abs().sum((1, 2)) * max(height, width))
    left, right = -1 - slack - c, cells[1] + slack - c
    above, below = -1 - slack - f, cells[0] + slack - f

    def span(from_column: Tensor, from_row: Tensor, pixels: int) -> tuple[list[int], list[int]]:
        across = torch.stack((from_column * left, from_column * right))
        down = torch.stack((from_row * above, from_row * below))
        least, most = across.amin(0) + down.amin(0), across.amax(0) + down.amax(0)
        # A map that is squeezed flat has no inverse: then nothing is known, and all is looked at.
        first = torch.where(least.isfinite(), least.floor(), 0).clamp(0, pixels)
        past = torch.where(most.isfinite(), most.ceil() + 1, pixels).clamp(0, pixels)
        return first.long().tolist(), past.long().tolist()

    lefts, rights = span(e / determinant, -b / determinant, width)
    tops, bottoms = span(-d / determinant, a / determinant, height)
    return list(zip(tops, bottoms, lefts, rights, strict=True))


def _power_of_two(cells: int) -> int:
    """The power of two that is at least `cells` - 1 and at least 2."""
    return 2 ** max(1, math.ceil(math.log2(max(cells - 1, 1))))


class _Marks:
    """Samples maps over boxes, and takes gradients back to map and affine.

    grid_sample counts in [-1, 1]. On a map padded to 2^k + 1 cells the way there and back is a shift
    of the exponent, so that samples on whole cells, where the gradient jumps, stay on them.
    """

    def __init__(self, magnitude: Tensor, affine: Tensor, canvas: Tensor) -> None:
        self.magnitude = magnitude
        height, width = magnitude.shape[1:]
        self.sides = _power_of_two(height), _power_of_two(width)
        self.half = affine.new_tensor([self.sides[1] / 2, self.sides[0] / 2])
        self.affine = affine / self.half[:, None]
        self.column = torch.arange(canvas.shape[2], dtype=canvas.dtype, device=canvas.device)
        self.row = torch.arange(canvas.shape[1], dtype=canvas.dtype, device=canvas.device)

    def _map(self, i: int) -> Tensor:
        height, width = self.magnitude.shape[1:]
        return pad(self.magnitude[i], (0, self.sides[1] + 1 - width, 0, self.sides[0] + 1 - height))[None, None]

    def _grid(self, i: int, box: Box) -> Tensor:
        top, bottom, left, right = box
        place = self.affine[i]  # [2, 3]
        across, down = place[:, 0, None] * self.column[left:right], place[:, 1, None] * self.row[top:bottom]
        grid = across[:, None, :] + down[:, :, None]  # [2, h', w']
        return grid.add_(place[:, 2, None, None]).sub_(1).permute(1, 2, 0)[None]

    def alpha(self, i: int, box: Box) -> Tensor:
        """Coverage of stroke i over its box, [h', w']."""
        return grid_sample(self._map(i), self._grid(i, box), padding_mode="zeros", align_corners=True)[0, 0]

    def pull_back(self, slope: Tensor, i: int, box: Box, wanted: list[bool]) -> tuple[Tensor | None, Tensor | None]:
        """Gradients to map [h, w] and affine [2, 3] of stroke i, from that to its coverage [h', w']."""
        top, bottom, left, right = box
        to_map, to_grid = torch.ops.aten.grid_sampler_2d_backward(
            slope[None, None], self._map(i), self._grid(i, box), 0, 0, True, wanted
        )
        height, width = self.magnitude.shape[1:]
        map_part = to_map[0, 0, :height, :width] if wanted[0] else None
        if not wanted[1]:
            return map_part, None
        by_column, by_row = to_grid[0].sum(0), to_grid[0].sum(1)  # [w', 2], [h', 2]
        parts = (self.column[left:right] @ by_column, self.row[top:bottom] @ by_row, by_row.sum(0))
        return map_part, torch.stack(parts, -1) / self.half[:, None]


def _empty(box: Box) -> bool:
    top, bottom, left, right = box
    return top >= bottom or left >= right


def _lay(
    magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor, boxes: list[Box], kept: list[Tensor] | None
) -> Tensor:
    """The picture; each stroke's coverage is appended to `kept` if that is given."""
    marks = _Marks(magnitude, affine, canvas)
    picture = canvas.detach().clone(memory_format=torch.contiguous_format)
    for i, box in enumerate(boxes):
        if _empty(box):
            continue
        top, bottom, left, right = box
        alpha = marks.alpha(i, box)
        picture[:, top:bottom, left:right].lerp_(color[i, :, None, None], alpha)
        if kept is not None:
            kept.append(alpha)
    return picture


class _Slices(torch.autograd.Function):
    """`composite` with its gradients (derived in docs/renderer.md)."""

    @staticmethod
    def forward(ctx: Any, magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor) -> Tensor:
        boxes = boxes_of(affine, magnitude.shape[1:], canvas.shape[1:])
        alphas: list[Tensor] = []
        picture = _lay(magnitude, affine, color, canvas, boxes, kept=alphas)
        ctx.save_for_backward(magnitude, affine, color, canvas, *alphas)
        ctx.boxes = boxes
        return picture

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        magnitude, affine, color, canvas, *alphas = ctx.saved_tensors
        wants_map, wants_affine, wants_color, wants_canvas = ctx.needs_input_grad
        visible = [(i, box) for i, box in enumerate(ctx.boxes) if not _empty(box)]
        gradient = gradient.contiguous()
        marks = _Marks(magnitude, affine, canvas)
        to_map = torch.zeros_like(magnitude) if wants_map else None
        to_affine = torch.zeros_like(affine) if wants_affine else None
        to_color = torch.zeros_like(color)
        slopes: list[Tensor] = []
        if wants_map or wants_affine:
            slopes = _slopes(gradient, color, canvas, visible, alphas)
        through = torch.ones_like(canvas[0])  # [H, W], what the strokes above let through
        for k in reversed(range(len(visible))):
            i, (top, bottom, left, right) = visible[k]
            seen = through[top:bottom, left:right]
            if slopes:
                parts = marks.pull_back(slopes.pop().mul_(seen), i, visible[k][1], [wants_map, wants_affine])
                for total, part in zip((to_map, to_affine), parts, strict=True):
                    if total is not None and part is not None:
                        total[i] = part
            share = seen * alphas[k]
            if wants_color:
                to_color[i] = (gradient[:, top:bottom, left:right] * share).sum((1, 2))
            seen.sub_(share)
        return to_map, to_affine, to_color if wants_color else None, gradient * through if wants_canvas else None


def _slopes(
    gradient: Tensor, color: Tensor, canvas: Tensor, visible: list[tuple[int, Box]], alphas: list[Tensor]
) -> list[Tensor]:
    """g . (c - C) over each stroke's box, where C is the picture just below it: [h', w'] each.

    Only the scalar g . C is carried from stroke to stroke, never the colours.
    """
    below = (gradient * canvas).sum(0)  # [H, W]
    paints = color.tolist()
    slopes = []
    for (i, (top, bottom, left, right)), alpha in zip(visible, alphas, strict=True):
        red, green, blue = gradient[:, top:bottom, left:right]
        under = below[top:bottom, left:right]
        slope = red * paints[i][0]
        slope.add_(green, alpha=paints[i][1]).add_(blue, alpha=paints[i][2]).sub_(under)
        under.addcmul_(alpha, slope)
        slopes.append(slope)
    return slopes
