"""Printed sheet of markers on the virtual studio's table: read off the page itself, as a person with scissors does."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from frida_painter.canvas_size import CanvasSize
from frida_painter.virtual.printed import Printer
from frida_painter.virtual.studio import VirtualStudio
from frida_painter.virtual.tabletop import Checker
from frida_painter_calibration.marker_sheet import DOTS, draw_marker_sheet

PER_MM = DOTS / 25.4
_CUT, _HIDDEN = (205, 200, 191), (225, 225, 225)  # ink of the lines to cut along, and of what the canvas hides


@dataclass(frozen=True)
class Cut:
    """Rectangle to cut out (left, top, right, bottom), and the place for the canvas's corner; mm on the page."""

    box: tuple[float, float, float, float]
    corner: tuple[float, float] | None


@cache
def page_of(canvas: CanvasSize) -> np.ndarray:
    return np.array(draw_marker_sheet(canvas, CanvasSize.parse("A4")).image)


@cache
def cuts_of(canvas: CanvasSize) -> tuple[Cut, ...]:
    """Pieces 1 to 4 (clockwise from the top left), then the card."""
    page = page_of(canvas)
    lines = (np.abs(page.astype(int) - _CUT).max(2) < 3).astype(np.uint8)
    _, _, facts, _ = cv2.connectedComponentsWithStats(lines, connectivity=8)
    boxes = [tuple(int(each) for each in fact[:4]) for fact in facts[1:] if fact[2] > 20 * PER_MM]
    hidden = (np.abs(page.astype(int) - _HIDDEN).max(2) < 3).astype(np.uint8)
    hidden = cv2.morphologyEx(hidden, cv2.MORPH_OPEN, np.ones((25, 25), np.uint8))  # without the rims of letters
    found = []
    for left, top, width, height in boxes:
        box = (left / PER_MM, top / PER_MM, (left + width) / PER_MM, (top + height) / PER_MM)
        rows, columns = np.nonzero(hidden[top : top + height, left : left + width])
        if not len(rows):
            found.append((2, 0, Cut(box, None)))
            continue
        # The canvas's corner is where the grey part meets the dark lines: away from the edges of the piece.
        right = columns.max() < width - 5
        lower = rows.max() < height - 5
        x = left + (columns.max() + 1 if right else columns.min())
        y = top + (rows.max() + 1 if lower else rows.min())
        found.append((int(lower), int(right) ^ int(lower), Cut(box, (x / PER_MM, y / PER_MM))))
    return tuple(cut for *_, cut in sorted(found, key=lambda one: one[:2]))


def cards(canvas: CanvasSize, printer: Printer) -> tuple[list[Checker], Checker]:
    """The four pieces at the corners of a canvas, and the card on its middle."""
    *pieces, card = cuts_of(canvas)
    wide, high = 1000 * canvas.width, 1000 * canvas.height
    page = _print(canvas, printer)
    places = ((0.0, high), (wide, high), (wide, 0.0), (0.0, 0.0))
    lying = [
        printer.lay(page, PER_MM, cut.box, cut.corner or (0, 0), at) for cut, at in zip(pieces, places, strict=True)
    ]
    middle = ((card.box[0] + card.box[2]) / 2, (card.box[1] + card.box[3]) / 2)
    return lying, printer.lay(page, PER_MM, card.box, middle, (0.5 * wide, 0.45 * high), 0.05)


@cache
def _print(canvas: CanvasSize, printer: Printer) -> np.ndarray:
    return printer.print(page_of(canvas))


def lay_sheet(studio: VirtualStudio, printer: Printer, *, card: bool = True) -> None:
    """Lays the pieces around the studio's canvas, and the card on it."""
    pieces, colors = cards(studio.easel.canvas, printer)
    studio.table.under = tuple(pieces)
    studio.table.over = (colors,) if card else ()
