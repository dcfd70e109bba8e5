"""Which pixels a stroke covers: for every row of the canvas the exact run of columns whose samples touch its map.

Compiled by numba. A sample touches the map where its column lies in [-1, w) and its row in [-1, h):
there at least one of the four cells around it is a cell of the map, and beyond it both the
coverage and its gradient are exactly zero.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[Any]


class Spans(NamedTuple):
    """The covered pixels of n strokes, packed: stroke after stroke, row after row, left to right.

    Stroke i reaches rows top[i] to bottom[i] - 1. Its row y is segment k = segment[i] + y - top[i]:
    it begins at column first[k] and its pixels are offset[k] to offset[k + 1] - 1 of the packed ones.
    """

    top: Array  # [n]
    bottom: Array  # [n]
    segment: Array  # [n + 1]
    first: Array  # [segments]
    offset: Array  # [segments + 1]


def find_spans(affine: Array, cells: tuple[int, int], pixels: tuple[int, int]) -> Spans:
    """The spans of strokes with maps of (h, w) cells placed by affine [n, 2, 3] on (H, W) pixels."""
    n = len(affine)
    top, bottom = np.zeros(n, np.int64), np.zeros(n, np.int64)
    slack = _find_rows(affine, *cells, *pixels, top, bottom)
    segment = np.zeros(n + 1, np.int64)
    np.cumsum(bottom - top, out=segment[1:])
    first, offset = np.zeros(segment[-1], np.int32), np.zeros(segment[-1] + 1, np.int64)
    _find_columns(affine, *cells, pixels[1], slack, top, bottom, segment, first, offset)
    np.cumsum(offset, out=offset)
    return Spans(top, bottom, segment, first, offset)


@njit(nogil=True, cache=True)
def _find_rows(affine, h, w, height, width, top, bottom):  # type: ignore[no-untyped-def]
    """Fills in rows that are sure to hold each stroke; returns per stroke how far rounding moves its border, cells."""
    n = len(affine)
    slack = np.zeros(n)
    for i in range(n):
        a, b, c = np.float64(affine[i, 0, 0]), np.float64(affine[i, 0, 1]), np.float64(affine[i, 0, 2])
        d, e, f = np.float64(affine[i, 1, 0]), np.float64(affine[i, 1, 1]), np.float64(affine[i, 1, 2])
        reach = (abs(a) + abs(d)) * width + (abs(b) + abs(e)) * height + abs(c) + abs(f)
        if not np.isfinite(reach):
            continue
        slack[i] = 8 * np.finfo(affine.dtype).eps * reach
        bottom[i] = height
        determinant = a * e - b * d
        if determinant == 0:  # a map squeezed flat has no inverse; its rows are all looked at
            continue
        # The row of map point (u, v) is (a (v - f) - d (u - c)) / determinant: extremes at the corners.
        left, right = -1 - slack[i] - c, w + slack[i] - c
        above, below = -1 - slack[i] - f, h + slack[i] - f
        p, q = a / determinant, -d / determinant
        least = min(p * above, p * below) + min(q * left, q * right)
        most = max(p * above, p * below) + max(q * left, q * right)
        if least > 0:
            top[i] = np.int64(min(np.floor(least), height))
        if most < height:
            bottom[i] = np.int64(max(np.ceil(most) + 1, 0))
        bottom[i] = max(top[i], min(bottom[i], height))
    return slack


@njit(nogil=True, cache=True)
def _find_columns(affine, h, w, width, slack, top, bottom, segment, first, offset):  # type: ignore[no-untyped-def]
    """Fills in where the run of each row begins, and after it how many columns it has."""
    number = affine.dtype.type
    for i in range(len(affine)):
        a, b, c = affine[i, 0, 0], affine[i, 0, 1], affine[i, 0, 2]
        d, e, f = affine[i, 1, 0], affine[i, 1, 1], affine[i, 1, 2]
        for y in range(top[i], bottom[i]):
            across, down = b * number(y), e * number(y)
            least, most = _clip(0.0, width - 1.0, a, np.float64(across) + c, w, slack[i])
            least, most = _clip(least, most, d, np.float64(down) + f, h, slack[i])
            left = np.int64(max(np.floor(least), 0.0))
            right = np.int64(min(np.ceil(most) + 1, np.float64(width)))
            # From there inwards by the very arithmetic of the samples, so that the run is exact.
            while left < right and not _touches(number(left), a, across, c, w, d, down, f, h):
                left += 1
            while left < right and not _touches(number(right - 1), a, across, c, w, d, down, f, h):
                right -= 1
            k = segment[i] + y - top[i]
            first[k] = left
            offset[k + 1] = max(right - left, 0)


@njit(nogil=True, cache=True)
def _clip(least, most, slope, shift, cells, slack):  # type: ignore[no-untyped-def]
    """The part of [least, most] in which slope x + shift lies in [-1, cells], give or take `slack`."""
    if slope == 0:
        if -1 - slack <= shift <= cells + slack:
            return least, most
        return 0.0, -1.0
    one_end, other_end = (-1 - slack - shift) / slope, (cells + slack - shift) / slope
    return max(least, min(one_end, other_end)), min(most, max(one_end, other_end))


@njit(nogil=True, cache=True)
def _touches(x, a, across, c, w, d, down, f, h):  # type: ignore[no-untyped-def]
    column, row = a * x + across + c, d * x + down + f
    return -1 <= column < w and -1 <= row < h
