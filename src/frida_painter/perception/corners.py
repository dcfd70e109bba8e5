"""Where the canvas is in a photograph: its four corners, or why they cannot be told."""

from collections.abc import Iterator
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from frida_painter.calibration import Corners
from frida_painter.errors import CalibrationError
from frida_painter.frames import CanvasSize
from frida_painter.perception.light import light_of_bytes
from frida_painter.perception.outline import Outline, trace_outline

_SMALL = 400  # rows or columns in which candidates are looked for
_RING = 0.03  # of the photograph, along its border: table
_SMALLEST = 0.06  # share of the photograph that a canvas fills at least
_REACH = 0.012  # of the photograph's diagonal: how wrong a candidate's corners may be
_EVEN = 0.008  # of its outline, that a hull may differ from a polygon
_MOST_SIDES = 6
_FINELY = 6.0  # pixels within which the outline is traced once more
_LEAST_SUPPORT = 0.5
_PLAIN = 0.97  # share of its worst edge at which no better canvas is looked for
_ODDEST_SHAPE = 1.4  # how much longer than it is a side may look against the other, by perspective
_DARK = 0.01

_HELP = "clear the table, even out the light, or point at the four corners yourself"


def find_canvas(photograph: NDArray[np.uint8], size: CanvasSize) -> Outline:
    """The canvas's outline in a photograph [rows, columns, 3] (uint8 sRGB), its corners from the top left.

    It is the quadrilateral unlike the table around it, in one of several senses, whose four edges
    show best. Raises CalibrationError where none does.
    """
    reach = _REACH * float(np.hypot(*photograph.shape[:2]))
    best: Outline | None = None
    seen: list[NDArray[np.float64]] = []
    for quadrilateral in _candidates(photograph):
        known = any(np.abs(quadrilateral - other).max() < reach / 2 for other in seen)
        if known or not _fits(quadrilateral, photograph.shape, size):
            continue
        seen.append(quadrilateral)
        outline = trace_outline(photograph, _corners(quadrilateral), reach)
        if outline is None or not _fits(np.array(outline.corners), photograph.shape, size):
            continue
        if best is None or outline.support > best.support + 0.02:
            best = outline
        if best is not None and best.support >= _PLAIN:
            break
    if best is None or not best.support >= _LEAST_SUPPORT:
        shown = "no quadrilateral shows" if best is None else f"only {100 * best.support:.0f} % of one edge shows"
        raise CalibrationError(
            f"The canvas of {size} cannot be told from what is around it in the photograph ({shown}); {_HELP}."
        )
    return trace_outline(photograph, best.corners, _FINELY) or best


def _candidates(photograph: NDArray[np.uint8]) -> Iterator[NDArray[np.float64]]:
    """Quadrilaterals [4, 2] that may be the canvas, (column, row) clockwise from the top left."""
    scale = max(1.0, max(photograph.shape[:2]) / _SMALL)
    rows, columns = (round(side / scale) for side in photograph.shape[:2])
    light = cv2.resize(light_of_bytes(photograph), (columns, rows), interpolation=cv2.INTER_AREA)
    light = np.log(cv2.GaussianBlur(light, (0, 0), 1.0) + _DARK)
    for mask in _masks(light):
        for kernel in (3, 9):
            shape = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (kernel, kernel))
            closed = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, shape)
            opened = cv2.morphologyEx(closed, cv2.MORPH_OPEN, shape)
            contours, _ = cv2.findContours(opened, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
            for contour in contours:
                hull = np.asarray(cv2.convexHull(contour), np.int32)
                if cv2.contourArea(hull) >= _SMALLEST * rows * columns:
                    for corners in _quadrilaterals(hull):
                        yield _from_top_left((corners + 0.5) * (photograph.shape[1] / columns) - 0.5)


def _masks(light: NDArray[np.float32]) -> Iterator[NDArray[np.bool_]]:
    """Where the canvas may be, [rows, columns]: what is bright, and what is unlike the table."""
    luminance = light.mean(-1)
    span = np.percentile(luminance, [1, 99])
    grey = np.clip(255 * (luminance - span[0]) / max(float(span[1] - span[0]), 1e-6), 0, 255).astype(np.uint8)
    threshold, _ = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    yield grey > threshold
    unlike = np.linalg.norm(light - _table(light), axis=-1)
    usual = float(np.median(unlike[_ring(unlike.shape)]))
    for distance in (0.6, 0.4, 0.25, 0.15):
        if distance > 2 * usual:
            yield unlike > distance


def _table(light: NDArray[np.float32]) -> NDArray[np.float64]:
    """What the table would look like everywhere, [rows, columns, 3], from its light along the border.

    A plane for each band, in which what does not fit (things on the table) counts less.
    """
    rows, columns = light.shape[:2]
    down, across = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, columns), indexing="ij")
    terms = np.stack((np.ones_like(down), down, across, down**2, across**2), -1)
    ring = _ring((rows, columns))
    known, seen = terms[ring], light[ring].astype(np.float64)
    weight = np.ones(len(seen))
    for _ in range(8):
        root = np.sqrt(weight)[:, None]
        factors = np.linalg.lstsq(root * known, root * seen, rcond=None)[0]
        off = np.linalg.norm(known @ factors - seen, axis=1)
        weight = 1 / (1 + (off / (3 * np.median(off) + 1e-3)) ** 2) ** 2
    return terms @ factors


