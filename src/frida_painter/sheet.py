"""Drawn sheets: paper, inks and typeface for all of them."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from frida_painter import images

Color = tuple[int, ...]
Font = ImageFont.FreeTypeFont | ImageFont.ImageFont
INK, SOFT, LINE = (35, 33, 30), (98, 93, 85), (205, 200, 191)
"""sRGB bytes of text, explanations, and rules and frames."""
PAPER, CREAM = (255, 255, 255), (250, 248, 244)
"""sRGB bytes of printed pages and reports, and of pages on screen during a calibration."""
WARNING = (178, 58, 44)


def font(size: float) -> Font:
    """Returns the typeface of all sheets, which is part of Pillow.

    size: pixels
    """
    return ImageFont.load_default(size)


def to_bytes(color: Tensor) -> Color:
    """Converts sRGB [3] in [0, 1] to bytes."""
    return tuple((255 * color).round().int().tolist())


def shorten(text: str, size: float, width: float) -> str:
    """Returns the text, cut with an ellipsis if it is wider than `width` pixels."""
    if font(size).getlength(text) <= width:
        return text
    while text and font(size).getlength(text + "…") > width:
        text = text[:-1]
    return text.rstrip() + "…"


class Sheet:
    """Page of `width` x `height` pixels: `draw` draws shapes on it, `image` is the Pillow image."""

    def __init__(self, width: int, height: int, paper: Color = PAPER) -> None:
        self.image = Image.new("RGB", (width, height), paper)
        self.draw = ImageDraw.Draw(self.image)

    def text(self, at: tuple[float, float], text: str, size: float, ink: Color = INK, anchor: str = "la") -> None:
        """Draws text.

        at: position (x, y) of the anchor in pixels
        anchor: Pillow's anchor, by default the top left corner
        """
        self.draw.text(at, text, fill=ink, font=font(size), anchor=anchor)

    def paste(self, picture: Image.Image | NDArray[np.uint8], at: tuple[int, int] = (0, 0)) -> None:
        """Pastes a picture with its top left corner `at` (x, y)."""
        self.image.paste(picture if isinstance(picture, Image.Image) else Image.fromarray(picture), at)

    def tensor(self) -> Tensor:
        """Returns the page as sRGB [3, height, width] in [0, 1]."""
        return images.from_uint8(np.asarray(self.image))
