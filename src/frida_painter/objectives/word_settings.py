"""Settings of words: how they become a painting, and how much a network looks at it."""

import math
from dataclasses import dataclass
from typing import Literal

from frida_painter.errors import ConfigError

Beginning = Literal["auto", "scene", "colors", "nothing"]


@dataclass(frozen=True)
class WordSettings:
    """Settings of words on their way to a painting.

    beginning: first picture. scene: things of the words, put together; colors: a coarse picture, coloured step by step
    by the network that reads the words; nothing: none. auto: a scene, or what a CLIP likes best of the two.
    avoid: words that the painting should not look like; "" for none
    effort: work of the network that reads the words; 1 is what a processor can do with a ViT-B/32
    """

    beginning: Beginning = "auto"
    avoid: str = ""
    effort: float = 1.0

    def budget(self, reader: object) -> "ClipWork":
        """Returns the work for a network, between the least and the most.

        It may have the attribute `work`: that of one view, relative to a ViT-B/32; else it counts as one.
        """
        work = max(_OF_VIEWS, float(getattr(reader, "work", 1.0)))
        along = min(1.0, max(0.0, math.log(self.effort / work) / math.log(_TIMES)))
        views, steps, lasts = (few * (most / few) ** along for few, most in zip(_MIN_WORK, _MAX_WORK, strict=True))
        return ClipWork(round(views), round(steps), round(lasts))


@dataclass(frozen=True)
class ClipWork:
    """Work of a network that reads words.

    views: number of views in which it sees the picture at a time
    first_steps: number of steps in which a coarse picture is made
    lasts: number of iterations of a plan that one of its gradients serves
    """

    views: int
    first_steps: int
    lasts: int


_MIN_WORK, _MAX_WORK = (4, 24, 10), (24, 400, 1)  # views, first steps, and iterations that a gradient serves
_OF_VIEWS = 0.05  # work of a view without the network
_TIMES = 60  # the most work in a plan, relative to the least

USUAL = WordSettings()
"""Settings of words that come without any."""


def refuse_absent(prompt: str) -> ConfigError:
    """Returns the error about words that name nothing to be seen."""
    return ConfigError(f"The words {prompt[:60]!r} say only what must not be seen; say what to paint.")
