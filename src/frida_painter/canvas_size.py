"""Size of a canvas, as people write it and as plans store it; imports no tensor library."""

import math
import re
import unicodedata
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from frida_painter.errors import ConfigError

if TYPE_CHECKING:
    from torch import Tensor


SMALLEST_CANVAS = 0.03
LARGEST_CANVAS = 3.0
_IN, _MM = 0.0254, 0.001
_PAPERS = {
    **{f"a{number}": size for number, size in enumerate((
        (841 * _MM, 1189 * _MM), (594 * _MM, 841 * _MM), (420 * _MM, 594 * _MM), (297 * _MM, 420 * _MM),
        (210 * _MM, 297 * _MM), (148 * _MM, 210 * _MM), (105 * _MM, 148 * _MM),
    ))},
    "letter": (8.5 * _IN, 11 * _IN),
    "legal": (8.5 * _IN, 14 * _IN),
    "tabloid": (11 * _IN, 17 * _IN),
    "ledger": (17 * _IN, 11 * _IN),
}  # fmt: skip
"""Width and height in metres of paper sizes: ISO 216 and North American. All are portrait except the ledger."""
_UNITS = {
    _MM: ("mm", "millimetre", "millimetres", "millimeter", "millimeters"),
    0.01: ("cm", "centimetre", "centimetres", "centimeter", "centimeters"),
    1.0: ("m", "metre", "metres", "meter", "meters"),
    _IN: ("in", "in.", "inch", "inches", '"', "\u201d", "\u2033", "''"),
    0.3048: ("ft", "ft.", "foot", "feet", "'", "\u2019", "\u2032"),
}
_METRES = {unicodedata.normalize("NFKC", name): metres for metres, names in _UNITS.items() for name in names}
_FRACTIONS = {"\u00bd": " 1/2", "\u00bc": " 1/4", "\u00be": " 3/4", "\u215b": " 1/8", "\u215c": " 3/8",
              "\u215d": " 5/8", "\u215e": " 7/8"}  # fmt: skip
_NUMBER = r"(\d+(?:[.,]\d+)?(?:\s+[1-9]\d?/[1-9]\d?)?|[.,]\d+|[1-9]\d?/[1-9]\d?)"
_UNIT = rf"\s*({'|'.join(sorted(map(re.escape, _METRES), key=len, reverse=True))})?"
_SIZE = re.compile(rf"{_NUMBER}{_UNIT}(?:\s*[x\u00d7*]\s*|\s+by\s+){_NUMBER}{_UNIT}")
_ONE_SIDE = re.compile(rf"{_NUMBER}{_UNIT}")
_ORIENTATION = re.compile(r"\b(landscape|portrait)\b")
_EXAMPLES = "for example 14x11in, 297x210mm, 40 x 30 cm or A3 landscape"


