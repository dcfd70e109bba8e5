"""The goal kind `text`: what its words may be."""

import pytest

from frida_painter.errors import ConfigError
from frida_painter.words.text import TextTerm


@pytest.mark.parametrize(
    "said",
    ["no dogs, no cats", "without people", "No people!", "not a cat", "without any people or cars",
     "neither dogs nor cats", "no dogs, and no cats", "no red dogs"],
)  # fmt: skip
def test_words_that_say_only_what_must_not_be_seen_are_refused_by_every_network(said: str) -> None:
    with pytest.raises(ConfigError, match="say only what must not be seen; say what to paint"):
        TextTerm(said)


@pytest.mark.parametrize(
    "said",
    ["no dog, a cat", "a street without people", "no people in the street", "no country for old men", "no man's land",
     "no more war", "no dogs but a cat", "noah and the ark", "nothing", "no people, only trees"],
)  # fmt: skip
def test_words_that_say_more_are_taken(said: str) -> None:
    assert TextTerm(said).words == said
