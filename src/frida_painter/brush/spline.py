"""Uniform cubic B-splines on [0, 1]: where they are not zero, their weights, their slopes, and fitting them.

A spline of m spans has m + 3 coefficients; four of them matter at any place.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

_SAMPLES_PER_SPAN = 1.5


def weights(place: Tensor, spans: int) -> tuple[Tensor, Tensor, Tensor]:
    """place [n] in [0, 1] -> the first of the four coefficients [n], their weights [n, 4], and d weights / d place."""
    at = place * spans
    first = at.floor().clamp(0, spans - 1)
    t = at - first
    s = 1 - t
    weight = torch.stack((s**3, 4 - 6 * t**2 + 3 * t**3, 4 - 6 * s**2 + 3 * s**3, t**3), -1) / 6
    slope = torch.stack((-(s**2), 3 * t**2 - 4 * t, 4 * s - 3 * s**2, t**2), -1) * (spans / 2)
    return first.long(), weight, slope


def local(place: Tensor, spans: Sequence[int]) -> tuple[Tensor, list[Tensor], list[Tensor]]:
    """For points in a cube, place [3, n]: the 64 rows of the coefficients [n, 64], weights and slopes per axis."""
    parts = [weights(axis, pieces) for axis, pieces in zip(place, spans, strict=True)]
    step = torch.arange(4, device=place.device)
    outer, middle, inner = (part[0][:, None] + step for part in parts)  # [n, 4]
    row = (outer[:, :, None] * (spans[1] + 3) + middle[:, None, :])[..., None] * (spans[2] + 3)
    return (row + inner[:, None, None, :]).flatten(1), [part[1] for part in parts], [part[2] for part in parts]


def outer(first: Tensor, second: Tensor, third: Tensor) -> Tensor:
    """Products of all weights of three axes, 3 x [n, 4] -> [n, 64]."""
    return (first[:, :, None, None] * second[:, None, :, None] * third[:, None, None, :]).flatten(1)


def sample_grid(spans: int) -> Tensor:
    """Places in [0, 1] at which to sample what a spline of that many spans is to follow."""
    return torch.linspace(0, 1, round(_SAMPLES_PER_SPAN * spans) + 4, dtype=torch.float64)


def fit_matrix(grid: Tensor, spans: int) -> Tensor:
    """The matrix [spans + 3, samples] from samples on the grid to the coefficients that fit them best."""
    first, weight, _ = weights(grid.double(), spans)
    design = torch.zeros(len(grid), spans + 3, dtype=torch.float64, device=grid.device)
    design.scatter_(1, first[:, None] + torch.arange(4, device=grid.device), weight)
    return torch.linalg.pinv(design).to(grid)