@dataclass(frozen=True)
class CanvasSize:
    """Width and height of the canvas in metres, each from 0.03 to 3. Raises ConfigError."""

    width: float
    height: float

    def __post_init__(self) -> None:
        for name, metres in (("wide", self.width), ("high", self.height)):
            if not SMALLEST_CANVAS <= metres <= LARGEST_CANVAS:
                raise ConfigError(
                    f"A canvas {metres * 1000:g} mm {name} was given; each side is from "
                    f"{SMALLEST_CANVAS * 1000:g} to {LARGEST_CANVAS * 1000:g} mm, for example 14x11in or 297x210mm."
                )

    @classmethod
    def parse(cls, text: str) -> Self:
        """Reads width and height with a unit, or the name of a paper size. Raises ConfigError.

        Examples: "14x11in", "297 x 210 mm", "11,5 x 14 inches", "8 1/2 by 11 in", "30cm x 12in".
        Names: A0 to A6, letter, legal, tabloid, ledger.
        Each of them may have the word "landscape" or "portrait".
        """
        said = " ".join(_plain(text).split())
        words = _ORIENTATION.findall(said)
        rest = _ORIENTATION.sub(" ", said).strip(" ,-()") if words else said
        width, height = _PAPERS[rest] if rest in _PAPERS else _two_sides(text, rest)
        if len(set(words)) > 1:
            raise ConfigError(f"Canvas {text[:40]!r} is said to be landscape and portrait; give one of them.")
        if words and (words[0] == "landscape") != (width > height):
            width, height = height, width
        return cls(width, height)

    @classmethod
    def of(cls, size: "AnyCanvas") -> "CanvasSize":
        """Returns the size itself, or the size that a text like "14x11in" names. Raises ConfigError."""
        if isinstance(size, CanvasSize):
            return size
        if not isinstance(size, str):
            raise ConfigError(f"A canvas was given as {type(size).__name__}; give its size as a text, {_EXAMPLES}.")
        return cls.parse(size)

    def orient_like(self, rows: int, columns: int) -> "CanvasSize":
        """Returns the canvas in portrait or landscape format, to match a picture of `rows` x `columns`."""
        if (columns > rows) != (self.width > self.height):
            return CanvasSize(self.height, self.width)
        return self

    def crop_like(self, rows: int, columns: int) -> "CanvasSize":
        """Returns the largest canvas within this one that has the proportions of `rows` x `columns`.

        Raises ConfigError if its shorter side is too short for a canvas.
        """
        scale = min(self.width / columns, self.height / rows)
        width, height = columns * scale, rows * scale
        if not min(width, height) >= SMALLEST_CANVAS:
            raise ConfigError(self._too_long(rows, columns, min(width, height)))
        return CanvasSize(width, height)

    def _too_long(self, rows: int, columns: int, shorter: float) -> str:
        """Returns the error message for a picture that is too long for a canvas within this one.

        shorter: length of the shorter side in metres
        """
        share, least = max(rows, columns) / min(rows, columns), SMALLEST_CANVAS * 1000
        longer = 10 * math.ceil(least * share / 10 + 0.1)
        sides = (longer, math.ceil(longer / share)) if columns > rows else (math.ceil(longer / share), longer)
        larger = f", or a longer canvas, such as --canvas {sides[0]}x{sides[1]}mm"
        return (
            f"The picture is {share:.3g} times as {'wide as high' if columns > rows else 'high as wide'}; all of it on "
            f"a canvas within {self} would be {shorter * 1000:.3g} mm {'high' if columns > rows else 'wide'}, and each "
            f"side has at least {least:g} mm: give --fit crop or --fit pad"
            f"{larger if longer <= LARGEST_CANVAS * 1000 else ''}."
        )

    def on_page(self, position: "Tensor") -> "Tensor":
        """Converts canvas metres [..., 2] to page coordinates: origin at the top-left corner, x right, y down."""
        import torch

        return torch.stack((position[..., 0], self.height - position[..., 1]), -1)

    def __str__(self) -> str:
        return f"{self.width * 1000:.0f} x {self.height * 1000:.0f} mm"


AnyCanvas = CanvasSize | str
"""Canvas as public functions take it: a size, or its text, such as "14x11in" or "A4"."""


def _plain(text: str) -> str:
    """Returns the text in lower case with plain digits, spaces and fractions."""
    for sign, written in _FRACTIONS.items():
        text = text.replace(sign, written)
    return unicodedata.normalize("NFKC", text).replace("\N{FRACTION SLASH}", "/").lower()


def _two_sides(text: str, said: str) -> tuple[float, float]:
    """Returns width and height in metres of a text like "30 x 40 cm". Raises ConfigError that quotes `text`."""
    given = f"Canvas {text[:40]!r}"
    match = _SIZE.fullmatch(said)
    if match is None:
        if (side := _ONE_SIDE.fullmatch(said)) is not None:
            square = f"{side[1]} x {side[1]} {side[2] or 'cm'}"
            raise ConfigError(f"{given} names one side; give width and height, {_EXAMPLES}; a square is {square}.")
        raise ConfigError(f"{given} is not understood; give width x height with a unit, or a name, {_EXAMPLES}.")
    first, last = match[2] or match[4], match[4] or match[2]
    if first is None:
        sizes = ", ".join(f"{match[1]}x{match[3]}{unit}" for unit in ("in", "cm", "mm"))
        raise ConfigError(f"{given} has no unit; write which one it is ({sizes}), {_EXAMPLES}.")
    return _number(match[1]) * _METRES[first], _number(match[3]) * _METRES[last]


def _number(written: str) -> float:
    *whole, last = written.replace(",", ".").split()
    over, slash, under = last.partition("/")
    return sum(map(float, whole)) + (float(over) / float(under) if slash else float(over))
