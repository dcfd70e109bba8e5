"""Events of the making of pictures from words: for the page, and in a painting for its journal."""

from typing import Any

from frida_painter.session.event import Written


class MakingStarted(Written):
    """A person asked for pictures of words; the maker of this label now makes them."""

    words: str
    maker: str


class PicturesMade(Written):
    """A maker made pictures of words, to choose from.

    maker: label of the maker
    pictures: of each its file for the page, its file and folder of the making, and its seed; in a painting, the file is
    in the painting's folder, and a person chooses one in the pause, or goes on without
    best: index of the best one, by a rule that `rule` tells
    faults: sentences about pictures that were left out
    """

    words: str
    maker: str
    pictures: list[dict[str, Any]]
    best: int
    rule: str
    faults: list[str]
