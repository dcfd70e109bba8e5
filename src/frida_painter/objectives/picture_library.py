"""Protocol of libraries of pictures with captions, from which words are composed."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from torch import Tensor


class PictureLibrary(Protocol):
    """Library of pictures with captions.

    credit: authors and licence; "" if nobody must be named
    is_own: True for the user's own pictures, which have priority
    """

    name: str
    credit: str
    is_own: bool

    def captions(self) -> Mapping[str, Sequence[str]]:
        """Returns each picture's captions by its file: a title, and possibly keywords after it.

        In the folders "subject", "ground" and "mood" all captions are titles. Grounds and moods fill the canvas.
        Raises WeightsError or ConfigError if the library cannot be read.
        """
        ...

    def picture(self, file: str) -> Tensor:
        """Returns a picture, colour and opacity [4, h, w] in [0, 1]. Raises ImageError."""
        ...
