"""Strokes of any system, handed in to be painted and judged: plans of this project, SVG and CSV.

A hand-in is read whole or refused with one sentence. CSV has a row for each point of a path:

    # frida-painter strokes 1
    # ground #c8a878
    stroke,color,width_mm,x_mm,y_mm,opacity
    1,#aa3311,4.5,10,20,1
    1,#aa3311,4.5,30,22,1

Strokes are in painting order. Points are in millimetres from the canvas's bottom-left corner, x right, y up. The two
comments and the column `opacity` may be left out; then the ground is white and the paint opaque.
"""

import csv
import hashlib
import io
import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, HandInError
from frida_painter.images import from_uint8
from frida_painter.palette import from_hex
from frida_painter.plan import WHITE, Plan

CSV_VERSION = 1
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

    digest: sha256 of the file
    strokes: in painting order; empty if `plan` is given
    ground: sRGB of the bare canvas
    plan: plan of this project, which needs no conversion
    remarks: changes of the strokes by the reader
    """

    canvas: CanvasSize
    digest: str
    strokes: tuple[DrawnStroke, ...] = ()
    ground: Color = WHITE
    plan: Plan | None = None
    remarks: tuple[str, ...] = field(default=())

    def picture(self, rows: int, columns: int) -> Tensor:
        """Returns the drawing as its own system means it, sRGB [3, rows, columns]; see `draw`."""
        return from_uint8((draw(self, rows, columns)[0] * 255).round().astype(np.uint8))


def read_csv(content: bytes, name: str, canvas: CanvasSize) -> HandIn:
    """Reads strokes from the content of a CSV file. Raises HandInError that names the line."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise HandInError(f"{name} is no text in UTF-8 (byte {error.start}); save it as CSV in UTF-8.") from error
    lines = text.splitlines()
    comments = list(itertools.takewhile(lambda line: line.startswith("#"), lines))
    ground = _read_comments(comments, name)
    rows = csv.reader(io.StringIO("\n".join(lines[len(comments) :])), strict=True)
    try:
        strokes = tuple(_collect(_parse_rows(rows, len(comments), name, canvas), name, canvas))
    except csv.Error as error:
        raise HandInError(
            f"{name} is cut off or is no CSV near line {len(comments) + rows.line_num}: {error}."
        ) from error
    if text and not text.endswith(("\n", "\r")) and len(strokes) and not _is_whole(lines[-1]):
        raise HandInError(f"{name} ends within line {len(lines)}; hand in the whole file.")
    return HandIn(canvas, hashlib.sha256(content).hexdigest(), strokes, ground)


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
    places = np.concatenate([stroke.points for stroke in strokes])
    across, down = np.ptp(places, axis=0)
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
        line = np.round((page - low) * _SUBPIXELS).astype(np.int32)
        cv2.polylines(mask, [line], False, 255, width, cv2.LINE_AA, _SUBPIXEL_BITS)
        if len(line) == 1:
            cv2.circle(
                mask,
                tuple(map(int, line[0])),
                round((width - 1) * _SUBPIXELS / 2),
                255,
                -1,
                cv2.LINE_AA,
                _SUBPIXEL_BITS,
            )
        part = picture[low[1] : low[1] + mask.shape[0], low[0] : low[0] + mask.shape[1]]
        cover = mask[..., None].astype(np.float32) / 255
        part += stroke.opacity * cover * (np.array(stroke.color, np.float32) - part)
        weight = float(cover.sum())
        shown[number] = (part * cover).sum((0, 1)) / weight if weight > 0 else stroke.color
    return picture.clip(0, 1), shown.clip(0, 1)


_SUBPIXEL_BITS = 4
_SUBPIXELS = 1 << _SUBPIXEL_BITS


def _read_comments(comments: Sequence[str], name: str) -> Color:
    """Returns the ground, after a check of the version. Raises HandInError."""
    ground = WHITE
    for comment in comments:
        words = comment.lstrip("# ").split()
        if words[:2] == ["frida-painter", "strokes"] and words[2:] != [str(CSV_VERSION)]:
            raise HandInError(
                f"{name} has strokes of version {' '.join(words[2:])[:20] or 'none'}; this program reads version "
                f"{CSV_VERSION}."
            )
        if words[:1] == ["ground"]:
            try:
                red, green, blue = from_hex(" ".join(words[1:])).tolist()
            except ConfigError as error:
                raise HandInError(f"The ground of {name}: {error}") from error
            ground = (red, green, blue)
    return ground


