"""Strokes of a person on the canvas of a simulated easel: from the points of a pen to a stroke, and its records.

A pen may report 1,000 points a second. A stroke keeps only the points that its mark needs: between two kept points,
place and press change evenly, to within a tenth of a millimetre and a hundredth of the press.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.hardware.easel import PersonBrush, PersonStroke
from frida_painter.palette import Palette
from frida_painter.session.person_events import PEN_LIMITS, PersonStrokeBegan

MAX_LENGTH = 3.0
"""Greatest length of one stroke in metres."""
MARGIN = 0.03
"""Distance in metres by which a brush may go over the edge of the canvas. It paints nothing there."""
_EXACT = np.array([1e-4, 1e-4, 0.01, math.radians(2), math.radians(8)])
"""Errors that thinning may make: metres, metres, share of the press, radians of tilt and of its direction."""


@dataclass(frozen=True)
class PenStroke:
    """Stroke as it comes from a pen, a finger or a pointer.

    brush: name of a brush of the easel.
    paint: number of a well, from 0.
    points: (x, y, press, tilt, toward, seconds) of each report of the pen. x and y are shares of the canvas's width
    and height from its top-left corner. Press is in [0, 1]. Tilt is in radians from upright, toward in radians
    clockwise from the right, as pens report them. Seconds count from the first point.
    """

    brush: str
    paint: int
    points: Sequence[Sequence[float]]

    def on_canvas(self, canvas: CanvasSize, number: int) -> PersonStroke:
        """Returns the stroke on a canvas, with as few points as its mark needs.

        Raises ConfigError if a value is not a number or out of range, if the stroke leaves the canvas, or if it is
        too long.
        """
        given = np.array(self.points, np.float64).reshape(-1, len(PEN_LIMITS))
        _require_numbers(given)
        page = torch.from_numpy(given[:, :2] * (canvas.width, canvas.height))
        place = canvas.on_page(page).numpy()  # its own inverse
        over = np.maximum(-place, place - (canvas.width, canvas.height)).max(1)
        if not (over <= MARGIN).all():
            raise ConfigError(
                f"The stroke leaves the canvas by {1000 * over.max():.0f} mm at point {int(over.argmax()) + 1}; a "
                f"brush may go {1000 * MARGIN:.0f} mm over the edge. Paint it on the canvas."
            )
        length = float(np.linalg.norm(np.diff(place, axis=0), axis=1).sum())
        if not length <= MAX_LENGTH:
            raise ConfigError(
                f"The stroke is {length:.1f} m long, and one stroke is at most {MAX_LENGTH:g} m; "
                "lift the brush in between."
            )
        way = np.c_[place, given[:, 2:4], -np.unwrap(given[:, 4])]
        kept = way[thin(way / _EXACT)]
        seconds = float(given[-1, 5] - given[0, 5])
        return PersonStroke(number, self.brush, self.paint, kept[:, :2], kept[:, 2], kept[:, 3], kept[:, 4], seconds)


def _require_numbers(given: NDArray[np.float64]) -> None:
    """Raises ConfigError that names the first value that is none, or out of range."""
    if not len(given):
        raise ConfigError("The stroke has no points; touch the canvas with the brush.")
    for (name, least, most), values in zip(PEN_LIMITS, given.T, strict=True):
        good = (least <= values) & (values <= most)
        if not good.all():
            first = int(np.argmin(good))
            raise ConfigError(
                f"Point {first + 1} of the stroke has a {name} of {values[first]}; it is a number from {least:g} to "
                f"{most:.4g}. Nothing was painted; paint the stroke again."
            )


def thin(way: NDArray[np.float64]) -> NDArray[np.intp]:
    """Returns the indices of the points to keep, so that no point lies more than 1 from the line between two of them.

    way [k, d]: points, in units of the error that is allowed (Ramer 1972; Douglas and Peucker 1973).
    """
    keep = np.zeros(len(way), np.bool_)
    keep[[0, -1]] = True
    open_ends = [(0, len(way) - 1)]
    while open_ends:
        first, last = open_ends.pop()
        if last - first < 2:
            continue
        along = way[last] - way[first]
        off = way[first + 1 : last] - way[first]
        share = np.clip(off @ along / max(float(along @ along), 1e-12), 0, 1)
        error = np.linalg.norm(off - share[:, None] * along, axis=1)
        farthest = int(error.argmax())
        if error[farthest] > 1:
            middle = first + 1 + farthest
            keep[middle] = True
            open_ends += [(first, middle), (middle, last)]
    return np.flatnonzero(keep)


def draw_stroke(stroke: PersonStroke, brush: PersonBrush, size: CanvasSize, mask: NDArray[np.uint8]) -> None:
    """Sets the pixels of a mask [H, W] of the whole canvas to 1 where the stroke of that brush is."""
    rows, columns = mask.shape
    pixels = stroke.place / (size.width, size.height) * (columns, -rows) + (0, rows)
    width = (brush.light + (brush.hard - brush.light) * stroke.press) / size.height * rows
    for start, end, wide in zip(pixels, np.r_[pixels[1:], pixels[-1:]], width, strict=True):
        first, last = ((round(float(x)), round(float(y))) for x, y in (start, end))
        cv2.line(mask, first, last, 1, max(1, round(float(wide))))


def begin_stroke(stroke: PersonStroke, wells: Palette | None, done: int) -> PersonStrokeBegan:
    """Returns the record of a stroke that will now be painted, after `done` strokes of the robot.

    wells: paints in the wells, None if they are unknown.
    Raises ConfigError if the well has no paint.
    """
    count = 0 if wells is None else len(wells.color)
    if wells is None or not 0 <= stroke.paint < count:
        raise ConfigError(f"Well {stroke.paint + 1} has no paint; {count} wells are filled. Take one of them.")
    red, green, blue = wells.color[stroke.paint].tolist()
    return PersonStrokeBegan(stroke.number, done, stroke.record(), (red, green, blue))
