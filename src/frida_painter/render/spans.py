"""Which pixels a stroke covers: for every row of the canvas the exact run of columns whose samples touch its cells.

Compiled by numba. A box of cells, rows [top, bottom) and columns [left, right), is touched by a
sample whose column lies in [left - 1, right) and whose row lies in [top - 1, bottom): there at
least one of the four cells around the sample is in the box. If all cells outside the box are zero,
so are coverage and sampling gradient, exactly, wherever the box is not touched.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import float32, float64, int32, int64, njit, types
from numpy.typing import NDArray

Array = NDArray[Any]


class Spans(NamedTuple):
    """The touched pixels of n strokes, packed: stroke after stroke, row after row, left to right.

    Stroke i reaches rows top[i] to bottom[i] - 1. Its row y is segment k = segment[i] + y - top[i]:
    it begins at column first[k] and its pixels are offset[k] to offset[k + 1] - 1 of the packed ones.
    """

    top: Array  # [n]
    bottom: Array  # [n]
    segment: Array  # [n + 1]
    first: Array  # [segments]
    offset: Array  # [segments + 1]

    @property
    def pixels(self) -> int:
        """How many packed pixels there are."""
        return int(self.offset[-1])


def whole_maps(magnitude: Array) -> Array:
    """The boxes of all cells: [n, 4] (top, bottom, left, right) for maps [n, h, w]."""
    n, h, w = magnitude.shape
    return np.tile(np.array([0, h, 0, w]), (n, 1))


def painted_boxes(magnitude: Array) -> Array:
    """The smallest boxes that hold all cells which are not zero: [n, 4] (top, bottom, left, right)."""
    boxes = np.zeros((len(magnitude), 4), np.int64)
    _find_boxes(magnitude, boxes)
    return boxes


def find_spans(affine: Array, boxes: Array, height: int, width: int) -> Spans:
    """The spans of boxes of cells [n, 4] that affine [n, 2, 3] places on a canvas of so many pixels."""
    n = len(affine)
    top, bottom = np.zeros(n, np.int64), np.zeros(n, np.int64)
    slack = np.zeros(n)
    _find_rows(affine, boxes, height, width, slack, top, bottom)
    segment = np.zeros(n + 1, np.int64)
    np.cumsum(bottom - top, out=segment[1:])
    first, offset = np.zeros(segment[-1], np.int32), np.zeros(segment[-1] + 1, np.int64)
    _find_columns(affine, boxes, width, slack, top, bottom, segment, first, offset)
    np.cumsum(offset, out=offset)
    return Spans(top, bottom, segment, first, offset)


@njit(nogil=True, cache=True)
def _find_boxes(magnitude, boxes):  # type: ignore[no-untyped-def]
    n, h, w = magnitude.shape
    painted = np.empty(w, np.bool_)
    for i in range(n):
        top, bottom, left, right = h, 0, w, 0
        painted[:] = False
        for row in range(h):
            line = magnitude[i, row]
            any_painted = False
            for column in range(w):
                here = line[column] != 0
                any_painted |= here
                painted[column] |= here
            if any_painted:
                top, bottom = min(top, row), row + 1
        for column in range(w):
            if painted[column]:
                left, right = min(left, column), column + 1
        if bottom > 0:
            boxes[i, 0], boxes[i, 1], boxes[i, 2], boxes[i, 3] = top, bottom, left, right


@njit(nogil=True, cache=True)
def _find_rows(affine, boxes, height, width, slack, top, bottom):  # type: ignore[no-untyped-def]
    """Fills in rows that are sure to hold each stroke, and by how many cells rounding can move its border."""
    for i in range(len(affine)):
        a, b, c = np.float64(affine[i, 0, 0]), np.float64(affine[i, 0, 1]), np.float64(affine[i, 0, 2])
        d, e, f = np.float64(affine[i, 1, 0]), np.float64(affine[i, 1, 1]), np.float64(affine[i, 1, 2])
        reach = (abs(a) + abs(d)) * width + (abs(b) + abs(e)) * height + abs(c) + abs(f)
        if boxes[i, 0] == boxes[i, 1] or not np.isfinite(reach):
            continue
        slack[i] = 8 * np.finfo(affine.dtype).eps * reach
        top[i], bottom[i] = 0, height
        determinant = a * e - b * d
        if determinant == 0:  # a map squeezed flat has no inverse; its rows are all looked at
            continue
        # The row of map point (u, v) is (a (v - f) - d (u - c)) / determinant: extremes at the corners.
        above, below = boxes[i, 0] - 1 - slack[i] - f, boxes[i, 1] + slack[i] - f
        left, right = boxes[i, 2] - 1 - slack[i] - c, boxes[i, 3] + slack[i] - c
        p, q = a / determinant, -d / determinant
        least = min(p * above, p * below) + min(q * left, q * right)
        most = max(p * above, p * below) + max(q * left, q * right)
        if least > 0:
            top[i] = np.int64(min(np.floor(least), height))
        if most < height:
            bottom[i] = np.int64(max(np.ceil(most) + 1, 0))
        bottom[i] = max(top[i], min(bottom[i], height))


@njit(nogil=True, cache=True, error_model="numpy")
def _find_columns(affine, boxes, width, slack, top, bottom, segment, first, offset):  # type: ignore[no-untyped-def]
    """Fills in where the run of each row begins, and after it how many columns it has."""
    number = affine.dtype.type
    for i in range(len(affine)):
        a, b, c = affine[i, 0, 0], affine[i, 0, 1], affine[i, 0, 2]
        d, e, f = affine[i, 1, 0], affine[i, 1, 1], affine[i, 1, 2]
        above, below = number(boxes[i, 0] - 1), number(boxes[i, 1])
        before, past = number(boxes[i, 2] - 1), number(boxes[i, 3])
        for y in range(top[i], bottom[i]):
            across, down = b * number(y), e * number(y)
            least, most = _clip(0.0, width - 1.0, a, np.float64(across) + c, before - slack[i], past + slack[i])
            least, most = _clip(least, most, d, np.float64(down) + f, above - slack[i], below + slack[i])
            left = np.int64(max(np.floor(least), 0.0))
            right = np.int64(min(np.ceil(most) + 1, np.float64(width)))
            # From there inwards by the very arithmetic of the samples, so that the run is exact.
            while left < right:
                column, row = a * number(left) + across + c, d * number(left) + down + f
                if before <= column < past and above <= row < below:
                    break
                left += 1
            while left < right:
                column, row = a * number(right - 1) + across + c, d * number(right - 1) + down + f
                if before <= column < past and above <= row < below:
                    break
                right -= 1
            k = segment[i] + y - top[i]
            first[k] = left
            offset[k + 1] = max(right - left, 0)


@njit(nogil=True, cache=True, error_model="numpy")
def _clip(least, most, slope, shift, low, high):  # type: ignore[no-untyped-def]
    """The part of [least, most] in which slope x + shift lies in [low, high]."""
    if slope == 0:
        if low <= shift <= high:
            return least, most
        return 0.0, -1.0
    one_end, other_end = (low - shift) / slope, (high - shift) / slope
    return max(least, min(one_end, other_end)), min(most, max(one_end, other_end))


def argument_types():  # type: ignore[no-untyped-def]
    """The loops, each with the types of its arguments where a plan is made in float32; see compiled.py."""
    places, boxes, index = float32[:, :, ::1], int64[:, ::1], int64[::1]
    rows = (float64[::1], index, index)
    return (
        (_find_boxes, (places, boxes)),
        (_find_rows, (places, boxes, int64, int64, *rows)),
        (_find_columns, (places, boxes, int64, *rows, index, int32[::1], index)),
    )


def spans_type() -> Any:
    """The type of `Spans` to compiled loops."""
    index = int64[::1]
    return types.NamedTuple((index, index, index, int32[::1], index), Spans)  # type: ignore[no-untyped-call]
