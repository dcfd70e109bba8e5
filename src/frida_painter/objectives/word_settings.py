"""Settings of words: how they become a painting."""

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
    phrases: sentences with {} in the place of the words; the network compares with the mean of their meanings
    cutouts: number of views in which a CLIP sees the picture at a time
    first_steps: number of steps in which a coarse picture is made
    Raises ConfigError if a phrase has no {}.
    """

    beginning: Beginning = "auto"
    avoid: str = ""
    phrases: tuple[str, ...] = ("{}",)
    cutouts: int = 4
    first_steps: int = 24

    def __post_init__(self) -> None:
        for phrase in self.phrases:
            if phrase.count("{}") != 1:
                raise ConfigError(f"The phrase {phrase[:40]!r} was given; it has {{}} once, in the place of the words.")

    def say(self, prompt: str) -> tuple[str, ...]:
        """Returns the prompt in each of the phrases."""
        return tuple(phrase.replace("{}", prompt) for phrase in self.phrases)


USUAL = WordSettings()
"""Settings of words that come without any."""


def refuse_absent(prompt: str) -> ConfigError:
    """Returns the error about words that name nothing to be seen."""
    return ConfigError(f"The words {prompt[:60]!r} say only what must not be seen; say what to paint.")
