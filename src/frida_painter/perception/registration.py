"""Registration of a photograph with the expected one, to detect motions of the canvas.

The program knows what it painted and where. So whole pictures are compared: the last photograph of the canvas,
the strokes since then (which may lie slightly off), the canvas edges, and the table around. A motion shifts all
of them together. New paint along an edge changes only some colours. Small squares of canvas and table are
witnesses: each measures how much worse one motion explains the photograph than another. Their agreement gives
the verdict.
"""

import math
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from typing import Any, Self

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from frida_painter.calibration import Calibration, Corners
from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.rectify import photographed_pixels, pixels_per_metre
from frida_painter.system.images import light_of_bytes

# Straight sides of a canvas, a sheet or a marker in a photograph, with subpixel accuracy
#
# Four sides are searched around four rough corners. A side is the straight line with a step of colour at most of its
# places (a vote, as in P. Hough's transform); paint and objects seldom look like that.

_PLACES = 240  # places along each side
_MARGIN = 0.02  # share of a side at its ends that is left out, because the next side disturbs there
_FINE = 2  # samples a pixel across the edge
_SIGMA = 1.5  # pixels; scale of the derivative filter
_MIN_STEP = 0.04  # of light, relative to the brightest part of the photograph
_CLOSE = 2.5  # distance in pixels from the line within which a step votes for it
_VOTING = 3  # each third place votes
_ROUNDS = 6
_FEWEST = 0.1  # share of the places of a side
_MIN_RISE, _MIN_KNOWN = 0.06, 0.2  # linear light of a step whose width is known; share of such places on a side


@dataclass(frozen=True)
class Sides:
    """Four sides in a photograph.

    points: places [k, 2] at which the edge of each side shows, (column, row)
    widths [4, places]: pixels between a fifth and four fifths of the step at each place; NaN if none shows
    """

    points: tuple[NDArray[np.float64], ...]
    widths: NDArray[np.float64]

    @property
    def softness(self) -> float:
        """Median of `widths`; NaN if too few are known."""
        return find_widening(self.widths, np.zeros_like(self.widths))

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
    return Sides(tuple(points for points, _ in sides), np.array([widths for _, widths in sides]))


def find_widening(widths: NDArray[np.float64], before: NDArray[np.float64]) -> float:
    """Returns the median change of the widths [4, places] of places; NaN unless a fifth of three sides is known.

    Places are compared one by one, because paint beside the edge changes the step there.
    """
    wider = widths - before
    known = np.isfinite(wider).mean(1)
    return float(np.nanmedian(wider)) if (known >= _MIN_KNOWN).sum() >= 3 else math.nan


