"""Telling good strokes of a library from dirty ones by their marks alone.

A stroke is compared with where its path lies and with the other strokes of the library; no figure
here belongs to a brush. Statistics are medians, so that they hold while most strokes are good.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from frida_painter.brush.flaw import Flaw
from frida_painter.brush.library import StrokeLibrary

_INKED = 0.3
"""Magnitude from which on a cell counts as painted."""
_LEAST_PAINT = 0.35  # of what strokes of its shape have
_LEAST_COVERED = 0.2  # of the way
_MOST_FOREIGN = 0.03  # of the paint of a usual stroke
_MOST_TORN = 0.09  # of the mark's own area
_WIDE_GAP = 0.18  # of the width of a usual mark
_MOST_POROUS = 0.15  # of the mark's area when its pores are closed
_WIDE_PORE = 0.25  # of the width of a usual mark
_MOST_SKIPPED = 0.05  # of the way
_MOST_ASTRAY = 7.0  # standard deviations
_FEWEST_TO_COMPARE = 12
_PATH_POINTS = 48
_ROUNDS = 20


def judge(library: StrokeLibrary) -> NDArray[np.uint8]:
    """What is wrong with each stroke, [n] of `Flaw`.

    A library that was judged when it was painted keeps that judgement; of others the marks tell.
    """
    if library.flaws is not None:
        return library.flaws
    return judge_marks(library)


def clean(library: StrokeLibrary) -> StrokeLibrary:
    """The strokes to learn from: those without a flaw. Raises LibraryError where none is left."""
    return library[judge(library) == Flaw.NONE]


def judge_marks(library: StrokeLibrary) -> NDArray[np.uint8]:
    """What the marks tell about each stroke, [n] of `Flaw`, whatever was known before."""
    marks = [_Mark.of(library, index) for index in range(len(library))]
    reach = _reach(marks)
    seen = [_Look.at(mark, reach) for mark in marks]
    own = np.array([look.own for look in seen])
    usual = float(np.median(own))
    width = float(np.median([look.width for look in seen]))
    wide = max(2, round(_WIDE_GAP * width))
    torn = np.array([look.torn(wide) for look in seen])
    # Of a stroke that is hardly longer than wide, the way says nothing.
    covered = np.array([look.covered if look.way >= 2 * width else 1.0 for look in seen])
    flaws = np.zeros(len(library), np.uint8)
    # The gravest reason is named, hence written last.
    flaws[_astray(np.array([look.offset for look in seen]), own, width)] = Flaw.ASTRAY
    flaws[1 - covered > _MOST_SKIPPED] = Flaw.SKIPPED
    porous = np.array([look.porous(max(1, round(_WIDE_PORE * width / 2))) for look in seen])
    flaws[(torn > _MOST_TORN) | (porous > _MOST_POROUS)] = Flaw.TORN
    flaws[np.array([look.foreign for look in seen]) > _MOST_FOREIGN * usual] = Flaw.TOUCHED
    flaws[(own < _LEAST_PAINT * _expected(library, own)) | (own == 0) | (covered < _LEAST_COVERED)] = Flaw.EMPTY
    return flaws


@dataclass(frozen=True)
class _Mark:
    """A mark and its path.

    paint [rows, columns] in [0, 1]; away [rows, columns]: pixels from the path; path [k, 2]: its
    (column, row).
    """

    paint: NDArray[np.float32]
    away: NDArray[np.float32]
    path: NDArray[np.float64]

    @classmethod
    def of(cls, library: StrokeLibrary, index: int) -> "_Mark":
        row, column = library.origin_px
        pitch = library.metres_per_pixel
        fraction = np.linspace(0, 1, _PATH_POINTS)
        along, aside = library.length_m[index] * fraction, 3 * fraction * (1 - fraction) * library.bend_m[index]
        path = np.stack((column + along / pitch, row - aside / pitch), -1)
        bare = np.full(library.magnitude.shape[1:], 255, np.uint8)
        cv2.polylines(bare, [np.rint(16 * path).astype(np.int32)], False, 0, 1, cv2.LINE_8, 4)
        away = np.asarray(cv2.distanceTransform(bare, cv2.DIST_L2, 5), np.float32)
        return cls(library.magnitude[index].astype(np.float32) / 255, away, path)

    def extent(self) -> float:
        """Within how many pixels of the path nearly all paint lies."""
        paint, away = self.paint.ravel(), self.away.ravel()
        order = np.argsort(away)
        total = np.cumsum(paint[order])
        return float(away[order[np.searchsorted(total, 0.95 * total[-1])]])


@dataclass(frozen=True)
class _Look:
    """What is seen of one mark.

    inked [rows, columns]: where the stroke itself left paint; own, foreign: paint of the stroke and of
    something else, in pixels of full paint; way: pixels from start to end; covered: share of the way
    that has paint; width: pixels across; offset (column, row): of the paint's centre from the path's.
    """

    inked: NDArray[np.bool_]
    own: float
    foreign: float
    way: float
    covered: float
    width: float
    offset: tuple[float, float]

    @classmethod
    def at(cls, mark: _Mark, reach: float) -> "_Look":
        near = mark.away <= reach
        # A patch of paint belongs to the stroke where any of it is within reach of the path.
        _, patch = cv2.connectedComponents((mark.paint > _INKED / 2).astype(np.uint8), connectivity=8)
        belongs = np.isin(patch, np.unique(patch[near & (patch > 0)])) | near
        belongs &= mark.away <= 2 * reach  # a neighbour that touches the stroke is no part of it
        paint = np.where(belongs, mark.paint, 0)
        own = float(paint.sum())
        inked = paint > _INKED
        first, last = mark.path[0, 0], mark.path[-1, 0]
        margin = 0.1 * (last - first)
        across = inked[:, round(first + margin) : round(last - margin) + 1].sum(0)
        weight = paint / max(own, 1e-6)
        rows, columns = np.indices(paint.shape)
        offset = (
            float((weight * columns).sum() - mark.path[:, 0].mean()),
            float((weight * rows).sum() - mark.path[:, 1].mean()),
        )
        foreign = float(mark.paint.sum()) - own
        covered = float((across > 0).mean()) if len(across) else 0.0
        width = float(np.median(across[across > 0])) if across.any() else 0.0
        return cls(inked, own, foreign, last - first, covered, width, offset)

    def porous(self, radius: int) -> float:
        """The share of the mark that is bare in spots of less than `radius` pixels: dry brush."""
        inked = self.inked.astype(np.uint8)
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
        closed = int(np.count_nonzero(cv2.morphologyEx(inked, cv2.MORPH_CLOSE, disc)))
        return 1 - int(np.count_nonzero(inked)) / closed if closed else 0.0

    def torn(self, wide: int) -> float:
        """Area of gaps of at least `wide` pixels across the stroke, as a share of what is painted.

        A path never turns back, so that each column crosses it once.
        """
        painted = int(self.inked.sum())
        if painted == 0:
            return 0.0
        bare = 0
        for column in np.flatnonzero(self.inked.any(0)):
            gaps = np.diff(np.flatnonzero(self.inked[:, column])) - 1
            bare += int(gaps[gaps >= wide].sum())
        return bare / painted


def _reach(marks: list[_Mark]) -> float:
    """How many pixels from its path a stroke's own paint lies, generously."""
    extents = [mark.extent() for mark in marks if mark.paint.any()]
    return 1.6 * float(np.median(extents)) + 3 if extents else 3.0


