"""Detection in photographs: the outline of the canvas, and new dots of paint."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from scipy.optimize import least_squares
from torch import Tensor

from frida_painter.calibration import Corners
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CalibrationError
from frida_painter.frames import Lens, PixelGrid
from frida_painter.perception.flatfield import fit_robustly
from frida_painter.perception.markers import MarkedCanvas, find_marks, read_pieces
from frida_painter.perception.registration import fit_line, intersect, measure_distance, trace_sides
from frida_painter.system.images import light_of_bytes, to_linear

# Outline of the canvas, and distortion of the lens
#
# The canvas has straight edges, so if all four look curved, the lens is the cause (F. Devernay and O. Faugeras,
# "Straight lines have to be straight", 2001).

_CERTAIN = 5.0  # standard deviations from zero at which a lens is accepted
_BELIEVABLE = 0.15  # largest distortion at the photograph's corner


@dataclass(frozen=True)
class Outline:
    """Outline of the canvas in a photograph.

    corners: four corners clockwise from the first given one, (column, row), distorted
    lens: distortion; None if it is not measurable
    support: share of the places of a side with a visible edge, for the worst side; 0 if only the pieces tell
    residual: root mean square distance of these places from straight lines, in pixels
    softness: pixels between a fifth and four fifths of the step at an edge; NaN if no edge is visible
    marked: the canvas by the printed pieces at its corners; None if there are none
    """

    corners: Corners
    lens: Lens | None
    support: float
    residual: float
    softness: float = math.nan
    marked: MarkedCanvas | None = None


def trace_outline(photograph: NDArray[np.uint8], corners: Corners, reach: float) -> Outline | None:
    """Returns the outline within `reach` pixels of four rough corners; None if a side shows no edge.

    photograph [rows, columns, 3]: uint8 sRGB
    """
    sides = trace_sides(photograph, corners, reach)
    if sides is None:
        return None
    lens = _lens(sides.points, photograph.shape[:2])
    straight = [points if lens is None else lens.undistort(points) for points in sides.points]
    lines = [fit_line(points) for points in straight]
    meeting = intersect(lines)
    if meeting is None:
        return None
    found = meeting if lens is None else lens.distort(meeting)
    off = np.concatenate([measure_distance(line, points) for line, points in zip(lines, straight, strict=True)])
    residual = float(np.sqrt(np.mean(np.square(off))))
    return Outline(tuple(map(tuple, found.tolist())), lens, sides.support, residual, sides.softness)


def _lens(sides: tuple[NDArray[np.float64], ...], shape: tuple[int, ...]) -> Lens | None:
    """Returns the radial distortion that straightens the sides; None if it is uncertain.

    The distortion is centred on the photograph's middle.
    """
    rows, columns = shape
    middle = ((columns - 1) / 2, (rows - 1) / 2)
    focal = float(np.hypot(*middle))

    def lens(bending: float) -> Lens:
        return Lens((focal, focal), middle, (bending, 0.0, 0.0, 0.0, 0.0))

    def off(bending: float) -> NDArray[np.float64]:
        straight = [lens(bending).undistort(points) for points in sides]
        return np.concatenate([measure_distance(fit_line(points), points) for points in straight])

    found = least_squares(lambda unknown: off(float(unknown[0])), 0.0, bounds=(-_BELIEVABLE, _BELIEVABLE))
    bending, change = float(found.x[0]), found.jac[:, 0]
    deviation = float(np.sqrt(np.mean(np.square(found.fun)) / (change @ change)))
    return lens(bending) if _CERTAIN * deviation < abs(bending) < _BELIEVABLE else None


_SMALL = 400  # longest side of the picture in which candidates are searched
_RING = 0.03  # share of the photograph along its border that counts as table
_SMALLEST = 0.06  # smallest share of the photograph that a canvas fills
_REACH = 0.012  # share of the photograph's diagonal: error of a candidate's corners
_EVEN = 0.008  # share of its outline: tolerance for the polygon of a hull
_MAX_SIDES = 6
_FINELY = 6.0  # pixels; search range of the final trace
_MIN_SUPPORT = 0.5
_PLAIN = 0.97  # support at which the search ends
_ODDEST_SHAPE = 1.4  # largest ratio of the apparent to the true proportions, by perspective
_DARK = 0.01
_BESIDE_PIECES = (0.0025, 0.008)  # metres; edges are searched so near, and farther for a thick canvas

_HELP = "clear the table, even out the light, or point at the four corners yourself"


def find_canvas(photograph: NDArray[np.uint8], size: CanvasSize) -> Outline:
    """Returns the canvas outline in a photograph [rows, columns, 3] (uint8 sRGB), corners from the top left.

    Printed pieces at the corners tell their places, and which is the top left. Without pieces, candidates are
    quadrilaterals that differ from the table around them by one of several criteria; the one with the best visible
    edges wins. Raises CalibrationError if there is none, or if the pieces lie wrong.
    """
    if (marked := _trace_marked(photograph, size)) is not None:
        return marked
    reach = _REACH * float(np.hypot(*photograph.shape[:2]))
    best: Outline | None = None
    seen: list[NDArray[np.float64]] = []
    for quadrilateral in _candidates(photograph):
        known = any(np.abs(quadrilateral - other).max() < reach / 2 for other in seen)
        if known or not _fits(quadrilateral, photograph.shape, size):
            continue
        seen.append(quadrilateral)
        outline = trace_outline(photograph, tuple(map(tuple, quadrilateral.tolist())), reach)
        if outline is None or not _fits(np.array(outline.corners), photograph.shape, size):
            continue
        if best is None or outline.support > best.support + 0.02:
            best = outline
        if best is not None and best.support >= _PLAIN:
            break
    if best is None or not best.support >= _MIN_SUPPORT:
        shown = "no quadrilateral shows" if best is None else f"only {100 * best.support:.0f} % of one edge shows"
        raise CalibrationError(
            f"The canvas of {size} cannot be told from what is around it in the photograph ({shown}); {_HELP}."
        )
    return trace_outline(photograph, best.corners, _FINELY) or best


def _trace_marked(photograph: NDArray[np.uint8], size: CanvasSize) -> Outline | None:
    """Returns the outline near the printed pieces; that of the pieces alone if the edges do not show.

    None if there are no pieces. Raises CalibrationError.
    """
    marks = find_marks(photograph)
    rough = read_pieces(marks, photograph.shape, size, None)
    if rough is None:
        return None
    sides = np.linalg.norm(np.roll(rough.corners, -1, 0) - rough.corners, axis=1)
    pixels = float(sides.sum()) / (2 * (size.width + size.height))
    corners = tuple(map(tuple, rough.corners.tolist()))
    for reach in _BESIDE_PIECES:
        near = trace_outline(photograph, corners, max(_FINELY, reach * pixels))
        if near is not None and near.support >= _MIN_SUPPORT:
            exact = read_pieces(marks, photograph.shape, size, near.lens)
            assert exact is not None
            exact.require_size(size)
            return replace(near, marked=exact)
    return Outline(corners, None, 0.0, rough.off * pixels, marked=rough)


def _candidates(photograph: NDArray[np.uint8]) -> Iterator[NDArray[np.float64]]:
    """Yields quadrilaterals [4, 2] that may be the canvas, (column, row) clockwise from the top left."""
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
    """Yields masks [rows, columns] of possible canvases: bright areas, and areas unlike the table."""
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
    """Returns the estimated light of the table everywhere, [rows, columns, 3], from the border of the photograph.

    A quadratic surface for each band, with falling weights of outliers (objects on the table).
    """
    rows, columns = light.shape[:2]
    down, across = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, columns), indexing="ij")
    terms = np.stack((np.ones_like(down), down, across, down**2, across**2), -1)
    ring = _ring((rows, columns))
    known, seen = torch.from_numpy(terms[ring]), torch.from_numpy(light[ring].T.astype(np.float64))
    return np.asarray(terms @ fit_robustly(known, seen)[0].numpy().T, np.float64)


def _ring(shape: tuple[int, ...]) -> NDArray[np.bool_]:
    width = max(2, round(_RING * min(shape[:2])))
    ring = np.ones(shape[:2], bool)
    ring[width:-width, width:-width] = False
    return ring


def _quadrilaterals(hull: NDArray[np.int32]) -> Iterator[NDArray[np.float64]]:
    """Yields quadrilaterals [4, 2] from four of a convex hull's longest sides, extended to their intersections.

    So a canvas is found even if paint or a hand hides one of its corners.
    """
    polygon = cv2.approxPolyDP(hull, _EVEN * cv2.arcLength(hull, True), True)[:, 0].astype(np.float64)
    side = np.roll(polygon, -1, axis=0) - polygon
    longest = np.argsort(-np.linalg.norm(side, axis=1), kind="stable")[:_MAX_SIDES]
    for chosen in combinations(sorted(longest.tolist()), 4):
        start, way = polygon[list(chosen)], side[list(chosen)]
        before, along = np.roll(start, 1, axis=0), np.roll(way, 1, axis=0)
        sine = along[:, 0] * way[:, 1] - along[:, 1] * way[:, 0]
        if (np.abs(sine) > 0.05 * np.linalg.norm(along, axis=1) * np.linalg.norm(way, axis=1)).all():
            gap = start - before
            far = (gap[:, 0] * way[:, 1] - gap[:, 1] * way[:, 0]) / sine
            yield before + far[:, None] * along


def _from_top_left(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the four corners clockwise on screen, from the one nearest to the photograph's top left."""
    around = corners - corners.mean(0)
    ordered = corners[np.argsort(np.arctan2(around[:, 1], around[:, 0]))]
    return np.roll(ordered, -int(np.argmin(ordered.sum(1))), axis=0)


