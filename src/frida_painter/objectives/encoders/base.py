"""What an encoder of words and pictures is."""

from typing import Protocol, runtime_checkable

from torch import Tensor


@runtime_checkable
class Reader(Protocol):
    """Reads words and looks at pictures, and puts both into one space: what lies near means the same.

    name: as a person is told which one was used; side: rows and columns, in pixels, of the pictures that
    it was made for.
    """

    @property
    def name(self) -> str: ...  # noqa: D102

    @property
    def side(self) -> int: ...  # noqa: D102

    def reads_all(self, prompt: str) -> bool:
        """Whether all of the words are read; otherwise the last of them are cut off."""
        ...

    def embed_text(self, prompt: str) -> Tensor:
        """The meaning of words, [d], of unit length. What is too long is cut off."""
        ...

    def embed_pictures(self, pictures: Tensor) -> Tensor:
        """What pictures [n, 3, h, w], sRGB in [0, 1], show: [n, d], each of unit length; differentiable."""
        ...


@runtime_checkable
class Seer(Protocol):
    """Sees what is shown where in a picture, layer by layer."""

    def features(self, views: Tensor) -> tuple[Tensor, ...]:
        """What is seen where in views [n, 3, h, w], sRGB in [0, 1]: maps [n, c, h', w'], shallow ones first."""
        ...


@runtime_checkable
class Encoder(Seer, Protocol):
    """A network that sees meaning and has a name, as a person is told it; where it is a Reader as well, it reads words.

    A package brings encoders as entry points of the group `frida_painter.encoders`, each a callable that is given a
    torch.device and returns one; `--clip NAME` asks for it.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
