"""Reference renderer, as in the paper: one stroke after another, each over the whole canvas.

It is written for readers and checks the fast renderers, which have the same signature.
"""

from collections.abc import Iterator

import torch
from torch import Tensor

from frida_painter.brush.kinds import CoverageSpread


def composite(
    magnitude: Tensor, affine: Tensor, color: Tensor, canvas: Tensor, *, bare_cells_answer: bool = True
) -> Tensor:
    """Paints strokes in order on a canvas (paper, Fig. "process of rendering a stroke").

    magnitude [n, h, w]: coverage maps in [0, 1], zero outside
    affine [n, 2, 3]: maps from canvas pixels (column, row, 1) to map cells (column, row)
    color [n, 3]: sRGB in [0, 1]
    canvas [3, H, W]: picture before the strokes
    bare_cells_answer: for the fast renderers; here all cells have their gradient
    Returns the picture [3, H, W]. Differentiable in all four tensors.
    """
    picture = canvas
    for alpha, paint in zip(_cover(magnitude, affine, canvas), color, strict=True):
        picture = picture * (1 - alpha) + paint[:, None, None] * alpha
    return picture


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
    """Returns mean [3, H, W] and variance [H, W] of the picture for strokes of uncertain coverage. Differentiable.

    magnitude [n, h, w]: mean coverage of each stroke in [0, 1]
    spread: variance of the coverage; strokes vary independently
    affine, color, canvas, bare_cells_answer: as in `composite`
    variance [H, W]: variance of the canvas, mean over the channels, if strokes are on it already; None for zero

    With coverage a of mean m and variance v, C' = C - a (C - c), and a and C independent:
    E[C'] = M - m (M - c), Var[C'] = ((1 - m)^2 + v) Var[C] + v (M - c)^2.
    The factors are the same for all channels, so the formula also holds for the means over the channels of
    Var[C] and (M - c)^2.
    """
    mean, variance = canvas, torch.zeros_like(canvas[0]) if variance is None else variance
    for cover, paint in zip(_cover(magnitude, affine, canvas), color, strict=True):
        doubt = spread.variance(cover)
        away = mean - paint[:, None, None]
        variance = ((1 - cover).square() + doubt) * variance + doubt * away.square().mean(0)
        mean = mean - cover * away
    return mean, variance


def _cover(magnitude: Tensor, affine: Tensor, canvas: Tensor) -> Iterator[Tensor]:
    """Yields the coverage [H, W] of each stroke on a canvas [3, H, W]."""
    _, height, width = canvas.shape
    column = torch.arange(width, dtype=canvas.dtype, device=canvas.device).expand(height, width)
    row = torch.arange(height, dtype=canvas.dtype, device=canvas.device)[:, None].expand(height, width)
    for mark, place in zip(magnitude, affine, strict=True):
        map_column = place[0, 0] * column + place[0, 1] * row + place[0, 2]  # [H, W]
        map_row = place[1, 0] * column + place[1, 1] * row + place[1, 2]  # [H, W]
        yield bilinear(mark, map_column, map_row)


def bilinear(mark: Tensor, column: Tensor, row: Tensor) -> Tensor:
    """Samples a map [h, w] at fractional cells [...]; all cells outside the map are zero."""
    height, width = mark.shape
    left, above = torch.floor(column).detach(), torch.floor(row).detach()
    right_share, below_share = column - left, row - above

    def cell(row_index: Tensor, column_index: Tensor) -> Tensor:
        inside = (row_index >= 0) & (row_index < height) & (column_index >= 0) & (column_index < width)
        value = mark[row_index.clamp(0, height - 1).long(), column_index.clamp(0, width - 1).long()]
        return torch.where(inside, value, torch.zeros_like(value))

    upper = cell(above, left) * (1 - right_share) + cell(above, left + 1) * right_share
    lower = cell(above + 1, left) * (1 - right_share) + cell(above + 1, left + 1) * right_share
    return upper * (1 - below_share) + lower * below_share
