"""What an objective is, and what the objectives of a painting are prepared for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:  # kinds of goals are known, and asked for, where nothing is planned
    from torch import Tensor

    from frida_painter.frames import PixelGrid, Rows
    from frida_painter.objectives.encoders.registry import EncoderRegistry


class Objective(Protocol):
    """Judges a picture of the canvas: the less, the nearer to the goal. Differentiable."""

    def __call__(self, picture: Tensor, variance: Tensor | None = None) -> Tensor:
        """picture [3, H, W] in [0, 1] -> a number.

        variance [H, W]: of the pixels about the picture, which then is the mean of what may come; what is
        judged is the expectation, as far as the goal can tell it.
        """


@dataclass(frozen=True)
class ObjectiveContext:
    """What objectives are prepared for: the pictures' grid, the networks at hand, the run's seed.

    begun [3, H, W]: the picture of that grid that a painting begins with, where the goal has one beside its terms.
    sharpness: how much sharper than its photographs a painting is planned (objectives/sharpening.py).
    """

    grid: PixelGrid
    encoders: EncoderRegistry
    seed: int
    begun: Tensor | None = None
    sharpness: float = 0.0


@dataclass(frozen=True)
class ObjectiveTerm:
    """One term, ready to judge pictures.

    validation: where the objective looks at a picture in another way every time, or could be fooled,
    what says in the end whether a picture is good: steady, and best by a network kept aside.
    of_variance: what pixels that vary by so much [H, W] about a picture add to its objective on average, exact for
    squared errors; None where that is not known.
    recognizes: whether the validation says how far a picture is from being recognised as what is meant.
    on_rows: the term for pictures that have some rows of the grid only, where the objective is a mean over pixels; None
    where it is not.
    """

    objective: Callable[[Tensor], Tensor]
    validation: Callable[[Tensor], Tensor] | None = None
    of_variance: Callable[[Tensor], Tensor] | None = None
    recognizes: bool = False
    on_rows: Callable[[Rows], ObjectiveTerm] | None = None
