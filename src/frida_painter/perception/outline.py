"""The outline of a canvas in a photograph, to a small part of a pixel, and how its lens bends it.

Around four rough corners each side is looked for where many places along it show a step of colour
on one straight line (a vote, as P. Hough's): what is painted on the canvas or lies on the table
seldom does. A canvas's edges are straight; where all four are seen bowed, the lens bows them
(F. Devernay and O. Faugeras, "Straight lines have to be straight", 2001).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from frida_painter.calibration import Corners
from frida_painter.lens import Lens
from frida_painter.perception.light import light_of_bytes

_PLACES = 240  # looked at along each side
_MARGIN = 0.02  # of a side, left out at its ends: there the next side disturbs
_FINE = 2  # samples a pixel across the edge
_SIGMA = 1.5  # pixels, of the slope that is looked for
_LEAST_STEP = 0.04  # of light, as a share of what is brightest in the photograph
_CLOSE = 2.5  # pixels from the line of a side within which a step votes for it
_ROUNDS = 6
_CERTAIN = 5.0  # standard deviations from none at which a lens is believed
_BELIEVABLE = 0.15  # of bending at the photograph's corner


@dataclass(frozen=True)
class Outline:
    """Four corners clockwise, first the one given first, (column, row) as seen; the lens, if it shows.

    support: share of the places along a side at which its edge is seen, of the worst side; residual:
    root mean square of the distances, in pixels, of those places from straight lines.
    """

    corners: Corners
    lens: Lens | None
    support: float
    residual: float


def trace_outline(photograph: NDArray[np.uint8], corners: Corners, reach: float) -> Outline | None:
    """The outline within `reach` pixels of four rough corners; None where a side shows no edge at all.

    photograph [rows, columns, 3] uint8 sRGB.
    """
    light = light_of_bytes(photograph)
    light = (light / max(float(np.percentile(light[::4, ::4], 95)), 1e-3)).astype(np.float32)
    rough = np.array(corners, np.float64)
    sides = [_edge(light, start, end, reach) for start, end in zip(rough, np.roll(rough, -1, 0), strict=True)]
    if min(len(points) for points in sides) < 0.1 * _PLACES:
        return None
    lens = _lens(sides, photograph.shape[:2])
    straight = [points if lens is None else lens.straightened(points) for points in sides]
    lines = [_line(points) for points in straight]
    meeting = np.array([_meeting(lines[i - 1], lines[i]) for i in range(4)])
    if not np.isfinite(meeting).all():
        return None
    found = meeting if lens is None else lens.bent(meeting)
    off = np.concatenate([_distance(line, points) for line, points in zip(lines, straight, strict=True)])
    support = min(len(points) for points in sides) / _PLACES
    return Outline(
        tuple((float(x), float(y)) for x, y in found), lens, support, float(np.sqrt(np.mean(np.square(off))))
    )


def _edge(
    light: NDArray[np.float32], start: NDArray[np.float64], end: NDArray[np.float64], reach: float
) -> NDArray[np.float64]:
    """Points [k, 2] on the edge that runs about from `start` to `end`."""
    way = end - start
    outward = np.array([way[1], -way[0]]) / np.hypot(*way)  # the corners go round clockwise
    along = np.linspace(_MARGIN, 1 - _MARGIN, _PLACES)
    offset = np.arange(-reach - 4 * _SIGMA, reach + 4 * _SIGMA, 1 / _FINE)
    places = (start + along[:, None] * way)[:, None] + offset[:, None] * outward  # [places, offsets, 2]
    column, row = (np.ascontiguousarray(part, np.float32) for part in np.moveaxis(places, -1, 0))
    seen = cv2.remap(light, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    slope = _slope(np.asarray(seen, np.float32))  # [places, offsets]
    peak = np.zeros_like(slope, bool)
    peak[:, 1:-1] = (slope[:, 1:-1] >= slope[:, :-2]) & (slope[:, 1:-1] > slope[:, 2:])
    peak &= (slope > _LEAST_STEP) & (np.abs(offset) <= reach)
    line = _vote(peak, along, offset, reach)
    for _ in range(_ROUNDS):
        expected = np.polynomial.polynomial.polyval(along, line)
        distance = np.where(peak, np.abs(offset - expected[:, None]), np.inf)
        nearest = distance.argmin(1)
        place = np.flatnonzero(distance[np.arange(_PLACES), nearest] <= _CLOSE)
        if len(place) < 0.1 * _PLACES:
            return np.empty((0, 2))
        exact = _summit(slope, offset, place, nearest[place])
        # A lens bows the side a little; with a parabola its ends are not taken for something else.
        line = np.asarray(np.polynomial.polynomial.polyfit(along[place], exact, 2), np.float64)
    return start + along[place, None] * way + exact[:, None] * outward


def _slope(seen: NDArray[np.float32]) -> NDArray[np.float64]:
    """How steeply the colour [places, offsets, 3] changes across the edge, [places, offsets]; of a step, its height.

    In linear light, in which an edge that is blurred stays where it is.
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
    """The straight line (offset at the start, and its growth to the end) on which most places have a peak.

    Of lines nearly as good the outermost is taken: what is painted along an edge lies inside it.
    """
    ends = np.arange(-reach, reach + 1)
    votes = np.zeros((len(ends), len(ends)))
    near = cv2.dilate(peak.astype(np.uint8), np.ones((1, 2 * _FINE + 1), np.uint8)).astype(bool)
    for row, share in zip(near, along, strict=True):
        expected = (1 - share) * ends[:, None] + share * ends[None]
        votes += row[np.rint((expected - offset[0]) * _FINE).astype(int).clip(0, len(offset) - 1)]
    outermost = (ends[:, None] + ends[None]) / 2
    good = votes >= 0.9 * votes.max()
    first, last = np.unravel_index(np.where(good, outermost + 1e-3 * votes, -np.inf).argmax(), votes.shape)
    # Of the votes around that one the best: the outermost of a broad peak lies beside it.
    around = np.s_[max(0, first - 3) : first + 4, max(0, last - 3) : last + 4]
    inner = np.unravel_index(votes[around].argmax(), votes[around].shape)
    a, b = ends[around[0]][inner[0]], ends[around[1]][inner[1]]
    return np.array([a, b - a], np.float64)


