"""The contact sheet of a stroke library: every stroke on one page, the dirty ones marked with the reason."""

from collections import Counter
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.flaw import Flaw
from frida_painter.brush.judge import judge
from frida_painter.brush.library import StrokeLibrary
from frida_painter.sheet import INK, LINE, PAPER, SOFT, WARNING, Sheet, font

MOST_SHOWN = 600
_WIDTH = 1800
_MARGIN, _GAP = 44, 10
_HEAD = 112
_CAPTION = 18
_SPOILED = (253, 236, 228)


def contact_sheet(library: StrokeLibrary, title: str) -> Tensor:
    """The strokes in the order of their recording, sRGB [3, H, 1800] in [0, 1].

    A dirty one stands on red paper, with the reason below. Of more than 600 strokes all dirty ones
    and as many of the others as there is room for are shown.
    """
    flaws = judge(library)
    shown = _chosen(flaws)
    shown = shown[np.argsort(library.recorded_index[shown], kind="stable")]
    grid = _Grid.of(len(shown), *library.magnitude.shape[1:])
    sheet = Sheet(_WIDTH, _HEAD + grid.rows * (grid.height + _CAPTION + _GAP) + _MARGIN - _GAP)
    _head(sheet, flaws, len(shown), title)
    for place, index in enumerate(shown):
        left, top = grid.corner(place)
        flaw = Flaw(flaws[index])
        sheet.paste(_cell(library.magnitude[index], grid, flaw), (left, top))
        frame = (left - 1, top - 1, left + grid.width, top + grid.height)
        sheet.draw.rectangle(frame, outline=LINE if flaw is Flaw.NONE else WARNING, width=1)
        _caption(sheet, library.recorded_index[index], flaw, left, top + grid.height + 3, grid.width)
    return sheet.tensor()


@dataclass(frozen=True)
class _Grid:
    """Cells of the page, pixels."""

    columns: int
    rows: int
    width: int
    height: int

    @classmethod
    def of(cls, count: int, rows: int, columns: int) -> "_Grid":
        """Cells as wide as leaves the page about as high as wide, from 96 to 260 pixels."""
        room = _WIDTH - 2 * _MARGIN
        aspect = rows / columns
        wanted = np.sqrt(room * room / max(count, 1) / max(aspect, 0.2))
        across = round(room / float(np.clip(wanted, 96, 260)))
        width = (room - _GAP * (across - 1)) // across
        return cls(across, -(-count // across), width, max(24, round(width * aspect)))

    def corner(self, place: int) -> tuple[int, int]:
        """Left and top of a cell."""
        row, column = divmod(place, self.columns)
        return _MARGIN + column * (self.width + _GAP), _HEAD + row * (self.height + _CAPTION + _GAP)


def _chosen(flaws: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Indices of the strokes to show."""
    if len(flaws) <= MOST_SHOWN:
        return np.arange(len(flaws))
    dirty = np.flatnonzero(flaws)[:MOST_SHOWN]
    clean = np.flatnonzero(flaws == Flaw.NONE)
    some = clean[np.linspace(0, len(clean) - 1, MOST_SHOWN - len(dirty)).round().astype(int)] if len(clean) else clean
    return np.unique(np.concatenate([dirty, some]))


def _head(sheet: Sheet, flaws: NDArray[np.uint8], shown: int, title: str) -> None:
    sheet.text((_MARGIN, 26), title, 34, INK)
    counts = Counter(Flaw(flaw) for flaw in flaws if flaw)
    dirty = sum(counts.values())
    clean = f"{len(flaws) - dirty} of {len(flaws)} strokes are clean"
    if shown < len(flaws):
        clean += f" ({shown} are shown)"
    sheet.text((_MARGIN, 72), clean + ("." if not dirty else "; left out: "), 20, SOFT)
    if dirty:
        reasons = ", ".join(f"{count} {flaw.words}" for flaw, count in counts.most_common())
        start = _MARGIN + font(20).getlength(clean + "; left out: ")
        sheet.text((start, 72), reasons, 20, WARNING)


def _caption(sheet: Sheet, number: int, flaw: Flaw, left: int, top: int, width: int) -> None:
    sheet.text((left, top), str(number), 12, SOFT)
    if flaw is not Flaw.NONE:
        sheet.text((left + width, top), flaw.words, 12, WARNING, "ra")


def _cell(mark: NDArray[np.uint8], grid: _Grid, flaw: Flaw) -> NDArray[np.uint8]:
    """A mark as black paint on paper, [height, width, 3]."""
    smaller = grid.width < mark.shape[1]
    size = (grid.width, grid.height)
    paint = cv2.resize(mark, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)[..., None] / 255.0
    paper = PAPER if flaw is Flaw.NONE else _SPOILED
    return np.rint((1 - paint) * paper + paint * np.array(INK)).astype(np.uint8)