def _ring(shape: tuple[int, ...]) -> NDArray[np.bool_]:
    width = max(2, round(_RING * min(shape[:2])))
    ring = np.ones(shape[:2], bool)
    ring[width:-width, width:-width] = False
    return ring


def _quadrilaterals(hull: NDArray[np.int32]) -> Iterator[NDArray[np.float64]]:
    """What four of a convex hull's longest sides make, prolonged until they meet, [4, 2] each.

    So a canvas is found even where paint or a hand hides one of its corners.
    """
    polygon = cv2.approxPolyDP(hull, _EVEN * cv2.arcLength(hull, True), True)[:, 0].astype(np.float64)
    side = np.roll(polygon, -1, axis=0) - polygon
    longest = np.argsort(-np.linalg.norm(side, axis=1), kind="stable")[:_MOST_SIDES]
    for chosen in combinations(sorted(longest.tolist()), 4):
        start, way = polygon[list(chosen)], side[list(chosen)]
        before, along = np.roll(start, 1, axis=0), np.roll(way, 1, axis=0)
        sine = along[:, 0] * way[:, 1] - along[:, 1] * way[:, 0]
        if (np.abs(sine) > 0.05 * np.linalg.norm(along, axis=1) * np.linalg.norm(way, axis=1)).all():
            gap = start - before
            far = (gap[:, 0] * way[:, 1] - gap[:, 1] * way[:, 0]) / sine
            yield before + far[:, None] * along


def _from_top_left(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same four corners, clockwise as one sees them, from the one nearest to the photograph's top left."""
    around = corners - corners.mean(0)
    ordered = corners[np.argsort(np.arctan2(around[:, 1], around[:, 0]))]
    return np.roll(ordered, -int(np.argmin(ordered.sum(1))), axis=0)


def _fits(corners: NDArray[np.float64], shape: tuple[int, ...], size: CanvasSize) -> bool:
    """Whether corners [4, 2] lie in the photograph and make a quadrilateral of about the canvas's shape."""
    side = np.roll(corners, -1, axis=0) - corners
    after = np.roll(side, -1, axis=0)
    convex = (side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0] > 0).all()
    inside = (corners >= -0.5).all() and (corners <= np.array(shape[1::-1]) - 0.5).all()
    top, right, bottom, left = np.linalg.norm(side, axis=1)
    odd = (top + bottom) / max(left + right, 1e-9) / (size.width / size.height)
    return bool(convex and inside and 1 / _ODDEST_SHAPE <= odd <= _ODDEST_SHAPE)


def _corners(points: NDArray[np.float64]) -> Corners:
    return tuple((float(column), float(row)) for column, row in points)
