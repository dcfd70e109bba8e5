"""Straight sides of a canvas, a sheet or a marker in a photograph, with subpixel accuracy.

Four sides are searched around four rough corners. A side is the straight line with a step of colour at most of its
places (a vote, as in P. Hough's transform); paint and objects seldom look like that.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from frida_painter.calibration import Corners
from frida_painter.system.images import light_of_bytes

_PLACES = 240  # places along each side
_MARGIN = 0.02  # share of a side at its ends that is left out, because the next side disturbs there
_FINE = 2  # samples a pixel across the edge
_SIGMA = 1.5  # pixels; scale of the derivative filter
_MIN_STEP = 0.04  # of light, relative to the brightest part of the photograph
_CLOSE = 2.5  # distance in pixels from the line within which a step votes for it
_VOTING = 3  # each third place votes
_ROUNDS = 6
_FEWEST = 0.1  # share of the places of a side


@dataclass(frozen=True)
class Sides:
    """Four sides in a photograph.

    points: places [k, 2] at which the edge of each side shows, (column, row)
    softness: pixels between a fifth and four fifths of the step
    """

    points: tuple[NDArray[np.float64], ...]
    softness: float

    @property
    def support(self) -> float:
        """Share of the places with a visible edge, for the worst side."""
        return min(map(len, self.points)) / _PLACES


def trace_sides(photograph: NDArray[np.uint8], corners: Corners, reach: float) -> Sides | None:
    """Returns the sides within `reach` pixels of those between four rough corners; None if one shows no edge.

    photograph [rows, columns, 3]: uint8 sRGB
    corners: in clockwise order
    """
    rough = np.array(corners, np.float64)
    bright = max(float(np.percentile(light_of_bytes(photograph[::8, ::8]), 95)), 1e-3)
    sides = []
    for start, end in zip(rough, np.roll(rough, -1, 0), strict=True):
        side = _trace(photograph, start, end, reach, bright)
        if side is None:
            return None
        sides.append(side)
    return Sides(tuple(points for points, _ in sides), float(np.median([width for _, width in sides])))


def _trace(
    photograph: NDArray[np.uint8], start: NDArray[np.float64], end: NDArray[np.float64], reach: float, bright: float
) -> tuple[NDArray[np.float64], float] | None:
    """Returns points [k, 2] on the edge that runs approximately from `start` to `end`, and its softness.

    bright: light of the brightest part of the photograph
    """
    way = end - start
    outward = np.array([way[1], -way[0]]) / np.hypot(*way)  # the corners are in clockwise order
    along = np.linspace(_MARGIN, 1 - _MARGIN, _PLACES)
    offset = np.arange(-reach - 4 * _SIGMA, reach + 4 * _SIGMA, 1 / _FINE)
    places = (start + along[:, None] * way)[:, None] + offset[:, None] * outward  # [places, offsets, 2]
    low = np.floor(places.min((0, 1))).astype(int).clip(0, np.array(photograph.shape[1::-1]) - 1)
    high = np.ceil(places.max((0, 1))).astype(int).clip(low) + 2
    light = light_of_bytes(photograph[low[1] : high[1], low[0] : high[0]]) / np.float32(bright)
    column, row = (np.ascontiguousarray(part, np.float32) for part in np.moveaxis(places - low, -1, 0))
    seen = np.asarray(cv2.remap(light, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32)
    slope = _slope(seen)  # [places, offsets]
    peak = np.zeros_like(slope, bool)
    peak[:, 1:-1] = (slope[:, 1:-1] >= slope[:, :-2]) & (slope[:, 1:-1] > slope[:, 2:])
    peak &= (slope > _MIN_STEP) & (np.abs(offset) <= reach)
    line = _vote(peak, along, offset, reach)
    for _ in range(_ROUNDS):
        expected = np.polynomial.polynomial.polyval(along, line)
        distance = np.where(peak, np.abs(offset - expected[:, None]), np.inf)
        nearest = distance.argmin(1)
        place = np.flatnonzero(distance[np.arange(_PLACES), nearest] <= _CLOSE)
        if len(place) < _FEWEST * _PLACES:
            return None
        # The steepest slope between samples: the vertex of the parabola through three of them.
        top = nearest[place]
        before, at, after = slope[place, top - 1], slope[place, top], slope[place, top + 1]
        exact = offset[top] + (before - after) / (2 * np.minimum(before - 2 * at + after, -1e-9)) / _FINE
        # A parabola follows the curvature by the lens, so the ends of the side stay included.
        line = np.asarray(np.polynomial.polynomial.polyfit(along[place], exact, 2), np.float64)
    step, grey = np.arange(-reach, reach, 0.1), seen.mean(-1)
    # Of the whole side, without the noise of a place.
    profile = np.median([np.interp(step + expected[each], offset, grey[each]) for each in place[::2]], 0)
    outside, inside = np.median(profile[-len(step) // 5 :]), np.median(profile[: len(step) // 3])
    height = (profile - outside) / (inside - outside)  # 0 for the table, 1 for the canvas
    far, near = (np.flatnonzero(height >= level)[-1] for level in (0.2, 0.8))
    return start + along[place, None] * way + exact[:, None] * outward, float(step[far] - step[near])


def _slope(seen: NDArray[np.float32]) -> NDArray[np.float64]:
    """Returns the change of colour [places, offsets, 3] across the edge: [places, offsets]; at a step its height.

    Computed in linear light, in which blur does not move an edge.
    """
    reach = round(4 * _SIGMA * _FINE)
    place = np.arange(-reach, reach + 1) / (_SIGMA * _FINE)
    kernel = -place * np.exp(-(place**2) / 2)
    kernel /= np.abs(kernel).sum() / 2
    changes = [cv2.filter2D(np.ascontiguousarray(seen[..., band]), cv2.CV_32F, kernel[None]) for band in range(3)]
    slope: NDArray[np.float64] = np.sqrt(np.square(changes).sum(0))
    return slope


def _vote(
    peak: NDArray[np.bool_], along: NDArray[np.float64], offset: NDArray[np.float64], reach: float
) -> NDArray[np.float64]:
    """Returns the straight line through the most peaks: offset at its start, and growth to its end.

    Of nearly equal lines the outermost wins, because paint along an edge lies inside it.
    """
    ends = np.arange(-reach, reach + 1)
    votes = np.zeros((len(ends), len(ends)))
    near = cv2.dilate(peak.astype(np.uint8), np.ones((1, 2 * _FINE + 1), np.uint8)).astype(bool)
    for row, share in zip(near[::_VOTING], along[::_VOTING], strict=True):
        expected = (1 - share) * ends[:, None] + share * ends[None]
        votes += row[np.rint((expected - offset[0]) * _FINE).astype(int).clip(0, len(offset) - 1)]
    outermost = (ends[:, None] + ends[None]) / 2
    good = votes >= 0.9 * votes.max()
    first, last = np.unravel_index(np.where(good, outermost + 1e-3 * votes, -np.inf).argmax(), votes.shape)
    # The best line near that one: the outermost vote of a broad peak is off its centre.
    around = np.s_[max(0, first - 3) : first + 4, max(0, last - 3) : last + 4]
    inner = np.unravel_index(votes[around].argmax(), votes[around].shape)
    a, b = ends[around[0]][inner[0]], ends[around[1]][inner[1]]
    return np.array([a, b - a], np.float64)


# Lines through the points of a side

Line = tuple[NDArray[np.float64], float]
"""Normal and distance: a line of all points p with normal . p = distance."""


def fit_line(points: NDArray[np.float64]) -> Line:
    """Returns the best line through points [k, 2], with falling weights of outliers."""
    weight = np.ones(len(points))
    for _ in range(_ROUNDS):
        middle = weight @ points / weight.sum()
        spread = (points - middle) * np.sqrt(weight)[:, None]
        normal = np.linalg.eigh(spread.T @ spread)[1][:, 0]
        line = normal, float(normal @ middle)
        away = measure_distance(line, points)
        usual = 1.5 * np.median(np.abs(away)) + 1e-3
        weight = 1 / (1 + (away / (3 * usual)) ** 2) ** 2
    return line


def measure_distance(line: Line, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the distances [k] of points [k, 2] from a line."""
    return points @ line[0] - line[1]


def intersect(lines: list[Line]) -> NDArray[np.float64] | None:
    """Returns the corners [4, 2] between four lines, each before its line; None if two neighbours are parallel."""
    normals = np.array([(lines[number - 1][0], lines[number][0]) for number in range(4)])
    if not (np.abs(np.linalg.det(normals)) > 1e-6).all():
        return None
    away = np.array([(lines[number - 1][1], lines[number][1]) for number in range(4)])
    return np.asarray(np.linalg.solve(normals, away[..., None])[..., 0], np.float64)
