"""Pictures side by side on one sheet, with headings, labels and captions."""

from collections.abc import Sequence
from dataclasses import dataclass

from PIL import Image
from torch import Tensor

from frida_painter import images
from frida_painter.sheet import INK, LINE, SOFT, Sheet, font

_MARGIN, _GAP = 28, 10
_TITLE, _TEXT, _SMALL = 26, 16, 15


@dataclass(frozen=True)
class Cell:
    """A picture [3, h, w] in [0, 1] and the words below it."""

    picture: Tensor
    caption: str = ""


@dataclass(frozen=True)
class FigureRow:
    """One row of the page: what stands left of it, and its cells (None: an empty place)."""

    label: str
    cells: Sequence[Cell | None]


def page(
    title: str, headings: Sequence[str], lines: Sequence[FigureRow], *, width: int = 200, framed: bool = True
) -> Tensor:
    """A sheet [3, H, W] with the lines below one another, every picture `width` pixels wide.

    headings: one above each column, or none. framed: a hairline around every picture, for pictures
    on white.
    """
    columns = max(len(line.cells) for line in lines)
    left = _MARGIN + max(_extent(part, _TEXT) for line in lines for part in line.label.split("\n")) + _GAP
    if left == _MARGIN + _GAP:
        left = _MARGIN
    top = _MARGIN + (_TITLE + 18 if title else 0) + (_TEXT + 12 if headings else 0)
    heights = [_height(line, width) for line in lines]
    total_width = left + columns * (width + _GAP) - _GAP + _MARGIN
    sheet = Sheet(total_width, top + sum(heights) + _MARGIN - _GAP)
    sheet.text((_MARGIN, _MARGIN - 4), title, _TITLE, INK)
    for column, heading in enumerate(headings):
        middle = left + column * (width + _GAP) + width / 2
        sheet.text((middle, top - 10), heading, _TEXT, INK, "ms")
    for line, height in zip(lines, heights, strict=True):
        _draw_line(sheet, line, left, top, width, height, framed)
        top += height
    return sheet.tensor()


def _draw_line(
    sheet: Sheet,
    line: FigureRow,
    left: int,
    top: int,
    width: int,
    height: int,
    framed: bool,
) -> None:
    tall = max((_rows(cell, width) for cell in line.cells if cell), default=0)
    sheet.draw.multiline_text((_MARGIN, top + tall / 2), line.label, fill=INK, font=font(_TEXT), anchor="lm", spacing=5)
    for column, cell in enumerate(line.cells):
        if cell is None:
            continue
        x = left + column * (width + _GAP)
        rows = _rows(cell, width)
        picture = Image.fromarray(images.to_uint8(cell.picture)).resize((width, rows), Image.Resampling.LANCZOS)
        sheet.paste(picture, (x, top))
        if framed:
            sheet.draw.rectangle((x, top, x + width - 1, top + rows - 1), outline=LINE)
        if cell.caption:
            sheet.text((x + width / 2, top + rows + 5), cell.caption, _SMALL, SOFT, "ma")


def _rows(cell: Cell, width: int) -> int:
    _, height, columns = cell.picture.shape
    return round(height * width / columns)


def _height(line: FigureRow, width: int) -> int:
    captioned = any(cell and cell.caption for cell in line.cells)
    return max((_rows(cell, width) for cell in line.cells if cell), default=0) + _GAP + (_SMALL + 8 if captioned else 0)


def _extent(text: str, size: int) -> int:
    return round(font(size).getlength(text))
