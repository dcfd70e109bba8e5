"""Strokes of any system, handed in to be painted and judged: plans of this project, SVG and CSV.

A hand-in is read whole or refused with one sentence. CSV has a row for each point of a path:

    # ground #c8a878
    stroke,color,width_mm,x_mm,y_mm,opacity
    1,#aa3311,4.5,10,20,1
    1,#aa3311,4.5,30,22,1

Strokes are in painting order. Points are in millimetres from the canvas's bottom-left corner, x right, y up. The
comment and the column `opacity` may be left out; then the ground is white and the paint opaque.
"""

import csv
import io
import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, HandInError
from frida_painter.strokes.palette import from_hex
from frida_painter.strokes.plan import WHITE, Plan
from frida_painter.system.images import from_uint8

MAX_BYTES = 32 * 2**20
MAX_STROKES = 20_000
MAX_POINTS = 200_000
WIDTHS = (0.0001, 0.2)
"""Least and greatest width of a stroke in metres."""
TOLERANCE = 0.001  # metres beyond the canvas that count as on its edge
_SPOT = 0.01  # share of the longer side below which a drawing is a spot
_COLUMNS = ("stroke", "color", "width_mm", "x_mm", "y_mm")
_COLOR = re.compile("#[0-9a-fA-F]{6}")
_DECIMAL = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_SUBPIXEL_BITS = 4

Color = tuple[float, float, float]
Points = NDArray[np.float64]


@dataclass(frozen=True)
class DrawnStroke:
    """Stroke as another system draws it: a line with round ends.

    points: [k, 2] in canvas metres, at least one
    width: metres
    color: sRGB in [0, 1]
    opacity: in (0, 1]
    """

    points: Points
    width: float
    color: Color
    opacity: float = 1.0


@dataclass(frozen=True)
class HandIn:
    """Strokes that were handed in, on a canvas.

    strokes: in painting order; empty if `plan` is given
    ground: sRGB of the bare canvas
    plan: plan of this project, which needs no conversion
    remarks: changes of the strokes by the reader
    """

    canvas: CanvasSize
    strokes: tuple[DrawnStroke, ...] = ()
    ground: Color = WHITE
    plan: Plan | None = None
    remarks: tuple[str, ...] = ()

    def picture(self, rows: int, columns: int) -> Tensor:
        """Returns the drawing as its own system means it, sRGB [3, rows, columns]; see `draw`."""
        return from_uint8((draw(self, rows, columns)[0] * 255).round().astype(np.uint8))


def read_csv(content: bytes, name: str, canvas: CanvasSize) -> HandIn:
    """Reads strokes from the content of a CSV file. Raises HandInError that names the line."""
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise HandInError(f"{name} is no text in UTF-8 (byte {error.start}); save it as CSV in UTF-8.") from error
    ground, above = WHITE, 0
    for comment in itertools.takewhile(lambda line: line.startswith("#"), lines):
        above += 1
        word, _, color = comment.lstrip("# ").partition(" ")
        if word == "ground":
            try:
                red, green, blue = from_hex(color.strip()).tolist()
            except ConfigError as error:
                raise HandInError(f"The ground of {name}: {error}") from error
            ground = (red, green, blue)
    rows = csv.reader(io.StringIO("\n".join(lines[above:])), strict=True)
    strokes, last = list[DrawnStroke](), ""
    try:
        parsed = _parse_rows(rows, above, name, canvas)
        for (stroke, color, width, opacity), group in itertools.groupby(parsed, lambda row: row[0]):
            if len(strokes) == MAX_STROKES:
                raise HandInError(f"{name} has more than {MAX_STROKES:,} strokes; the largest budget is 1,000.")
            if strokes and stroke == last:
                raise HandInError(
                    f"Stroke {stroke[:20]!r} of {name} changes its color, width or opacity on its way; begin another."
                )
            red, green, blue = from_hex(color).tolist()
            points = np.array([place for _, place in group], np.float64)
            strokes.append(DrawnStroke(points, width, (red, green, blue), opacity))
            last = stroke
    except csv.Error as error:
        raise HandInError(f"{name} is cut off or is no CSV near line {above + rows.line_num}: {error}.") from error
    require_strokes(strokes, name, canvas)
    return HandIn(canvas, tuple(strokes), ground)


