"""Gauss and Newton's method: a few numbers that explain a picture best, together with what was known of them before."""

from collections.abc import Callable

import torch
from torch import Tensor


def gauss_newton(
    residual: Callable[[Tensor], Tensor], prior: Tensor, certainty: Tensor, steps: Tensor, alike: float, rounds: int
) -> tuple[Tensor, Tensor]:
    """The numbers [k] that leave least, and their information [k, k], the inverse of their covariance; float64.

    residual: from the numbers to what they leave unexplained [m]; prior [k]: what they were believed to be, with
    information `certainty` [k, k]; steps [k]: at which slopes are taken; alike: how many of the m err together, so
    that they tell as much as one. It ends after so many rounds, or where one leaves no less than the one before.
    """
    numbers, left, information = prior, residual(prior), certainty
    for _ in range(rounds):
        each = [(residual(numbers - step) - residual(numbers + step)) / (2 * step.sum()) for step in torch.diag(steps)]
        slope = torch.stack(each, 1)  # [m, k], of the picture
        noise = left.square().mean().clamp(min=1e-8) * alike
        information = certainty + slope.T @ slope / noise
        pull = slope.T @ left / noise + certainty @ (prior - numbers)
        nearer = numbers + torch.linalg.solve(information, pull)
        remaining = residual(nearer)
        if not remaining.square().sum() < left.square().sum():
            break
        numbers, left = nearer, remaining
    return numbers, information
