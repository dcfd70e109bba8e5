"""How far one cloud of features lies from another: the Earth Mover's Distance, relaxed so that it can be descended.

Kolkin, Salavon and Shakhnarovich 2019 (STROTSS); Kusner et al. 2015 (the relaxation).
"""

import torch
from torch import Tensor

_SMALL = 1e-8


def cosine_cost(a: Tensor, b: Tensor) -> Tensor:
    """Cosine distances [n, m] in [0, 2] between rows of a [n, c] and b [m, c]; 1 from or to a row of zeros."""
    return 1 - _unit(a) @ _unit(b).T


def euclidean_cost(a: Tensor, b: Tensor) -> Tensor:
    """Distances [n, m] between rows of a [n, c] and b [m, c]; its slope is finite where rows are equal."""
    squared = a.square().sum(1)[:, None] + b.square().sum(1)[None] - 2 * a @ b.T
    return (squared.clamp(min=0) + _SMALL).sqrt()


def relaxed_emd(cost: Tensor) -> Tensor:
    """A lower bound of the Earth Mover's Distance for cost [n, m] between two clouds of equal weights.

    Each point goes where it is cheapest, in one direction or the other, whichever costs more.
    """
    return torch.maximum(cost.amin(1).mean(), cost.amin(0).mean())


def moment_distance(a: Tensor, b: Tensor) -> Tensor:
    """Mean absolute difference of the means, plus that of the covariances, of rows a [n, c] and b [m, c]."""
    mean_a, mean_b = a.mean(0), b.mean(0)
    covariance_a = (a - mean_a).T @ (a - mean_a) / len(a)
    covariance_b = (b - mean_b).T @ (b - mean_b) / len(b)
    return (mean_a - mean_b).abs().mean() + (covariance_a - covariance_b).abs().mean()


def _unit(rows: Tensor) -> Tensor:
    return rows / (rows.square().sum(1, keepdim=True) + _SMALL).sqrt()