def _fits(corners: NDArray[np.float64], shape: tuple[int, ...], size: CanvasSize) -> bool:
    """Returns True if corners [4, 2] lie in the photograph and have about the canvas's proportions."""
    side = np.roll(corners, -1, axis=0) - corners
    after = np.roll(side, -1, axis=0)
    convex = (side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0] > 0).all()
    inside = (corners >= -0.5).all() and (corners <= np.array(shape[1::-1]) - 0.5).all()
    top, right, bottom, left = np.linalg.norm(side, axis=1)
    odd = (top + bottom) / max(left + right, 1e-9) / (size.width / size.height)
    return bool(convex and inside and 1 / _ODDEST_SHAPE <= odd <= _ODDEST_SHAPE)


# New dots of paint on the canvas, and their matches with the intended dots

_FAINTEST = 0.25  # share of the canvas's light that paint takes away
_SOLID = 0.5  # smallest share of the enclosing circle that a dot fills
_ODDEST_AREA = 4.0  # largest ratio of areas to the usual dot
_DOTS_SMALLEST = 4  # pixels
_MAX_SPOTS = 200
_MAX_TURN = np.tan(np.radians(20))
_MAX_SCALE = 0.1


class Match(NamedTuple):
    """Pairs of intended and visible dots, as indices.

    meant [k]: indices of intended dots
    seen [k]: indices of visible dots
    """

    meant: NDArray[np.intp]
    seen: NDArray[np.intp]