def _trace(
    photograph: NDArray[np.uint8], start: NDArray[np.float64], end: NDArray[np.float64], reach: float, bright: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Returns points [k, 2] on the edge that runs approximately from `start` to `end`, and its width at each place.

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
    within = np.abs(offset) <= reach
    widths = _measure_widths(seen[:, within].mean(-1) * bright, offset[within])
    return start + along[place, None] * way + exact[:, None] * outward, widths


def _measure_widths(grey: NDArray[np.float64], offset: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the pixels [places] between a fifth and four fifths of the step in linear light [places, offsets]."""
    light = cv2.blur(grey, (_FINE + 1, 1))
    outside, inside = np.median(light[:, -len(offset) // 5 :], 1), np.median(light[:, : len(offset) // 3], 1)
    rise = np.where(np.abs(inside - outside) >= _MIN_RISE, inside - outside, np.nan)
    height = (light - outside[:, None]) / rise[:, None]  # 0 for the table, 1 for the canvas
    far, near = (_find_first_above(height[:, ::-1], level, offset[::-1]) for level in (0.2, 0.8))
    return far - near


def _find_first_above(height: NDArray[np.float64], level: float, offset: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the interpolated offset of each row's first crossing of a level; NaN if there is none."""
    above, row = height >= level, np.arange(len(height))
    index = above.argmax(1)
    before = np.maximum(index - 1, 0)
    low, high = height[row, before], height[row, index]
    share = (level - low) / np.where(high > low, high - low, 1)
    return np.where(above[row, index] & (index > 0), offset[before] + share * (offset[index] - offset[before]), np.nan)


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


# Comparison of whole pictures

COARSEST, _ROWS = 0.001, 250  # largest pixel in metres; rows along the shorter side
_AROUND = 0.015  # metres of table around the canvas
_BESIDE_PIECES = 0.0025  # metres beside the canvas; farther away the printed pieces show more than their dark band
_REACH = 0.012  # largest motion of the search in metres
_DIM = 0.02  # linear light, added before logarithms
_NOISE = 0.1  # logarithm of light; normal difference of a pixel
_GRAINY = 4.0  # times the usual squared difference that still counts as noise
_SOFTEST = 0.8  # noise at the start of a search
_BESIDE = 0.006  # largest displacement of strokes in metres
_CHANGED = 0.04  # logarithm of light; a larger planned change counts as stroke
_SPREAD = 0.15  # logarithm of light; error of the rendered paint
_SMOOTHNESS = 0.7  # pixels, standard deviation; equal smoothness on and between pixels
_RIM = 4  # pixels on each side of the canvas edge that show its blur
_BLUR = 0.8  # pixels, standard deviation of that blur

_WITNESSES, _WIDEST = 20, 12  # number of witnesses along the shorter side; largest side in pixels
_FAINT, _LOUD = 1 / 15, 4 / 15  # parts of a witness's side, in worse pixels: hardly counts; counts fully
_MURMUR = 0.02  # share of a witness's pixels that is ignored
_STRANGE = 0.5  # misfit of an area in which a person may have painted
_PATCH = 13  # pixels; side of a square that changed as a whole, not by a motion
_LIGHT_CELL = 10  # pixels; side of a square for the comparison of light

MAX_SHIFT = 0.00125
"""Largest allowed motion of a canvas corner in metres."""
TELLS = 0.00025
"""Metres on the canvas; a smaller motion is not told from noise."""
MAX_TURN = math.radians(0.4)
"""Largest allowed rotation of the canvas in radians."""
_SURE = 3.0  # standard deviations of agreement for a motion
_SURE_STILL = 2.0
_WELL_WITHIN = 0.5  # of the allowed motion: a canvas moved if no motion of this size explains the photograph as well

Pixels = NDArray[np.float32]


class Verdict(Enum):
    """Result of a registration."""

    STILL = "it lies where it lay"
    MOVED = "it was moved"
    UNSURE = "it cannot be told"


@dataclass(frozen=True)
class CanvasShift:
    """Motion in the plane of the canvas.

    right, down: shift in metres
    turn: rotation in radians, clockwise on screen
    growth: natural logarithm of the scale
    """

    right: float = 0.0
    down: float = 0.0
    turn: float = 0.0
    growth: float = 0.0

    @classmethod
    def of(cls, values: NDArray[np.float64]) -> Self:
        """Returns the motion of four numbers [4]."""
        return cls(*(float(value) for value in values))

    @property
    def values(self) -> NDArray[np.float64]:
        """Four numbers of the motion, [4]."""
        return np.array([self.right, self.down, self.turn, self.growth])

    def corner_shift(self, size: CanvasSize) -> float:
        """Returns the largest shift of a canvas corner in metres."""
        x, y = size.width / 2, size.height / 2
        return max(math.hypot(*self._move(right, down)) for right in (-x, x) for down in (-y, y))

    def describe(self) -> str:
        """Returns the way in words: shifts in millimetres as the canvas is seen upright, and the turn in degrees."""
        ways = [(self.right, "right", "left"), (self.down, "down", "up")]
        told = [f"{1000 * abs(far):.1f} mm {ahead if far > 0 else back}" for far, ahead, back in ways]
        turned = f"{abs(math.degrees(self.turn)):.2f} degrees {'' if self.turn > 0 else 'counter-'}clockwise"
        return f"{told[0]}, {told[1]}, turned {turned}"

    def size(self, size: CanvasSize) -> float:
        """Returns the size relative to the limits: 1 if a corner shift or the rotation is at its limit."""
        return max(self.corner_shift(size) / MAX_SHIFT, abs(self.turn) / MAX_TURN)

    def followed_by(self, later: "CanvasShift") -> Self:
        """Returns both motions in sequence; for small motions the order does not matter."""
        return self.of(self.values + later.values)

    def to_source(self, center: tuple[float, float], pitch: float) -> NDArray[np.float64]:
        """Returns the matrix [2, 3] from pixels (column, row) after the motion to pixels before it.

        center: centre of the picture in pixels
        pitch: metres of a pixel
        """
        scale = math.exp(-self.growth)
        cos, sin = scale * math.cos(self.turn), scale * math.sin(self.turn)
        back = np.array([[cos, sin], [-sin, cos]])
        middle = np.array(center)
        shift = np.array([self.right, self.down]) / pitch
        return np.c_[back, middle - back @ (middle + shift)]

    def _move(self, right: float, down: float) -> tuple[float, float]:
        scale = math.exp(self.growth)
        cos, sin = scale * math.cos(self.turn), scale * math.sin(self.turn)
        return cos * right - sin * down + self.right - right, sin * right + cos * down + self.down - down


@dataclass(frozen=True)
class Registration:
    """Result of a comparison of a canvas with an earlier photograph.

    verdict: judgement of this motion together with the earlier drift
    motion: most likely motion
    """

    verdict: Verdict
    motion: CanvasShift


@dataclass(frozen=True)
class CanvasView:
    """Plane of the canvas with a margin of the table, as the camera sees it.

    grid: grid of the canvas alone
    column, row [rows, columns] float32: place of each pixel in a photograph
    canvas, seen [rows, columns] bool: True on the canvas, and inside the photograph
    smoothing: photograph pixels in one pixel of the view
    pitch: metres of one pixel
    """

    grid: PixelGrid
    column: Pixels
    row: Pixels
    canvas: NDArray[np.bool_]
    seen: NDArray[np.bool_]
    smoothing: int
    pitch: float

    @classmethod
    def of(cls, calibration: Calibration, size: CanvasSize) -> Self:
        """Returns the view of a calibration record."""
        finest = 1 / pixels_per_metre(calibration, size)
        pitch = max(finest, min(COARSEST, size.width / _ROWS, size.height / _ROWS))
        around = round(_AROUND / pitch)
        grid = PixelGrid(size, round(size.height / pitch), round(size.width / pitch))
        down, across = np.arange(-around, grid.rows + around), np.arange(-around, grid.columns + around)
        place = np.stack(np.meshgrid(across, down), -1).astype(np.float64)
        seen = photographed_pixels(place.reshape(-1, 2), calibration, grid).reshape(place.shape)
        rows, columns = calibration.photograph
        in_sight = np.asarray(((seen >= 0) & (seen <= (columns - 1, rows - 1))).all(2), np.bool_)  # NaN gives False
        if calibration.markers:  # the printed pieces stay while the canvas moves
            near = round(_BESIDE_PIECES / pitch)
            in_sight &= ((place >= -near) & (place < (grid.columns + near, grid.rows + near))).all(2)
        canvas = np.asarray(((place >= 0) & (place < (grid.columns, grid.rows))).all(2), np.bool_)
        column, row = np.nan_to_num(seen, nan=-1.0).astype(np.float32).transpose(2, 0, 1)
        smoothing = 2 * int(pitch / finest / 2) + 1
        places = np.ascontiguousarray(column), np.ascontiguousarray(row)
        return cls(grid, *places, canvas, in_sight, smoothing, pitch)

    def light(self, photograph: NDArray[np.uint8]) -> Pixels:
        """Returns the logarithm of light [rows, columns, 3] of a photograph [H, W, 3], uint8 sRGB."""
        smooth = cv2.blur(light_of_bytes(photograph), (self.smoothing, self.smoothing))
        seen = cv2.remap(smooth, self.column, self.row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(np.log(cv2.GaussianBlur(seen, (0, 0), _SMOOTHNESS) + _DIM), np.float32)

    def around(self, picture: Pixels) -> Pixels:
        """Returns a picture of the canvas [rows, columns, ...] in this view, with its border repeated in the margin."""
        beyond = (self.canvas.shape[0] - self.grid.rows) // 2
        return np.asarray(cv2.copyMakeBorder(picture, *(beyond,) * 4, cv2.BORDER_REPLICATE), np.float32)


@dataclass(frozen=True)
class _Scene:
    """One photograph with its expectation at one resolution. Arrays are [rows, columns] unless stated.

    seen, expected [rows, columns, 3]: logarithm of light
    known: 1 at pixels that can be compared
    canvas: 1 on the expected canvas
    touched: 1 at new strokes
    as_paint: misfit of a pixel as new paint, in [0, 1]
    rim: 1 at new strokes in the blur of the canvas edge
    grain: squared noise of the camera. It is subtracted, because a shift by parts of a pixel smooths noise and
    would look better.
    """

    seen: Pixels
    expected: Pixels
    known: Pixels
    canvas: Pixels
    touched: Pixels
    as_paint: Pixels
    rim: Pixels
    grain: Pixels
    pitch: float
    _known: dict[tuple[CanvasShift, float], Pixels] = field(default_factory=dict, init=False)  # misfits

    def coarser(self) -> "_Scene":
        """Returns the scene with half as many rows and columns."""
        rows, columns = self.canvas.shape
        arrays: dict[str, Any] = {
            name: np.asarray(cv2.resize(each, (columns // 2, rows // 2), interpolation=cv2.INTER_AREA), np.float32)
            for name in ("seen", "expected", "known", "canvas", "touched", "as_paint", "rim", "grain")
            for each in (getattr(self, name),)
        }
        return replace(self, **arrays, pitch=self.pitch * 2)

    def misfit(self, motion: CanvasShift, noise: float = _NOISE) -> Pixels:
        """Returns the misfit of each pixel for a motion: [rows, columns] in [0, 1]."""
        if (motion, noise) not in self._known:
            expected, canvas, known, touched, _ = self._move(motion)
            misfit = _misfit(self.seen - expected, noise, self.grain)
            lies_still = (canvas <= 0.5) & (self.canvas <= 0.5)  # the table may stay while the canvas moves
            of_still = self.misfit(CanvasShift(), noise) if motion != CanvasShift() else misfit
            np.minimum(misfit, of_still, out=misfit, where=lies_still)
            np.minimum(misfit, self.as_paint, out=misfit, where=(canvas > 0.5) & (touched > 0))
            self._known[motion, noise] = misfit * (known > 0.99)
        return self._known[motion, noise]

    def refine(self, motion: CanvasShift, noises: tuple[float, ...], *, grows: bool = True) -> CanvasShift:
        """Returns the best motion near `motion`.

        noises: noise of each iteration
        grows: True to fit the scale as well
        The fit is by robust least squares with falling weights of outliers (Geman and McClure).
        """
        step = np.array([0.3 * self.pitch, 0.3 * self.pitch, 0.5 * self.pitch / 0.2, 0.5 * self.pitch / 0.2])
        loose = np.diag(step**-2) * 1e-3
        for noise in noises:
            expected, _, known, touched, rim = self._move(motion)
            off = self.seen - expected
            weight = (noise**2 / (_mean_square(off) + noise**2)) ** 2 * (known > 0.99)
            weight[(weight <= 1e-4) | ((touched > 0) & (rim < 0.5))] = 0
            slope = np.zeros((4, *off.shape), np.float32)
            for number in range(4 if grows else 3):
                change = np.zeros(4)
                change[number] = step[number]
                slope[number] = self._warp(self.expected, CanvasShift.of(motion.values + change)) - expected
            weighted = (slope * weight[..., None]).reshape(4, -1)
            normal = (weighted @ slope.reshape(4, -1).T).astype(np.float64) + loose * step[:, None] * step
            pull = (weighted @ off.reshape(-1)).astype(np.float64)
            motion = CanvasShift.of(motion.values + np.linalg.solve(normal, pull) * step)
        return motion

    def votes(self, better: CanvasShift, worse: CanvasShift) -> float:
        """Returns the witnesses' agreement, in standard deviations, that `better` fits the photograph better."""
        side = min(_WIDEST, max(2, min(self.canvas.shape) // _WITNESSES))  # of a witness in pixels
        rows, columns = self.canvas.shape
        high, wide = -(-rows // side), -(-columns // side)
        padded = np.zeros((high * side, wide * side), np.float64)
        padded[:rows, :columns] = self.misfit(worse) - self.misfit(better)
        voices = padded.reshape(high, side, wide, side).sum((1, 3)).ravel()
        voices = np.sign(voices) * np.maximum(np.abs(voices) - _MURMUR * side**2, 0)
        loud = np.tanh(voices / (_LOUD * side))
        return float(loud.sum() / math.sqrt((loud**2).sum() + (_FAINT / _LOUD) ** 2))

    @cached_property
    def _masks(self) -> Pixels:
        return np.stack((self.canvas, self.known, self.touched, self.rim), -1)

    def _move(self, motion: CanvasShift) -> tuple[Pixels, Pixels, Pixels, Pixels, Pixels]:
        """Returns what is expected, canvas, what can be compared, new strokes, and those in the rim, after a motion."""
        canvas, known, touched, rim = np.moveaxis(self._warp(self._masks, motion), -1, 0)
        return self._warp(self.expected, motion), canvas, known * (self.known > 0.99), touched, rim

    def _warp(self, picture: Pixels, motion: CanvasShift) -> Pixels:
        rows, columns = self.canvas.shape
        matrix = motion.to_source(((columns - 1) / 2, (rows - 1) / 2), self.pitch)
        way = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        moved = cv2.warpAffine(picture, matrix, (columns, rows), flags=way, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(moved, np.float32)


def register(
    view: CanvasView,
    seen: Pixels,
    before: Pixels,
    strokes: tuple[Pixels, Pixels] | None = None,
    drift: CanvasShift = CanvasShift(),
) -> Registration:
    """Registers a photograph with an earlier one, both as from CanvasView.light.

    strokes: linear light [rows, columns, 3] on the view's grid before and after the strokes since then; None if
    a person may have painted
    drift: motion of the canvas before
    If even the earlier photograph could not show a motion, a canvas without visible motion counts as still, so
    that a person is not asked each time.
    """
    scene = _scene(view, seen, before, strokes)
    size = view.grid.size
    best = _find_best(scene, size)
    whole = drift.followed_by(best)
    how_large = whole.size(size) / max(1.0, view.pitch / MAX_SHIFT)  # large pixels show no smaller motion
    if how_large > 1:
        back = CanvasShift.of(best.values - (1 - _WELL_WITHIN / how_large) * whole.values)
        still = min((back, CanvasShift()), key=lambda each: float(scene.misfit(each).sum()))
        return Registration(Verdict.MOVED if scene.votes(best, still) >= _SURE else Verdict.UNSURE, best)
    sure = _stillness(scene, best, size) >= _SURE_STILL
    sure = sure or _stillness(_scene(view, before, before, None), CanvasShift(), size) < _SURE_STILL
    return Registration(Verdict.STILL if sure else Verdict.UNSURE, best)


def _stillness(scene: _Scene, best: CanvasShift, size: CanvasSize) -> float:
    """Returns the least agreement of the witnesses, in standard deviations, for the best motion against larger ones."""
    return min(scene.votes(best, best.followed_by(rival)) for rival in _list_rivals(size))


def _list_rivals(size: CanvasSize) -> list[CanvasShift]:
    """Returns motions slightly above the limit; a canvas is still if none of them explains a photograph as well."""
    far = 1.2 * MAX_SHIFT
    shifts = [CanvasShift(far * math.cos(angle), far * math.sin(angle)) for angle in np.arange(8) * math.pi / 4]
    turn = far / math.hypot(size.width / 2, size.height / 2)
    return [*shifts, CanvasShift(turn=turn), CanvasShift(turn=-turn)]


def _find_best(fine: _Scene, size: CanvasSize) -> CanvasShift:
    """Returns the motion that explains most of the photograph, by a coarse-to-fine search."""

    def loss(motion: CanvasShift) -> float:
        return float(fine.misfit(motion).sum())

    coarse, none = fine.coarser(), CanvasShift()
    step = 2 * max(coarse.pitch, _REACH / 6)
    count = int(_REACH / step)
    grid = [CanvasShift(step * x, step * y) for x in range(-count, count + 1) for y in range(-count, count + 1)]
    ways = [way * 2 * step / (math.hypot(size.width, size.height) / 2) for way in (-3, -2, -1, 1, 2, 3)]
    grid += [CanvasShift(turn=way) for way in ways] + [CanvasShift(growth=way) for way in ways]
    ranking = np.argsort([float(coarse.misfit(motion, _SOFTEST / 3).sum()) for motion in grid])
    starts = [none] if grid[ranking[0]] == none else [none, *(grid[at] for at in ranking[:3])]
    found = []
    for start in starts:
        noises = (_SOFTEST, _SOFTEST, _SOFTEST / 2, _SOFTEST / 2, _SOFTEST / 4, _NOISE)
        motion = coarse.refine(start, noises, grows=start.growth != 0)
        found.append(motion if motion.corner_shift(size) < 2 * _REACH else start)
    closer = (_SOFTEST / 4, _NOISE, _NOISE, _NOISE)
    near = dict.fromkeys((min(found, key=loss), none))
    known = [fine.refine(start, closer, grows=start.growth != 0) for start in near]
    known.append(fine.refine(min(known, key=loss), closer[1:]))
    best = min((none, *known), key=loss)
    rival = min((best.followed_by(each) for each in _list_rivals(size)), key=loss)
    return min((best, rival, fine.refine(rival, closer)), key=loss) if loss(rival) < loss(best) else best


def _scene(view: CanvasView, seen: Pixels, expected: Pixels, strokes: tuple[Pixels, Pixels] | None) -> _Scene:
    known = view.seen.astype(np.float32)
    canvas = view.canvas.astype(np.float32)
    touched = np.zeros_like(canvas)
    as_paint = np.ones_like(canvas)
    if strokes is not None:
        change = view.around(np.asarray(np.log(strokes[1] + _DIM) - np.log(strokes[0] + _DIM), np.float32))
        is_changed = ((np.abs(change) > _CHANGED).any(2) & view.canvas).astype(np.uint8)
        around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * round(_BESIDE / view.pitch) + 1,) * 2)
        touched = cv2.dilate(is_changed, around).astype(np.float32) * canvas
    else:
        even = seen - _lamps(seen - expected, known * (1 - canvas))
        is_other = (np.abs(even - expected).max(2) > 2 * _NOISE).astype(np.uint8)
        patch = cv2.morphologyEx(is_other * view.canvas, cv2.MORPH_OPEN, np.ones((_PATCH, _PATCH), np.uint8))
        touched = cv2.dilate(patch, np.ones((_PATCH, _PATCH), np.uint8)).astype(np.float32) * canvas
    seen = seen - _lamps(seen - expected, known * (touched <= 0))
    if strokes is None:
        as_paint = np.where(touched > 0, _STRANGE, 1).astype(np.float32)
    else:
        ring = cv2.dilate((1 - canvas).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        low, high = expected.copy(), expected.copy()
        for colors in (expected, expected + change):
            inside = np.where(view.canvas[..., None], colors, np.inf)
            low = np.minimum(low, cv2.erode(inside.astype(np.float32), around))
            outside = np.where(view.canvas[..., None], colors, -np.inf)
            high = np.maximum(high, cv2.dilate(outside.astype(np.float32), around))
        beyond = np.maximum(np.maximum(low - _SPREAD - seen, seen - high - _SPREAD), 0)
        as_paint = np.where(touched > 0, _misfit(beyond, _NOISE), 1).astype(np.float32)
        as_paint[ring & (touched > 0)] = 0
    grain = np.zeros_like(canvas)
    for where in (view.canvas, ~view.canvas):
        as_before = where & (known > 0) & (touched <= 0)
        if as_before.any():  # faint extra light is a larger share of the dark table than of the bright canvas
            seen[where] -= np.median((seen - expected)[as_before], axis=0)
            alike = _mean_square((seen - expected)[as_before])
            grain[where] = min(_GRAINY * float(np.median(alike)), (_NOISE / 2) ** 2)
    expected, is_rim = _with_rim(view, seen, expected, touched)
    return _Scene(seen.astype(np.float32), expected, known, canvas, touched, as_paint, is_rim, grain, view.pitch)


def _with_rim(view: CanvasView, seen: Pixels, expected: Pixels, touched: Pixels) -> tuple[Pixels, Pixels]:
    """Returns the expectation with new paint blended into the blur of the canvas edge, and the mask of these pixels.

    The colour of the paint is read slightly farther inside. Only there can a displaced stroke change it.
    """
    composed, is_rim = expected.copy(), np.zeros_like(touched)
    share = cv2.GaussianBlur(view.canvas.astype(np.float32), (0, 0), _BLUR)[..., None]
    down, across = np.flatnonzero(view.canvas.any(1)), np.flatnonzero(view.canvas.any(0))
    for axis, inside in ((0, down), (1, across)):
        for edge, inwards in ((inside[0], 1), (inside[-1], -1)):
            at = edge + inwards * np.arange(-_RIM, _RIM)
            within, beyond = edge + inwards * (_RIM + 1), edge - inwards * (_RIM + 2)
            strip, paint, table = ((slice(None),) * axis + (which,) for which in (at, [within], [beyond]))
            light = share[strip] * np.exp(seen[paint]) + (1 - share[strip]) * np.exp(expected[table])
            is_new = np.broadcast_to(touched[paint] > 0, is_rim[strip].shape)
            composed[strip] = np.where(is_new[..., None], np.log(light), composed[strip])
            is_rim[strip] = np.where(is_new, 1, is_rim[strip])
    return composed, is_rim


def _lamps(change: Pixels, weight: Pixels) -> Pixels:
    """Returns the change of the lamps' brightness as a plane over the view, logarithm of light [rows, columns, 3]."""
    rows, columns = weight.shape
    small = (max(2, columns // _LIGHT_CELL), max(2, rows // _LIGHT_CELL))
    share = cv2.resize(weight, small, interpolation=cv2.INTER_AREA)
    mean = cv2.resize(change * weight[..., None], small, interpolation=cv2.INTER_AREA) / (share[..., None] + 1e-6)
    usable = share > 0.5
    if usable.sum() < 8:
        return np.zeros_like(change)
    row, column = ((2 * place + 1) / side - 1 for place, side in zip(np.nonzero(usable), usable.shape, strict=True))
    known = torch.from_numpy(mean[usable].T).double()
    lamps, _ = FlatField.even().fit_tilt(known, torch.from_numpy(row), torch.from_numpy(column))
    return np.asarray(lamps.light(rows, columns).log().permute(1, 2, 0).numpy(), np.float32)


def _misfit(off: Pixels, noise: float, grain: Pixels | float = 0.0) -> Pixels:
    """Returns how unlike noise a difference of light [..., 3] is: [...] in [0, 1]; 0 for squares up to `grain`."""
    square = np.maximum(_mean_square(off) - grain, 0)
    return np.asarray(square / (square + noise**2), np.float32)


def _mean_square(off: Pixels) -> Pixels:
    """Returns the mean square of the three bands [..., 3]: [...]; numpy's mean of so short an axis is slow."""
    square = off**2
    return np.asarray((square[..., 0] + square[..., 1] + square[..., 2]) / np.float32(3), np.float32)