def _parse_rows(
    rows: Iterator[list[str]], above: int, name: str, canvas: CanvasSize
) -> Iterator[tuple[tuple[str, str, float, float], tuple[float, float]]]:
    """Yields for each row the stroke (its name, color, width in m and opacity) and a point (m). Raises HandInError."""
    header = [cell.strip() for cell in next(rows, [])]
    if missing := [column for column in _COLUMNS if column not in header]:
        raise HandInError(
            f"{name} lacks the columns {', '.join(missing)}; the first row names {','.join(_COLUMNS)} and perhaps "
            "opacity, lengths in millimetres."
        )
    if twice := sorted({column for column in header if header.count(column) > 1}):
        raise HandInError(f"{name} has the columns {', '.join(twice)} twice; name each once.")
    for count, cells in enumerate(rows, 1):
        if not cells:
            continue
        where = f"Line {above + 1 + count} of {name}"
        if count > MAX_POINTS:
            raise HandInError(f"{name} has more than {MAX_POINTS:,} points; a hand-in has at most that many.")
        if len(cells) != len(header):
            raise HandInError(f"{where} has {len(cells)} of {len(header)} columns; it is cut off, or lacks a comma.")
        row = dict(zip(header, cells, strict=True))
        color = row["color"].strip().lower()
        if _COLOR.fullmatch(color) is None:
            raise HandInError(f"{where} has the color {color[:20]!r}; every stroke has one such as #aa3311.")
        width, x, y = (_number(row, column, where) / 1000 for column in _COLUMNS[2:])
        opacity = _number(row, "opacity", where) if "opacity" in row else 1.0
        if not (-TOLERANCE <= x <= canvas.width + TOLERANCE and -TOLERANCE <= y <= canvas.height + TOLERANCE):
            raise HandInError(
                f"{where} lies at ({x * 1000:g}, {y * 1000:g}) mm, off the canvas of {canvas}; give millimetres from "
                "its bottom-left corner."
            )
        place = (min(max(x, 0.0), canvas.width), min(max(y, 0.0), canvas.height))
        yield (row["stroke"].strip(), color, width, opacity), place


def _number(row: Mapping[str, str], column: str, where: str) -> float:
    text = row[column]
    value = float(text) if _DECIMAL.fullmatch(text.strip()) else math.nan
    if not math.isfinite(value):
        raise HandInError(f"{where} has {column} {text[:20]!r}; give a finite number in millimetres.")
    return value


def require_strokes(strokes: Sequence[DrawnStroke], name: str, canvas: CanvasSize) -> None:
    """Raises HandInError unless the number of strokes, their widths and points can be painted on the canvas.

    Strokes that all lie in one spot were written in another unit, such as metres.
    """
    if not 1 <= len(strokes) <= MAX_STROKES:
        raise HandInError(
            f"{name} has {len(strokes) or 'no'} strokes; a hand-in has from 1 to {MAX_STROKES:,}, and the largest "
            "budget is 1,000."
        )
    for number, stroke in enumerate(strokes, 1):
        if not np.isfinite(stroke.points).all():
            raise HandInError(f"Stroke {number} of {name} has a point that is not finite; give numbers in millimetres.")
        if not WIDTHS[0] <= stroke.width <= WIDTHS[1]:
            raise HandInError(
                f"Stroke {number} of {name} is {stroke.width * 1000:g} mm wide; widths are from {WIDTHS[0] * 1000:g} "
                f"to {WIDTHS[1] * 1000:g} mm."
            )
        if not 0 < stroke.opacity <= 1:
            raise HandInError(
                f"Stroke {number} of {name} has the opacity {stroke.opacity:g}; it is above 0, at most 1."
            )
    across, down = np.ptp(np.concatenate([stroke.points for stroke in strokes]), axis=0)
    if len(strokes) > 1 and max(across, down) < _SPOT * max(canvas.width, canvas.height):
        raise HandInError(
            f"All {len(strokes)} strokes of {name} lie within {across * 1000:.2g} x {down * 1000:.2g} mm of a canvas "
            f"of {canvas}; check the unit of their points."
        )


def draw(drawing: HandIn, rows: int, columns: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Draws lines with round ends over the ground, in order.

    Returns the picture [rows, columns, 3] in [0, 1], and the colour [n, 3] that each stroke shows when it is laid:
    that of its paint, mixed with the picture below by its opacity.
    """
    picture = np.empty((rows, columns, 3), np.float32)
    picture[...] = drawing.ground
    shown = np.empty((len(drawing.strokes), 3), np.float32)
    across, down = columns / drawing.canvas.width, rows / drawing.canvas.height
    for number, stroke in enumerate(drawing.strokes):
        page = np.stack((stroke.points[:, 0] * across, rows - stroke.points[:, 1] * down), -1)
        width = max(1, round(stroke.width * across))
        low = np.floor(page.min(0) - width).astype(int).clip(0, (columns - 1, rows - 1))
        high = np.ceil(page.max(0) + width + 1).astype(int).clip(1, (columns, rows))
        mask = np.zeros((max(1, high[1] - low[1]), max(1, high[0] - low[0])), np.uint8)
        line = np.round((page - low) * 2**_SUBPIXEL_BITS).astype(np.int32)
        cv2.polylines(mask, [line], False, 255, width, cv2.LINE_AA, _SUBPIXEL_BITS)
        if len(line) == 1:
            radius = round((width - 1) * 2**_SUBPIXEL_BITS / 2)
            cv2.circle(mask, tuple(map(int, line[0])), radius, 255, -1, cv2.LINE_AA, _SUBPIXEL_BITS)
        part = picture[low[1] : low[1] + mask.shape[0], low[0] : low[0] + mask.shape[1]]
        cover = mask[..., None].astype(np.float32) / 255
        part += stroke.opacity * cover * (np.array(stroke.color, np.float32) - part)
        weight = float(cover.sum())
        shown[number] = (part * cover).sum((0, 1)) / weight if weight > 0 else stroke.color
    return picture.clip(0, 1), shown.clip(0, 1)
