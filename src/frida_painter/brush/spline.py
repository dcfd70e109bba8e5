"""Uniform cubic B-splines on [0, 1]: where they are not zero, their weights, and fitting them.

A spline of m spans has m + 3 coefficients; four of them matter at any place.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

_SAMPLES_PER_SPAN = 1.5


def weights(place: Tensor, spans: int) -> tuple[Tensor, Tensor]:
    """place [n] in [0, 1] -> the first of the four coefficients [n], and their weights [n, 4], differentiable."""
    at = place * spans
    first = at.detach().floor().clamp(0, spans - 1)
    t = at - first
    s = 1 - t
    weight = torch.stack((s**3, 4 - 6 * t**2 + 3 * t**3, 4 - 6 * s**2 + 3 * s**3, t**3), -1) / 6
    return first.long(), weight


def rows(first: Sequence[Tensor], knots: Sequence[int]) -> Tensor:
    """Of a cube with so many knots along each axis, the 64 rows [n, 64] around points: first, 3 x [n]."""
    step = torch.arange(4, device=first[0].device)
    outer, middle, inner = (axis[:, None] + step for axis in first)  # [n, 4]
    row = (outer[:, :, None] * knots[1] + middle[:, None, :])[..., None] * knots[2]
    return (row + inner[:, None, None, :]).flatten(1)


def outer(first: Tensor, second: Tensor, third: Tensor) -> Tensor:
    """Products of all weights of three axes, 3 x [n, 4] -> [n, 64]."""
    return (first[:, :, None, None] * second[:, None, :, None] * third[:, None, None, :]).flatten(1)


def sample_grid(spans: int) -> Tensor:
    """Places in [0, 1] at which to sample what a spline of that many spans is to follow."""
    return torch.linspace(0, 1, round(_SAMPLES_PER_SPAN * spans) + 4, dtype=torch.float64)


def fit_matrix(grid: Tensor, spans: int) -> Tensor:
    """The matrix [spans + 3, samples] from samples on the grid to the coefficients that fit them best."""
    first, weight = weights(grid.double(), spans)
    design = torch.zeros(len(grid), spans + 3, dtype=torch.float64, device=grid.device)
    design.scatter_(1, first[:, None] + torch.arange(4, device=grid.device), weight)
    return torch.linalg.pinv(design).to(grid)