def _expected(library: StrokeLibrary, own: NDArray[np.float64]) -> NDArray[np.float64]:
    """The paint that strokes of these shapes have in this library, pixels, [n]."""
    usual = float(np.median(own))
    if len(library) < _FEWEST_TO_COMPARE or usual == 0:
        return np.full(len(library), usual)
    length, bend, press = library.length_m, np.abs(library.bend_m), library.thickness
    terms = np.stack((np.ones_like(length), length, press, length * press, bend), 1).astype(np.float64)
    weight = np.ones(len(library))
    expected = np.full(len(library), usual)
    for _ in range(_ROUNDS):  # least absolute deviations, by least squares weighed again and again
        root = np.sqrt(weight)[:, None]
        expected = terms @ np.linalg.lstsq(root * terms, root[:, 0] * own, rcond=None)[0]
        weight = 1 / np.maximum(np.abs(own - expected), 0.01 * usual)
    return np.maximum(expected, 0.1 * usual)


def _astray(offset: NDArray[np.float64], own: NDArray[np.float64], width: float) -> NDArray[np.bool_]:
    """Which marks lie far from where the others lie beside their paths, [n]."""
    if len(offset) < _FEWEST_TO_COMPARE:
        return np.zeros(len(offset), np.bool_)
    beside = offset - np.median(offset[own > 0], axis=0)
    spread = 1.48 * np.median(np.abs(beside), axis=0)
    # Where the strokes lie as if on rails, a small deviation is none.
    far = np.abs(beside) > np.maximum(_MOST_ASTRAY * spread, 0.2 * width)
    return np.asarray(far.any(1))
