"""What a prompt speaks of: a thing or several, perhaps of a colour, perhaps with another thing, and perhaps where."""

import re
from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

Color = tuple[float, float, float]

_ARTICLES = ("a", "an", "the", "one", "some", "my", "your", "his", "her", "our", "their", "this")
_NUMBERS = {
    "two": 2,
    "both": 2,
    "three": 3,
    "several": 3,
    "four": 4,
    "many": 4,
    "five": 5,
    "2": 2,
    "3": 3,
    "4": 4,
    "5": 5,
}
_JOINING = ("and", "with", "beside")
# What follows says where the thing is, or what it has beside it.
_PLACES = (
    "above", "against", "among", "at", "before", "behind", "below", "beneath", "by", "in", "inside", "near", "on",
    "over", "under",
)  # fmt: skip
_MEDIUM = re.compile(
    r"^(?:(?:an?|the)\s+)?(?:[a-z-]+\s+){0,2}(?:painting|picture|drawing|sketch|photo|photograph|image|portrait)\s+of\s+"
)
COLORS: dict[str, Color] = {
    "red": (0.80, 0.12, 0.12),
    "scarlet": (0.80, 0.12, 0.12),
    "crimson": (0.66, 0.06, 0.16),
    "orange": (0.94, 0.50, 0.10),
    "yellow": (0.97, 0.82, 0.14),
    "golden": (0.86, 0.66, 0.20),
    "green": (0.22, 0.58, 0.25),
    "turquoise": (0.16, 0.66, 0.66),
    "blue": (0.16, 0.36, 0.75),
    "purple": (0.48, 0.22, 0.58),
    "violet": (0.48, 0.22, 0.58),
    "pink": (0.95, 0.60, 0.70),
    "brown": (0.48, 0.30, 0.16),
    "black": (0.11, 0.11, 0.12),
    "gray": (0.55, 0.55, 0.56),
    "grey": (0.55, 0.55, 0.56),
    "white": (0.96, 0.96, 0.94),
}
"""Words for colours, and what a painter would take for them, in sRGB."""
_TOWARDS = {"dark": 0.0, "light": 1.0, "pale": 1.0}  # black or white
_FAR = 0.35  # of the way


@dataclass(frozen=True)
class Phrase:
    """A prompt taken apart.

    thing: what is to be seen, colour included, as "a blue bird"; plain: the same without article, number and colour,
    as "bird"; color: the word for its colour, as "light blue", or nothing; place: where it is, as "on a branch", or
    nothing; count: how many there are, where a number is said, or else 1; beside: a second thing, as "a red balloon" in
    "a girl with a red balloon", or nothing.
    """

    thing: str
    plain: str
    color: str
    place: str
    count: int = 1
    beside: str = ""

    @classmethod
    def of(cls, prompt: str) -> Self:
        """The parts of a prompt; what has no known words in it is a thing."""
        words = _MEDIUM.sub("", prompt.lower()).split()
        split = next((at for at, word in enumerate(words) if at > 0 and word in _PLACES), len(words))
        thing, place = words[:split], words[split:]
        thing, beside = _joined(thing)
        if not beside and place:
            place, beside = _joined(place)
        # The last word is what the thing is called: an orange is a fruit.
        at = next((at for at, word in enumerate(thing[:-1]) if word in COLORS), None)
        color = [] if at is None else thing[at : at + 1]
        if at and thing[at - 1] in _TOWARDS:
            color = thing[at - 1 : at + 1]
        count = next((_NUMBERS[word] for word in thing[:-1] if word in _NUMBERS), 1)
        without = (*color, *_ARTICLES, *(_NUMBERS if count > 1 else ()))
        if any(word in COLORS for word in thing[:-1] if word not in color):  # a black and white cat
            without = (*without, *COLORS, "and")
        plain = [word for word in thing if word not in without]
        return cls(" ".join(thing), " ".join(plain), " ".join(color), " ".join(place), count, " ".join(beside))


def _joined(words: list[str]) -> tuple[list[str], list[str]]:
    """What comes before and after a word that joins two things; a cat that is black and white is one."""
    inside = range(1, len(words) - 1)
    at = next((at for at in inside if words[at] in _JOINING and words[at - 1] not in COLORS), len(words))
    return words[:at], words[at + 1 :]


def paint_of(color: str) -> Tensor | None:
    """A word of COLORS, perhaps after "dark", "light" or "pale", as sRGB [3] in [0, 1]; None for no word."""
    if not color:
        return None
    *shade, name = color.split()
    paint = torch.tensor(COLORS[name])
    return torch.lerp(paint, torch.full((3,), _TOWARDS[shade[0]]), _FAR) if shade else paint
