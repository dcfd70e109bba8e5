"""The goal: what a person wants to see on the canvas, as weighted terms."""

import math
from dataclasses import dataclass

from torch import Tensor

from frida_painter.errors import ConfigError


@dataclass(frozen=True)
class ImageTerm:
    """Paint this picture: `image` [3, H, W] in [0, 1], mattering by `weight` > 0. Raises ConfigError."""

    image: Tensor
    weight: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.weight < math.inf:
            raise ConfigError(f"A weight of {self.weight} was given to a picture; weights are above 0 and finite.")


@dataclass(frozen=True)
class Goal:
    """One or more terms that are pursued together. Raises ConfigError where there is none."""

    terms: tuple[ImageTerm, ...]

    def __post_init__(self) -> None:
        if not self.terms:
            raise ConfigError("A goal without any term was given; name at least one picture to paint.")
