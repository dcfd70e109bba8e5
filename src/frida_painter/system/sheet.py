"""Drawn sheets: paper, inks, typeface, and the grid of cells for all of them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from frida_painter.system import images

Color = tuple[int, ...]
Font = ImageFont.FreeTypeFont | ImageFont.ImageFont
INK, SOFT, LINE = (35, 33, 30), (98, 93, 85), (205, 200, 191)
"""sRGB bytes of text, explanations, and rules and frames."""
PAPER, CREAM = (255, 255, 255), (250, 248, 244)
"""sRGB bytes of printed pages and reports, and of pages on screen during a calibration."""
WARNING = (178, 58, 44)
A4 = (1240, 1754)
"""Columns and rows of A4 at 150 dots per inch."""


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


def scale(picture: Tensor, width: int, height: int) -> Image.Image:
    """Returns a picture [3, h, w] in [0, 1] resampled to `width` x `height` pixels."""
    return Image.fromarray(images.to_uint8(picture)).resize((width, height), Image.Resampling.LANCZOS)


@dataclass(frozen=True)
class Grid:
    """Cells of one size on a page, in rows from the left, the first row at the top. All lengths in pixels.

    left, top: corner of the first cell
    columns: number of cells in a row
    width, height: of a cell
    across, down: gaps between columns and between rows; a caption stands in the gap below its cell
    """

    left: int
    top: int
    columns: int
    width: int
    height: int
    across: int = 0
    down: int = 0

    @classmethod
    def divide(
        cls, room: int, left: int, top: int, columns: int, height: int, *, across: int = 0, down: int = 0
    ) -> "Grid":
        """Returns a grid whose columns share `room` pixels evenly."""
        return cls(left, top, columns, (room - across * (columns - 1)) // columns, height, across, down)

    @property
    def right(self) -> int:
        """Right edge of the last column."""
        return self.left + self.columns * (self.width + self.across) - self.across

    def rows(self, count: int) -> int:
        """Returns the number of rows for `count` cells."""
        return -(-count // self.columns)

    def bottom(self, count: int) -> int:
        """Returns the lower edge of the last of `count` cells, without a caption."""
        return self.top + self.rows(count) * (self.height + self.down) - self.down

    def corner(self, place: int) -> tuple[int, int]:
        """Returns left and top of a cell, counted along the rows from 0."""
        row, column = divmod(place, self.columns)
        return self.left + column * (self.width + self.across), self.top + row * (self.height + self.down)

    def corners(self, count: int) -> Iterator[tuple[int, int]]:
        """Yields left and top of the first `count` cells."""
        yield from map(self.corner, range(count))


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

    def cell(
        self,
        at: tuple[int, int],
        picture: Image.Image | NDArray[np.uint8],
        caption: str = "",
        *,
        size: float = 15,
        gap: int = 5,
        anchor: str = "ma",
        frame: Color | None = None,
    ) -> None:
        """Draws a picture with a caption below it.

        at: top left corner of the picture (x, y)
        size, gap: of the caption, and its distance from the picture
        anchor: "ma" for a caption below the middle, "la" below the left edge
        frame: ink of a line around the picture; None for no line
        """
        picture = picture if isinstance(picture, Image.Image) else Image.fromarray(picture)
        (x, y), (width, height) = at, picture.size
        self.paste(picture, at)
        if frame is not None:
            self.draw.rectangle((x, y, x + width - 1, y + height - 1), outline=frame)
        if caption:
            self.text((x if anchor == "la" else x + width / 2, y + height + gap), caption, size, SOFT, anchor)

    def swatch(self, at: tuple[int, int], width: int, height: int, fill: Color, frame: Color | None = None) -> None:
        """Fills a cell with a colour.

        at: top left corner (x, y)
        frame: ink of a line on its edge; None for no line
        """
        x, y = at
        self.draw.rectangle((x, y, x + width - 1, y + height - 1), fill=fill, outline=frame)

    def lines(self, at: tuple[int, int], lines: Sequence[str], size: float, pitch: int, ink: Color = SOFT) -> None:
        """Draws lines of text below each other, the first at (x, y), with `pitch` pixels from one to the next."""
        for row, text in enumerate(lines):
            self.text((at[0], at[1] + pitch * row), text, size, ink)

    def shrink(self, width: int, height: int) -> Image.Image:
        """Returns the page in a smaller size, with smooth edges, for drawings that are made larger than shown."""
        return self.image.resize((width, height), Image.Resampling.LANCZOS)

    def tensor(self) -> Tensor:
        """Returns the page as sRGB [3, height, width] in [0, 1]."""
        return images.from_uint8(np.asarray(self.image))
