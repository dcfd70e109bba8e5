"""The goal: what a person wants to see on the canvas, as weighted terms."""

import math
from dataclasses import dataclass

from torch import Tensor

from frida_painter.errors import ConfigError

_FLAT = 0.01  # standard deviation under which a picture is of one colour


@dataclass(frozen=True)
class ImageTerm:
    """Paint this picture: `image` [3, H, W] in [0, 1], mattering by `weight` > 0. Raises ConfigError."""

    image: Tensor
    weight: float = 1.0

    def __post_init__(self) -> None:
        _require_weight(self.weight, "a picture")


@dataclass(frozen=True)
class StyleTerm:
    """Paint in the style of this picture: `image` [3, H, W] in [0, 1], more than one colour. Raises ConfigError."""

    image: Tensor
    weight: float = 1.0

    def __post_init__(self) -> None:
        _require_weight(self.weight, "a style")
        if not float(self.image.flatten(1).std(1).max()) >= _FLAT:
            raise ConfigError("A style picture of a single colour was given, which has no style; give another picture.")


@dataclass(frozen=True)
class SemanticTerm:
    """Paint what this picture shows rather than its pixels: `image` [3, H, W] in [0, 1]. Raises ConfigError."""

    image: Tensor
    weight: float = 1.0

    def __post_init__(self) -> None:
        _require_weight(self.weight, "a picture to be painted by its meaning")


Term = ImageTerm | StyleTerm | SemanticTerm


@dataclass(frozen=True)
class Goal:
    """One or more terms that are pursued together. Raises ConfigError where there is none.

    initial: terms that are pursued first, so that their composition stays (paper, Algorithm 1).
    """

    terms: tuple[Term, ...]
    initial: tuple[Term, ...] = ()

    def __post_init__(self) -> None:
        if not self.terms:
            raise ConfigError("A goal without any term was given; name at least one picture to paint.")

    @property
    def opening(self) -> tuple[Term, ...]:
        """What a plan begins with: the initial terms, or the pictures to paint, or else whatever there is.

        These are the goal's own terms, and the same tuple, where it has nothing but pictures.
        """
        if not self.initial and all(isinstance(term, ImageTerm) for term in self.terms):
            return self.terms
        pictures = tuple(term for term in self.terms if isinstance(term, ImageTerm))
        meanings = tuple(ImageTerm(term.image, term.weight) for term in self.terms if isinstance(term, SemanticTerm))
        styles = tuple(ImageTerm(term.image, term.weight) for term in self.terms if isinstance(term, StyleTerm))
        return self.initial or pictures or meanings or styles


def _require_weight(weight: float, what: str) -> None:
    if not 0 < weight < math.inf:
        raise ConfigError(f"A weight of {weight} was given to {what}; weights are above 0 and finite.")
