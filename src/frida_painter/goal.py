"""The goal: what a person wants to see on the canvas, as weighted terms."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import torch
from torch import Tensor

from frida_painter.drawing import broadened, cleaned, colored, ink
from frida_painter.errors import ConfigError

_FLAT = 0.01  # standard deviation under which a picture is of one colour
_FEWEST = 2e-4  # of a drawing's pixels that are a line; fewer are a speck
_BROAD = 1 / 40  # of a canvas's shorter side: about as fine as brushes paint


@dataclass(frozen=True)
class ImageTerm:
    """Paint this picture: `image` [3, H, W] in [0, 1], mattering by `weight` > 0. Raises ConfigError.

    importance [h, w]: how much each of its places matters, 1 in the mean; None: all the same.
    """

    image: Tensor
    weight: float = 1.0
    importance: Tensor | None = None

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


@dataclass(frozen=True)
class SketchTerm:
    """Paint along the lines of this drawing: `image` [3, H, W] in [0, 1], with at least one line. Raises ConfigError.

    Dark lines on light paper, scanned or photographed, or chalk on a dark board. shown [3, h, w]: the
    drawing on a photograph that is painted with it; None: on white paper.
    """

    image: Tensor
    weight: float = 1.0
    shown: Tensor | None = None

    def __post_init__(self) -> None:
        _require_weight(self.weight, "a sketch")
        if not float(ink(cleaned(self.image)).float().mean()) >= _FEWEST:
            raise ConfigError(
                "A sketch without a single line was given; give a drawing of dark lines on light paper, or of chalk."
            )

    @property
    def drawing(self) -> Tensor:
        """The lines on white paper, no finer than brushes paint, [3, H, W] in [0, 1]."""
        return broadened(cleaned(self.image), _BROAD)


@dataclass(frozen=True)
class TextTerm:
    """Paint what these words say: `prompt`, one line of them. Raises ConfigError."""

    prompt: str
    weight: float = 1.0

    def __post_init__(self) -> None:
        _require_weight(self.weight, "words")
        if not self.prompt.strip():
            raise ConfigError("Words to paint were given that are empty; say what shall be painted.")


Term = ImageTerm | StyleTerm | SemanticTerm | SketchTerm | TextTerm


@dataclass(frozen=True)
class Goal:
    """One or more terms that are pursued together. Raises ConfigError where there is none.

    initial: terms that are pursued first, so that their composition stays (paper, Algorithm 1). A style among them is
    begun with as the picture that it is.
    """

    terms: tuple[Term, ...]
    initial: tuple[Term, ...] = ()

    def __post_init__(self) -> None:
        if not self.terms:
            raise ConfigError("A goal without any term was given; name at least one picture or some words to paint.")

    def to(self, device: torch.device) -> Self:
        """The goal with its pictures on that device."""
        return replace(
            self,
            terms=tuple(_moved(term, device) for term in self.terms),
            initial=tuple(_moved(term, device) for term in self.initial),
        )

    @cached_property
    def opening(self) -> tuple[Term, ...]:
        """What a plan begins with: the initial terms, or the pictures to paint, the sketches, or whatever there is.

        These are the goal's own terms, and the same tuple, where it has nothing but pictures.
        """
        if not self.initial and all(isinstance(term, ImageTerm) for term in self.terms):
            return self.terms
        pictures = tuple(term for term in self.terms if isinstance(term, ImageTerm))
        meanings = tuple(ImageTerm(term.image, term.weight) for term in self.terms if isinstance(term, SemanticTerm))
        styles = tuple(ImageTerm(term.image, term.weight) for term in self.terms if isinstance(term, StyleTerm))
        begun = tuple(
            ImageTerm(term.image, term.weight) if isinstance(term, StyleTerm) else term for term in self.initial
        )
        return begun or pictures or self._sketched() or meanings or styles or self.terms

    def _sketched(self) -> tuple[ImageTerm, ...]:
        """The sketches as pictures: filled with the colours of the first style, where there is one."""
        style = next((term for term in self.terms if isinstance(term, StyleTerm)), None)
        sketches = [term for term in self.terms if isinstance(term, SketchTerm)]
        return tuple(
            ImageTerm(term.drawing if style is None else colored(term.drawing, style.image), term.weight)
            for term in sketches
        )


def _moved(term: Term, device: torch.device) -> Term:
    """A term, of these or of one's own kind, with its pictures on that device."""
    pictures: dict[str, Any] = {name: part.to(device) for name, part in vars(term).items() if isinstance(part, Tensor)}
    return replace(term, **pictures) if pictures else term


def _require_weight(weight: float, what: str) -> None:
    if not 0 < weight < math.inf:
        raise ConfigError(f"A weight of {weight} was given to {what}; weights are above 0 and finite.")
