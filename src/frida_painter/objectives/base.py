"""What an objective is, and how the terms of a goal become one."""

from collections.abc import Callable
from typing import Protocol

from torch import Tensor

from frida_painter.frames import PixelGrid
from frida_painter.goal import Goal
from frida_painter.objectives.replication import replication


class Objective(Protocol):
    """Judges a picture of the canvas: the less, the nearer to the goal. Differentiable."""

    def __call__(self, picture: Tensor) -> Tensor:
        """picture [3, H, W] in [0, 1] -> a number."""


def prepare(goal: Goal, grid: PixelGrid) -> Objective:
    """The weighted sum of the goal's terms for pictures of that grid (paper, Eq. for p_next).

    Targets are prepared here, once, and not at every step.
    """
    terms: list[tuple[float, Callable[[Tensor], Tensor]]] = [
        (term.weight, replication(term.image, grid)) for term in goal.terms
    ]

    def objective(picture: Tensor) -> Tensor:
        total = picture.new_zeros(())
        for weight, judge in terms:
            total = total + weight * judge(picture)
        return total

    return objective