@dataclass(frozen=True)
class _Point:
    """Row of a CSV file: the name of its stroke, the stroke's colour, width (m) and opacity, and one point (m)."""

    stroke: str
    color: str
    width: float
    opacity: float
    place: tuple[float, float]


def _parse_rows(rows: Iterator[list[str]], above: int, name: str, canvas: CanvasSize) -> Iterator[_Point]:
    """Yields the points of a CSV file. Raises HandInError."""
    header = [cell.strip() for cell in next(rows, [])]
    missing = [column for column in _COLUMNS if column not in header]
    if missing:
        raise HandInError(
            f"{name} lacks the columns {', '.join(missing)}; the first row names {','.join(_COLUMNS)} and perhaps "
            "opacity, lengths in millimetres."
        )
    twice = sorted({column for column in header if header.count(column) > 1})
    if twice:
        raise HandInError(f"{name} has the columns {', '.join(twice)} twice; name each once.")
    for count, cells in enumerate(rows, 1):
        if not cells:
            continue
        line = above + 1 + count
        if count > MAX_POINTS:
            raise HandInError(f"{name} has more than {MAX_POINTS:,} points; a hand-in has at most that many.")
        if len(cells) != len(header):
            raise HandInError(
                f"Line {line} of {name} has {len(cells)} of {len(header)} columns; it is cut off, or lacks a comma."
            )
        yield _parse_row(dict(zip(header, cells, strict=True)), f"Line {line} of {name}", canvas)


def _parse_row(cells: Mapping[str, str], where: str, canvas: CanvasSize) -> _Point:
    color = cells["color"].strip()
    if _COLOR.fullmatch(color) is None:
        raise HandInError(f"{where} has the color {color[:20]!r}; every stroke has one such as #aa3311.")
    width, x, y = (_number(cells[column], column, where) / 1000 for column in ("width_mm", "x_mm", "y_mm"))
    opacity = _number(cells["opacity"], "opacity", where) if "opacity" in cells else 1.0
    if not (-TOLERANCE <= x <= canvas.width + TOLERANCE and -TOLERANCE <= y <= canvas.height + TOLERANCE):
        raise HandInError(
            f"{where} lies at ({x * 1000:g}, {y * 1000:g}) mm, off the canvas of {canvas}; give millimetres from its "
            "bottom-left corner."
        )
    place = (min(max(x, 0.0), canvas.width), min(max(y, 0.0), canvas.height))
    return _Point(cells["stroke"].strip(), color.lower(), width, opacity, place)


def _number(text: str, column: str, where: str) -> float:
    value = float(text) if _DECIMAL.fullmatch(text.strip()) else math.nan
    if not math.isfinite(value):
        raise HandInError(f"{where} has {column} {text[:20]!r}; give a finite number in millimetres.")
    return value


def _collect(points: Iterator[_Point], name: str, canvas: CanvasSize) -> Iterator[DrawnStroke]:
    """Yields the strokes of successive points. Raises HandInError."""
    strokes, last = list[DrawnStroke](), ""
    for (stroke, color, width, opacity), group in itertools.groupby(
        points, lambda point: (point.stroke, point.color, point.width, point.opacity)
    ):
        if len(strokes) == MAX_STROKES:
            raise HandInError(f"{name} has more than {MAX_STROKES:,} strokes; the largest budget is 1,000.")
        if strokes and stroke == last:
            raise HandInError(
                f"Stroke {stroke[:20]!r} of {name} changes its color, width or opacity on its way; begin another."
            )
        red, green, blue = from_hex(color).tolist()
        places = np.array([point.place for point in group], np.float64)
        strokes.append(DrawnStroke(places, width, (red, green, blue), opacity))
        last = stroke
    require_strokes(strokes, name, canvas)
    yield from strokes


def _is_whole(line: str) -> bool:
    """Returns True if the last line of a file without a line break can be a whole one: it ends in a digit or letter."""
    return bool(line) and line[-1].isalnum()
