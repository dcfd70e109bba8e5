"""Protocols of encoders of words and pictures, and of libraries of pictures with captions."""

from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

from torch import Tensor


@runtime_checkable
class Reader(Protocol):
    """Encoder of words and pictures into one space; near vectors have similar meanings.

    name: name in messages
    side: rows and columns in pixels of the pictures that the network was made for
    """

    @property
    def name(self) -> str: ...  # noqa: D102

    @property
    def side(self) -> int: ...  # noqa: D102

    def reads_all(self, prompt: str) -> bool:
        """Returns True if all words are read, False if the last ones are cut off."""

    def embed_text(self, prompt: str) -> Tensor:
        """Returns the embedding of words: [d], of unit length. Cuts off words that are too many."""

    def embed_pictures(self, pictures: Tensor) -> Tensor:
        """Returns embeddings of pictures [n, 3, h, w], sRGB in [0, 1]: [n, d], each of unit length. Differentiable."""


@runtime_checkable
class Seer(Protocol):
    """Encoder of pictures into feature maps, layer by layer."""

    def features(self, views: Tensor) -> tuple[Tensor, ...]:
        """Returns feature maps [n, c, h', w'] of views [n, 3, h, w], sRGB in [0, 1]; shallow layers first."""


@runtime_checkable
class Encoder(Seer, Protocol):
    """Named network with feature maps. If it also is a Reader, it reads words.

    A package offers encoders as entry points of the group `frida_painter.encoders`. Each is a callable that
    takes a torch.device and returns an encoder. `--clip NAME` selects it.
    """

    @property
    def name(self) -> str: ...  # noqa: D102


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

    def picture(self, file: str) -> Tensor:
        """Returns a picture, colour and opacity [4, h, w] in [0, 1]. Raises ImageError."""