def find_dots(before: Tensor, after: Tensor, grid: PixelGrid) -> NDArray[np.float64]:
    """Returns the centres of round new marks of similar size, canvas metres [n, 2].

    before, after [3, rows, columns]: rectified canvas on `grid`, sRGB
    The centre is that of the added paint, weighted by its coverage. Another brightness of the light does not matter.
    """
    bare, seen = to_linear(before).mean(0), to_linear(after).mean(0)
    bare = bare * (seen / bare.clamp(min=1e-3)).median()
    covered = np.asarray(cv2.medianBlur((1 - seen / bare.clamp(min=1e-3)).clamp(0, 1).numpy(), 3), np.float32)
    _, label, facts, _ = cv2.connectedComponentsWithStats((covered > _FAINTEST).astype(np.uint8))
    number, (width, height), area = np.arange(len(facts)), facts[:, 2:4].T, facts[:, cv2.CC_STAT_AREA]
    solid = area >= _SOLID * np.pi * (np.maximum(width, height) / 2 + 0.5) ** 2
    number = number[solid & (area >= _DOTS_SMALLEST) & (number > 0)]
    if not len(number):
        return np.empty((0, 2))
    usual = np.median(np.sort(area[number])[-_MAX_SPOTS:])
    number = number[(area[number] < _ODDEST_AREA * usual) & (area[number] > usual / _ODDEST_AREA)][:_MAX_SPOTS]
    middle = np.array(ndimage.center_of_mass(covered, label, number))[:, ::-1].copy()
    return np.asarray(grid.to_canvas(torch.from_numpy(middle)).numpy(), np.float64)


def match_dots(meant: NDArray[np.float64], seen: NDArray[np.float64], *, reach: float, tolerance: float) -> Match:
    """Returns the largest set of dots that one shift, rotation and small scaling maps from `meant` to `seen`.

    meant, seen [k, 2]: positions in metres. Dots may be missing in either.
    reach: largest distance of a dot from its intended place in metres
    tolerance: largest distance from the place that the other dots predict in metres
    All pairs of dots are tried, not a random sample (M. Fischler and R. Bolles, "Random sample consensus", 1981).
    """
    best, number = Match(np.empty(0, np.intp), np.empty(0, np.intp)), np.arange(len(meant))
    here, there = meant @ (1, 1j), seen @ (1, 1j)
    near = np.argwhere(np.abs(there[None] - here[:, None]) <= reach)
    for (i, a), (j, b) in combinations(near.tolist(), 2):
        if i == j or a == b:
            continue
        growth = (there[b] - there[a]) / (here[j] - here[i])
        if not (abs(abs(growth) - 1) <= _MAX_SCALE and abs(growth.imag) <= _MAX_TURN * growth.real):
            continue
        away = np.abs(there[None] - (there[a] + growth * (here - here[i]))[:, None])
        mine, theirs = away.argmin(1), away.argmin(0)
        good = (theirs[mine] == number) & (away[number, mine] <= tolerance)  # mutually nearest
        if good.sum() > len(best.meant):
            best = Match(number[good], mine[good])
    return best
