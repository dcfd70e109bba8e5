"""Protocol of libraries of pictures of things, from which words are composed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from torch import Tensor


@dataclass(frozen=True)
class Captioned:
    """Picture of a library with its captions.

    file: name of the picture
    captions: a title, and possibly keywords after it
    realism: from 0 for a sign to 1 for a photograph
    """

    file: str
    captions: tuple[str, ...]
    realism: float = 0.5


class PictureLibrary(Protocol):
    """Library of pictures with captions.

    credit: authors and licence; "" if nobody must be named
    is_own: True for the user's own pictures, which have priority
    """

    name: str
    credit: str
    is_own: bool

    def list_captioned(self) -> Sequence[Captioned]:
        """Returns all pictures. Raises WeightsError or ConfigError if the library cannot be read."""
        ...

    def pictures(self, file: str) -> list[Tensor]:
        """Returns the variants of a picture, colour and opacity [4, h, w] in [0, 1]. Raises ImageError."""
        ...
