"""What all training of stroke models has in common: who is held out, how far it has come, what it did."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from frida_painter.brush.library import StrokeLibrary
from frida_painter.brush.limits import FEWEST_STROKES
from frida_painter.errors import LibraryError

VALIDATION_SHARE = 0.2


@dataclass(frozen=True)
class TrainingProgress:
    """How far training has come: after `epoch` of at most `epochs`, mean absolute errors of the magnitude."""

    epoch: int
    epochs: int
    training_error: float
    validation_error: float
    best_error: float


@dataclass(frozen=True)
class TrainingReport:
    """What training did.

    best_epoch: the epoch whose weights were best; validation_error: their mean absolute error on
    strokes held out, over the whole map; held_out: indices of those strokes in the library;
    predicted [held out, rows, columns]: their marks as those weights drew them; curve: every epoch's
    progress.
    """

    best_epoch: int
    validation_error: float
    held_out: NDArray[np.int64]
    predicted: Tensor
    curve: tuple[TrainingProgress, ...]


@dataclass(frozen=True)
class Split:
    """Indices of the strokes to learn from and of those that are held out for validation, in random order."""

    training: NDArray[np.int64]
    held_out: NDArray[np.int64]

    @classmethod
    def of(cls, library: StrokeLibrary, chance: torch.Generator) -> "Split":
        """A fifth is held out (paper, "Brush Stroke Model"). Raises LibraryError for fewer than 5 strokes."""
        require_enough(library)
        order = torch.randperm(len(library), generator=chance).numpy()
        count = max(1, round(VALIDATION_SHARE * len(library)))
        return cls(order[count:], order[:count])


def require_enough(library: StrokeLibrary) -> None:
    """Raises LibraryError where there are fewer than 5 strokes."""
    if len(library) < FEWEST_STROKES:
        raise LibraryError(
            f"The stroke library has {len(library)} strokes to learn from; training needs at least {FEWEST_STROKES}, "
            "and about 100 for a good model."
        )


class Best:
    """The best weights so far, by their validation error."""

    def __init__(self, model: nn.Module) -> None:
        self.model = model
        self.error = float("inf")
        self.epoch = 0
        self._weights = _copy(model)

    def see(self, epoch: int, error: float) -> None:
        """Keeps the model's weights of now if their error is the least."""
        if error < self.error:
            self.error, self.epoch, self._weights = error, epoch, _copy(self.model)

    def restore(self) -> None:
        """Puts the best weights back into the model."""
        self.model.load_state_dict(self._weights)


def _copy(model: nn.Module) -> dict[str, Tensor]:
    return {name: tensor.detach().clone() for name, tensor in model.state_dict().items()}
