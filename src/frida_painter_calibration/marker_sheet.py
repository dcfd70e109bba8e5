"""Page to print: the pieces at the canvas's corners, the card of colours, and a ruler. perception/markers.py reads it.

Lengths are millimetres from the page's top left corner, y down.
"""

from io import BytesIO
from pathlib import Path

import cv2
import numpy as np

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.perception import markers
from frida_painter.system import storage
from frida_painter.system.sheet import INK, LINE, SOFT, Sheet

DOTS = 300
"""Dots per inch of the page."""
_MM = DOTS / 25.4
_BELOW = 12.0  # of a piece lie below the canvas, so that the canvas holds it
_ABOVE = 7.0  # of a piece beyond the canvas's corner
_DARK = (70, 70, 70)
_TEXT, _TITLE = 9.5 / 72 * DOTS, 15 / 72 * DOTS  # pixels
_RULER = 100
_TOLD = (
    "1.  Print at 100 % (actual size, not 'fit to page'). The ruler below must be 100 mm long, to 1 mm.",
    "2.  Cut along the thin lines; they need not be exact. Keep the pieces flat.",
    "3.  Lay each piece at its corner, half below the canvas: the canvas's corner goes into the corner of the dark",
    "     lines and hides the grey part. All numbers stand upright, as the painting will. Tape them to the table.",
    "4.  Lay the card of colours, or your own colour checker, flat on the bare canvas. No shadows, no reflections.",
    "5.  Move the camera until it sees all of it, then:  frida-painter calibrate",
)


class _Page:
    """Page that is drawn in millimetres."""

    def __init__(self, paper: CanvasSize) -> None:
        self.sheet = Sheet(round(1000 * paper.width * _MM), round(1000 * paper.height * _MM))

    def box(self, left: float, top: float, right: float, bottom: float, fill: tuple[int, ...] | None = None) -> None:
        """Fills a rectangle, or draws its outline."""
        corners = [round(each * _MM) for each in (left, top, right, bottom)]
        # Pillow's rectangles hold their last pixels.
        corners[2:] = [each - 1 for each in corners[2:]]
        self.sheet.draw.rectangle(corners, fill=fill, outline=None if fill else LINE, width=0 if fill else 3)

    def text(self, x: float, y: float, text: str, size: float = _TEXT, anchor: str = "la") -> None:
        self.sheet.text((x * _MM, y * _MM), text, size, INK if size > _TEXT else SOFT, anchor)

    def marker(self, number: int, middle: tuple[float, float], side: float) -> None:
        left, top = (round((each - side / 2) * _MM) for each in middle)
        book = cv2.aruco.getPredefinedDictionary(markers.DICTIONARY)
        modules = cv2.aruco.generateImageMarker(book, number, 6)
        pixels = round(side * _MM)
        drawn = cv2.resize(modules, (pixels, pixels), interpolation=cv2.INTER_NEAREST)
        self.sheet.paste(np.repeat(np.asarray(drawn, np.uint8)[..., None], 3, 2), (left, top))


def draw_marker_sheet(canvas: CanvasSize, paper: CanvasSize) -> Sheet:
    """Returns the page for a canvas. Raises ConfigError if the paper is too small."""
    kind = markers.marker_kind(canvas)
    side, band, quiet = (1000 * each for each in (markers.marker_side(kind), markers.BAND, markers.marker_margin(kind)))
    wide, high = _BELOW + band + 2 * quiet + side, _ABOVE + side + quiet + 9
    needed = 131 + 2 * high
    if not (1000 * paper.width >= max(200, 2 * wide + 20) and 1000 * paper.height >= needed):
        raise ConfigError(f"A paper of {paper} is too small for the sheet; take A4 or letter (--paper).")
    page, middle = _Page(paper), 500 * paper.width
    page.text(14, 12, f"Markers for a canvas of {canvas}", _TITLE)
    for row, line in enumerate(_TOLD):
        page.text(14, 22 + 5 * row, line)
    top = 58.0
    _draw_ruler(page, middle - _RULER / 2, top)
    top += 16
    for corner in range(4):
        right, lower = corner in (1, 2), corner >= 2
        x = middle + (1 if right else -1) * (4 + _BELOW)
        y = top + _ABOVE if not lower else top + 2 * high + 5 - _ABOVE
        _draw_piece(page, (x, y), kind, corner)
    top += 2 * high + 13
    _draw_card(page, middle, top + 17)
    if 1000 * paper.height >= top + 106:
        _draw_table(page, middle, top + 44, canvas)
    return page.sheet


