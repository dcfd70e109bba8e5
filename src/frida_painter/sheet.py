"""Sheets that are drawn: one paper, the same inks and one typeface for all of them."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from frida_painter import images

Color = tuple[int, ...]
Font = ImageFont.FreeTypeFont | ImageFont.ImageFont
INK, SOFT, LINE = (35, 33, 30), (98, 93, 85), (205, 200, 191)
"""sRGB in bytes: of words, of what explains them, and of rules and frames."""
PAPER, CREAM = (255, 255, 255), (250, 248, 244)
"""Of pages that are printed or stand in a report, and of those that a person sees while calibrating."""
WARNING = (178, 58, 44)


def font(size: float) -> Font:
    """The typeface of all sheets, which Pillow carries within itself; `size` in pixels."""
    return ImageFont.load_default(size)


def to_bytes(color: Tensor) -> Color:
    """A colour sRGB [3] in [0, 1] as bytes."""
    return tuple((255 * color).round().int().tolist())


def shortened(text: str, size: float, width: float) -> str:
    """The text, cut with an ellipsis where it is wider than `width` pixels."""
    if font(size).getlength(text) <= width:
        return text
    while text and font(size).getlength(text + "…") > width:
        text = text[:-1]
    return text.rstrip() + "…"


class Sheet:
    """A page of `width` times `height` pixels: `draw` draws shapes on it, `image` is it as Pillow has it."""

    def __init__(self, width: int, height: int, paper: Color = PAPER) -> None:
        self.image = Image.new("RGB", (width, height), paper)
        self.draw = ImageDraw.Draw(self.image)

    def text(self, at: tuple[float, float], text: str, size: float, ink: Color = INK, anchor: str = "la") -> None:
        """Words; `anchor` as Pillow has it: which of their corners lies `at` (x, y)."""
        self.draw.text(at, text, fill=ink, font=font(size), anchor=anchor)

    def paste(self, picture: Image.Image | NDArray[np.uint8], at: tuple[int, int] = (0, 0)) -> None:
        """A picture, its top left corner `at` (x, y)."""
        self.image.paste(picture if isinstance(picture, Image.Image) else Image.fromarray(picture), at)

    def tensor(self) -> Tensor:
        """The page as sRGB [3, height, width] in [0, 1]."""
        return images.from_uint8(np.asarray(self.image))