def _summit(
    slope: NDArray[np.float64], offset: NDArray[np.float64], place: NDArray[np.intp], top: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Where the slope is steepest, between the samples: the vertex of the parabola through three of them."""
    before, at, after = slope[place, top - 1], slope[place, top], slope[place, top + 1]
    return offset[top] + (before - after) / (2 * np.minimum(before - 2 * at + after, -1e-9)) / _FINE


def _lens(sides: list[NDArray[np.float64]], shape: tuple[int, ...]) -> Lens | None:
    """The radial distortion about the photograph's middle that makes the sides straight, where it is certain."""
    rows, columns = shape
    middle = ((columns - 1) / 2, (rows - 1) / 2)
    focal = float(np.hypot(*middle))

    def lens(bending: float) -> Lens:
        return Lens((focal, focal), middle, (bending, 0.0, 0.0, 0.0, 0.0))

    def off(bending: float) -> NDArray[np.float64]:
        straight = [lens(bending).straightened(points) for points in sides]
        return np.concatenate([_distance(_line(points), points) for points in straight])

    bending, step = 0.0, 1e-3
    for _ in range(_ROUNDS):  # Gauss and Newton's method
        change = (off(bending + step) - off(bending - step)) / (2 * step)
        left = off(bending)
        bending = float(np.clip(bending - change @ left / (change @ change), -_BELIEVABLE, _BELIEVABLE))
    deviation = float(np.sqrt(np.mean(np.square(off(bending))) / (change @ change)))
    return lens(bending) if _CERTAIN * deviation < abs(bending) < _BELIEVABLE else None


@dataclass(frozen=True)
class _Line:
    """All points p with normal . p = distance."""

    normal: NDArray[np.float64]
    distance: float


def _line(points: NDArray[np.float64]) -> _Line:
    """The line from which the points [k, 2] lie least far, in which those further off count less."""
    weight = np.ones(len(points))
    for _ in range(_ROUNDS):
        middle = weight @ points / weight.sum()
        spread = (points - middle) * np.sqrt(weight)[:, None]
        normal = np.linalg.eigh(spread.T @ spread)[1][:, 0]
        line = _Line(normal, float(normal @ middle))
        away = _distance(line, points)
        usual = 1.5 * np.median(np.abs(away)) + 1e-3
        weight = 1 / (1 + (away / (3 * usual)) ** 2) ** 2
    return line


def _distance(line: _Line, points: NDArray[np.float64]) -> NDArray[np.float64]:
    return points @ line.normal - line.distance


def _meeting(one: _Line, other: _Line) -> NDArray[np.float64]:
    """Where two lines meet, [2]; not finite where they are parallel."""
    matrix = np.stack((one.normal, other.normal))
    if not abs(np.linalg.det(matrix)) > 1e-6:
        return np.full(2, np.nan)
    return np.linalg.solve(matrix, np.array([one.distance, other.distance]))