def _draw_piece(page: _Page, at: tuple[float, float], kind: int, corner: int) -> None:
    """Draws a piece as it will lie, with the canvas's corner `at` a place of the page."""
    side, band, quiet = (1000 * each for each in (markers.marker_side(kind), markers.BAND, markers.marker_margin(kind)))
    (x, y), out, inwards = at, 1 if corner in (1, 2) else -1, 1 if corner < 2 else -1
    end = side + quiet + 9  # along the canvas's side

    def box(u0: float, v0: float, u1: float, v1: float, fill: tuple[int, ...] | None = None) -> None:
        """Draws a box; u grows outwards from the canvas's corner, v along the canvas's side."""
        us, vs = sorted((x + out * u0, x + out * u1)), sorted((y + inwards * v0, y + inwards * v1))
        page.box(us[0], vs[0], us[1], vs[1], fill)

    box(-_BELOW, 0, 0, end, (225, 225, 225))
    box(0, -band, band, end, _DARK)
    box(-_BELOW, -band, band, 0, _DARK)
    box(-_BELOW, -_ABOVE, band + 2 * quiet + side, end)
    across, up = (1000 * markers.marker_offset(kind, corner)).mean(0).tolist()
    page.marker(4 * kind + corner, (x + across, y - up), side)
    name = f"{corner + 1}  {markers.CORNERS[corner]}"
    page.text(x + out * (band + quiet + side / 2), y + inwards * (end - 4.5), name, anchor="mm")
    page.text(x - out * _BELOW / 2, y + inwards * end / 2, "canvas", 7 / 72 * DOTS, "mm")


def _draw_table(page: _Page, x: float, top: float, canvas: CanvasSize) -> None:
    """Draws the table from above: the canvas, upright or not as it is, with its pieces and the card."""
    scale = min(80 / canvas.width, 40 / canvas.height)
    half, high = max(scale * canvas.width / 2, 14.0), max(scale * canvas.height, 24.0)
    page.box(x - 60, top, x + 60, top + high + 12, (226, 219, 207))
    for number, (out, down) in enumerate(((-1, 6), (1, 6), (1, high - 5), (-1, high - 5))):
        left = x + out * half - (12 if out < 0 else 0)
        page.box(left, top + down, left + 12, top + down + 11, (255, 255, 255))
        page.box(left + 3, top + down + 2, left + 9, top + down + 8, _DARK)
        page.text(x + out * (half + 14.5), top + down + 5.5, f"{number + 1}", anchor="mm")
    page.box(x - half, top + 6, x + half, top + 6 + high, (250, 250, 250))
    page.box(x - min(24, half - 2), top + high - 11, x + min(24, half - 2), top + high - 2, (200, 208, 214))
    page.text(x, top + 0.45 * high, "canvas, top edge up", 8 / 72 * DOTS, "mm")
    page.text(x, top + high - 6.5, "card of colours", 8 / 72 * DOTS, "mm")


def _draw_ruler(page: _Page, left: float, top: float) -> None:
    for millimetre in range(_RULER + 1):
        long = 6 if millimetre % 10 == 0 else 4 if millimetre % 5 == 0 else 2.5
        x = left + millimetre
        page.box(x - 0.1, top + 6 - long, x + 0.1, top + 6, INK)
        if millimetre % 10 == 0:
            page.text(x, top + 6.6, f"{millimetre}", 8 / 72 * DOTS, "ma")
    page.text(left + _RULER + 4, top + 2, "mm")


def _draw_card(page: _Page, x: float, y: float) -> None:
    page.box(x - 90, y - 17, x + 90, y + 17)
    for number, (across, up) in enumerate(markers.CARD_MIDDLES):
        page.marker(markers.CARD + number, (x + 1000 * across, y - 1000 * up), 1000 * markers.CARD_SIDE)
    half = [500 * side for side in markers.PATCH]
    for color, place in zip(markers.PATCHES, markers.PATCH_MIDDLES, strict=True):
        u, v = x + 1000 * place[0], y - 1000 * place[1]
        fill = tuple(round(255 * band) for band in color)
        page.box(u - half[0], v - half[1], u + half[0], v + half[1], fill)
    page.text(x, y + 14, "card of colours", anchor="mm")


def write_marker_sheet(path: Path, canvas: CanvasSize, paper: CanvasSize) -> None:
    """Writes the page as a PDF at true scale. Raises ConfigError if the paper is too small, StorageError."""
    page = draw_marker_sheet(canvas, paper).image
    # Lossy compression smears edges at its usual quality.
    content = BytesIO()
    page.save(content, "PDF", resolution=DOTS, quality=95, subsampling=0)
    storage.write_bytes(path, content.getvalue())
