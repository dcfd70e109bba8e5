"""Inner loops of the scanline renderer, compiled by numba; docs/explanation/renderer.md derives them.

Each kernel works on a range of strokes or of bands of rows. No two ranges write to the same memory, so the
result has the same bits for any number of threads. Loops over a run of pixels are split and use only slices, so
that the compiler can vectorise all but the look-ups in the map. Sums may be reordered, but NaN and infinity
keep their meaning.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

# Pixels of a stroke: for each row of the canvas, the exact run of columns whose samples touch its cells
#
# A sample touches a box of cells, rows [top, bottom) and columns [left, right), if its column lies in [left - 1,
# right) and its row in [top - 1, bottom). Then at least one of the four cells around the sample is in the box. If
# all cells outside the box are zero, coverage and its gradient are exactly zero outside these samples.

Array = NDArray[Any]


class Spans(NamedTuple):
    """Touched pixels of n strokes, packed by stroke, then by row, then by column.

    Stroke i reaches rows top[i] to bottom[i] - 1. Its row y is segment k = segment[i] + y - top[i]. Segment k
    begins at column first[k], and its packed pixels are offset[k] to offset[k + 1] - 1.
    """

    top: Array  # [n]
    bottom: Array  # [n]
    segment: Array  # [n + 1]
    first: Array  # [segments]
    offset: Array  # [segments + 1]

    @property
    def pixels(self) -> int:
        """Number of packed pixels."""
        return int(self.offset[-1])


def whole_maps(magnitude: Array) -> Array:
    """Returns boxes of all cells: [n, 4] (top, bottom, left, right) for maps [n, h, w]."""
    n, h, w = magnitude.shape
    return np.tile(np.array([0, h, 0, w]), (n, 1))


def painted_boxes(magnitude: Array) -> Array:
    """Returns the smallest boxes that hold all nonzero cells, as `whole_maps`."""
    boxes = np.zeros((len(magnitude), 4), np.int64)
    _find_boxes(magnitude, boxes)
    return boxes


def find_spans(affine: Array, boxes: Array, height: int, width: int) -> Spans:
    """Returns the spans of boxes of cells [n, 4] on a canvas of `height` x `width` pixels.

    affine [n, 2, 3]: maps from canvas pixels to cells
    """
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
    """Writes the range of rows that surely holds each stroke to `top` and `bottom`.

    slack: receives the rounding error at the border of each stroke in cells
    """
    for i in range(len(affine)):
        a, b, c = np.float64(affine[i, 0, 0]), np.float64(affine[i, 0, 1]), np.float64(affine[i, 0, 2])
        d, e, f = np.float64(affine[i, 1, 0]), np.float64(affine[i, 1, 1]), np.float64(affine[i, 1, 2])
        reach = (abs(a) + abs(d)) * width + (abs(b) + abs(e)) * height + abs(c) + abs(f)
        if boxes[i, 0] == boxes[i, 1] or not np.isfinite(reach):
            continue
        slack[i] = 8 * np.finfo(affine.dtype).eps * reach
        top[i], bottom[i] = 0, height
        determinant = a * e - b * d
        if determinant == 0:  # a degenerate map has no inverse; all rows are examined
            continue
        # Row of map point (u, v): (a (v - f) - d (u - c)) / determinant. Its extremes are at the corners.
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
    """Writes the first column of the run of each segment k to first[k], and its number of columns to offset[k + 1]."""
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
            # The exact ends are found with the arithmetic of the samples.
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
    """Returns the part of [least, most] for which slope x + shift lies in [low, high]."""
    if slope == 0:
        if low <= shift <= high:
            return least, most
        return 0.0, -1.0
    one_end, other_end = (low - shift) / slope, (high - shift) / slope
    return max(least, min(one_end, other_end)), min(most, max(one_end, other_end))


BAND = 8  # rows
LANES = 8  # number of samples that are located together
_SUMS = {"reassoc", "contract", "nsz"}


@njit(nogil=True, cache=True)
def run(firsts, offsets, k):  # type: ignore[no-untyped-def]
    """Returns first column, start of the packed pixels and number of pixels of segment k.

    The numbers are unsigned, because indices that may be negative prevent vectorisation. The function takes two
    arrays instead of `Spans`: numba would count references to all five arrays at each call, which takes longer
    than the pixels of a run.
    """
    start = offsets[k]
    return np.uint64(firsts[k]), np.uint64(start), np.uint64(offsets[k + 1] - start)


# fastmath is inherited from the caller unless it is switched off here.
@njit(nogil=True, cache=True, fastmath=False)
def _locate(place, columns, left, count, y, stride, cell, right_share, below_share):  # type: ignore[no-untyped-def]
    """Finds the cells of `count` pixels of row y on the bordered map, with their bilinear weights.

    Writes the index of the upper left cell to `cell` and the weights of the right and lower cells to the
    shares. Rounds exactly like `reference.composite`, so both fall on the same side of each kink. Fills whole
    vectors; values after `count` are undefined.
    """
    a, b, c = place[0, 0], place[0, 1], place[0, 2]
    d, e, f = place[1, 0], place[1, 1], place[1, 2]
    across, down = b * y, e * y
    lanes = np.uint64(LANES)
    for p in range((count + lanes - np.uint64(1)) // lanes * lanes):
        x = columns[left + p]
        column, row = a * x + across + c, d * x + down + f
        before, above = np.floor(column), np.floor(row)
        right_share[p] = column - before
        below_share[p] = row - above
        cell[p] = (np.int32(above) + 1) * stride + np.int32(before) + 1


@njit(nogil=True, cache=True)
def _border(mark, box, bordered):  # type: ignore[no-untyped-def]
    """Copies the rows of a map [h, w] inside its box into `bordered` [(h + 2) (w + 2)].

    Its first and last columns are always zero. The rows next to the box are set to zero.
    """
    _, w = mark.shape
    stride = w + 2
    bordered[box[0] * stride : (box[0] + 1) * stride] = 0
    bordered[(box[1] + 1) * stride : (box[1] + 2) * stride] = 0
    for row in range(box[0], box[1]):
        line, middle = mark[row], bordered[(row + 1) * stride + 1 :]
        for column in range(w):
            middle[column] = line[column]


@njit(nogil=True, cache=True, fastmath=_SUMS)
def sample(begin, end, magnitude, affine, boxes, columns, spans, base, sampled):  # type: ignore[no-untyped-def]
    """Writes the coverage of strokes begin to end - 1 at their packed pixels to sampled[0, offset - base].

    Writes the derivatives along map columns and map rows to sampled[1] and sampled[2].
    """
    tops, bottoms, segments, firsts, offsets = spans
    _, h, w = magnitude.shape
    number = magnitude.dtype.type
    stride = w + 2
    bordered = np.zeros((h + 2) * stride, magnitude.dtype)
    cell = np.empty(len(columns), np.uint32)
    right_share, below_share = np.empty_like(columns), np.empty_like(columns)
    alpha, by_column, by_row = sampled[0], sampled[1], sampled[2]
    for i in range(begin, end):
        place = affine[i]
        if tops[i] < bottoms[i]:
            _border(magnitude[i], boxes[i], bordered)
        for y in range(tops[i], bottoms[i]):
            left, start, count = run(firsts, offsets, segments[i] + y - tops[i])
            packed = start - np.uint64(base)
            _locate(place, columns, left, count, number(y), stride, cell, right_share, below_share)
            for p in range(count):
                at = cell[p]
                upper_left, lower_left = bordered[at], bordered[at + stride]
                above, under = bordered[at + 1] - upper_left, bordered[at + stride + 1] - lower_left
                upper, lower = upper_left + right_share[p] * above, lower_left + right_share[p] * under
                alpha[packed + p] = upper + below_share[p] * (lower - upper)
                by_column[packed + p] = above + below_share[p] * (under - above)
                by_row[packed + p] = lower - upper


@njit(nogil=True, cache=True, fastmath=_SUMS)
def blend(begin, end, strokes, spans, base, alpha, color, picture):  # type: ignore[no-untyped-def]
    """Paints strokes[0] to strokes[1] - 1 in order on bands begin to end - 1 of the picture [3, H, W]."""
    tops, bottoms, segments, firsts, offsets = spans
    for band in range(begin, end):
        for i in range(strokes[0], strokes[1]):
            red, green, blue = color[i, 0], color[i, 1], color[i, 2]
            for y in range(max(tops[i], band * BAND), min(bottoms[i], (band + 1) * BAND)):
                left, start, count = run(firsts, offsets, segments[i] + y - tops[i])
                packed = start - np.uint64(base)
                for p in range(count):
                    cover, x = alpha[packed + p], left + p
                    picture[0, y, x] += cover * (red - picture[0, y, x])
                    picture[1, y, x] += cover * (green - picture[1, y, x])
                    picture[2, y, x] += cover * (blue - picture[2, y, x])


@njit(nogil=True, cache=True, fastmath=_SUMS)
def pull_through(begin, end, spans, alpha, color, canvas, gradient, through, slope, to_color):  # type: ignore[no-untyped-def]
    """Computes gradients of coverage and colours in bands begin to end - 1, in two passes over the strokes.

    C is the picture below a stroke, g the gradient of the picture. The first pass goes from the canvas up and
    carries only the scalar g . C. The second pass goes down.
    through [H, W]: ones at first; at the end the visible share of the canvas
    slope (packed; empty if not wanted): receives the gradient of the coverage, g . (c - C) times the
    transmission of the strokes above
    to_color [bands, n, 3]: zeros at first; receives each band's part of the gradient of the colours
    """
    tops, bottoms, segments, firsts, offsets = spans
    _, height, width = canvas.shape
    beneath = np.empty((BAND, width), canvas.dtype)
    for band in range(begin, end):
        top = band * BAND
        if len(slope) > 0:
            for y in range(top, min(top + BAND, height)):
                under = beneath[y - top]
                under[:] = 0
                for channel in range(3):
                    down, below = gradient[channel, y], canvas[channel, y]
                    for x in range(width):
                        under[x] += down[x] * below[x]
            for i in range(len(color)):
                red, green, blue = color[i, 0], color[i, 1], color[i, 2]
                for y in range(max(tops[i], top), min(bottoms[i], top + BAND)):
                    left, start, count = run(firsts, offsets, segments[i] + y - tops[i])
                    for p in range(count):
                        x = left + p
                        paint = red * gradient[0, y, x] + green * gradient[1, y, x] + blue * gradient[2, y, x]
                        rise = paint - beneath[y - top, x]
                        slope[start + p] = rise
                        beneath[y - top, x] += alpha[start + p] * rise
        for i in range(len(color) - 1, -1, -1):
            for y in range(max(tops[i], top), min(bottoms[i], top + BAND)):
                left, start, count = run(firsts, offsets, segments[i] + y - tops[i])
                if len(slope) > 0:
                    for p in range(count):
                        slope[start + p] *= through[y, left + p]
                red = green = blue = through.dtype.type(0)
                for p in range(count):
                    x = left + p
                    share = through[y, x] * alpha[start + p]
                    through[y, x] -= share
                    red += gradient[0, y, x] * share
                    green += gradient[1, y, x] * share
                    blue += gradient[2, y, x] * share
                to_color[band, i, 0] += red
                to_color[band, i, 1] += green
                to_color[band, i, 2] += blue


@njit(nogil=True, cache=True, fastmath=_SUMS)
def scatter_to_strokes(begin, end, affine, boxes, columns, spans, sampled, slope, to_affine, to_map):  # type: ignore[no-untyped-def]
    """Computes gradients of the affine maps [n, 2, 3] and of the magnitude maps [n, h, w] of strokes begin to end - 1.

    sampled [3, packed]: output of `sample`
    slope (packed): gradient of the coverage
    to_affine: zeros at first; skipped if it is empty
    to_map: skipped if it is empty
    """
    tops, bottoms, segments, firsts, offsets = spans
    _, h, w = to_map.shape
    number = slope.dtype.type
    stride = w + 2
    cell = np.empty(len(columns), np.uint32)
    right_share, below_share = np.empty_like(columns), np.empty_like(columns)
    bordered = np.empty((h + 2) * stride, slope.dtype)
    by_column, by_row = sampled[1], sampled[2]
    for i in range(begin, end):
        if len(to_map) > 0:
            to_map[i] = number(0)
        if tops[i] == bottoms[i]:
            continue
        place, top, bottom = affine[i], boxes[i, 0], boxes[i, 1]
        if len(to_affine) > 0:
            for y in range(tops[i], bottoms[i]):
                left, start, count = run(firsts, offsets, segments[i] + y - tops[i])
                column_sum = column_x = row_sum = row_x = number(0)
                for p in range(count):
                    by_columns, by_rows = slope[start + p] * by_column[start + p], slope[start + p] * by_row[start + p]
                    column_sum += by_columns
                    column_x += by_columns * columns[left + p]
                    row_sum += by_rows
                    row_x += by_rows * columns[left + p]
                to_affine[i, 0, 0] += column_x
                to_affine[i, 0, 1] += column_sum * number(y)
                to_affine[i, 0, 2] += column_sum
                to_affine[i, 1, 0] += row_x
                to_affine[i, 1, 1] += row_sum * number(y)
                to_affine[i, 1, 2] += row_sum
        if len(to_map) > 0:
            bordered[top * stride : (bottom + 2) * stride] = number(0)
            for y in range(tops[i], bottoms[i]):
                left, start, count = run(firsts, offsets, segments[i] + y - tops[i])
                _locate(place, columns, left, count, number(y), stride, cell, right_share, below_share)
                for p in range(count):
                    at, rise = cell[p], slope[start + p]
                    lower = rise * below_share[p]
                    upper = rise - lower
                    bordered[at] += upper - upper * right_share[p]
                    bordered[at + 1] += upper * right_share[p]
                    bordered[at + stride] += lower - lower * right_share[p]
                    bordered[at + stride + 1] += lower * right_share[p]
            for row in range(top, bottom):
                middle, line = bordered[(row + 1) * stride + 1 :], to_map[i, row]
                for column in range(boxes[i, 2], boxes[i, 3]):
                    line[column] = middle[column]


# Strokes of uncertain coverage: mean and variance of each pixel, and their gradients
#
# docs/explanation/renderer.md derives the recurrences. `share` and `full` are those of `CoverageSpread`.


@njit(nogil=True, cache=True, fastmath=_SUMS)
def blend_moments(begin, end, strokes, spans, base, alpha, color, spread, mean, variance):  # type: ignore[no-untyped-def]
    """Paints strokes[0] to strokes[1] - 1 in order on bands begin to end - 1 of mean [3, H, W] and variance [H, W]."""
    tops, bottoms, segments, firsts, offsets = spans
    share, full = spread
    number = mean.dtype.type
    one, none, third = number(1), number(0), number(1 / 3)
    for band in range(begin, end):
        for i in range(strokes[0], strokes[1]):
            red, green, blue = color[i, 0], color[i, 1], color[i, 2]
            for y in range(max(tops[i], band * BAND), min(bottoms[i], (band + 1) * BAND)):
                left, start, count = run(firsts, offsets, segments[i] + y - tops[i])
                packed = start - np.uint64(base)
                for p in range(count):
                    cover, x = alpha[packed + p], left + p
                    from_red, from_green, from_blue = mean[0, y, x] - red, mean[1, y, x] - green, mean[2, y, x] - blue
                    away = third * (from_red * from_red + from_green * from_green + from_blue * from_blue)
                    doubt, keeps = share * cover * max(full - cover, none), one - cover
                    variance[y, x] = (keeps * keeps + doubt) * variance[y, x] + doubt * away
                    mean[0, y, x] -= cover * from_red
                    mean[1, y, x] -= cover * from_green
                    mean[2, y, x] -= cover * from_blue


@njit(nogil=True, cache=True, fastmath=_SUMS)
def pull_through_moments(  # type: ignore[no-untyped-def]
    begin, end, spans, alpha, color, spread, canvas, uncertain, to_mean, to_variance, slope, to_color
):  # fmt: skip
    """Computes gradients of coverage, colours and canvas in bands begin to end - 1, one band after another.

    The pass upwards computes mean and variance below each stroke again. It does so for one band at a time, so
    they stay in the cache.
    canvas [3, H, W], uncertain [H, W]: mean and variance of the canvas
    to_mean [3, H, W], to_variance [H, W]: gradients of the result at first, of the canvas at the end
    slope (packed): receives the gradient of the coverage
    to_color [bands, n, 3]: zeros at first; receives each band's part of the gradient of the colours
    """
    tops, bottoms, segments, firsts, offsets = spans
    _, height, width = canvas.shape
    share, full = spread
    number = to_mean.dtype.type
    one, two, none, third = number(1), number(2), number(0), number(1 / 3)
    mean, variance = np.empty((3, BAND, width), canvas.dtype), np.empty((BAND, width), canvas.dtype)
    below = np.empty((4, 0), canvas.dtype)
    for band in range(begin, end):
        top = band * BAND
        rows = min(BAND, height - top)
        pixels = np.int64(0)
        for i in range(len(color)):
            for y in range(max(tops[i], top), min(bottoms[i], top + BAND)):
                pixels += np.int64(run(firsts, offsets, segments[i] + y - tops[i])[2])
        if pixels > below.shape[1]:
            below = np.empty((4, pixels), canvas.dtype)
        for row in range(rows):  # no slices: half of numba's compiled strings would be messages about unequal shapes
            for x in range(width):
                mean[0, row, x], mean[1, row, x] = canvas[0, top + row, x], canvas[1, top + row, x]
                mean[2, row, x], variance[row, x] = canvas[2, top + row, x], uncertain[top + row, x]
        at = np.uint64(0)
        for i in range(len(color)):
            red, green, blue = color[i, 0], color[i, 1], color[i, 2]
            for y in range(max(tops[i], top), min(bottoms[i], top + BAND)):
                left, start, count = run(firsts, offsets, segments[i] + y - tops[i])
                row = y - top
                # The mean below is stored as its difference from the paint.
                for p in range(count):
                    x = left + p
                    below[0, at + p], below[1, at + p] = mean[0, row, x] - red, mean[1, row, x] - green
                    below[2, at + p], below[3, at + p] = mean[2, row, x] - blue, variance[row, x]
                for p in range(count):
                    cover, x = alpha[start + p], left + p
                    from_red, from_green, from_blue = below[0, at + p], below[1, at + p], below[2, at + p]
                    away = third * (from_red * from_red + from_green * from_green + from_blue * from_blue)
                    doubt, keeps = share * cover * max(full - cover, none), one - cover
                    variance[row, x] = (keeps * keeps + doubt) * variance[row, x] + doubt * away
                    mean[0, row, x] -= cover * from_red
                    mean[1, row, x] -= cover * from_green
                    mean[2, row, x] -= cover * from_blue
                at += count
        for i in range(len(color) - 1, -1, -1):
            for y in range(min(bottoms[i], top + BAND) - 1, max(tops[i], top) - 1, -1):
                left, start, count = run(firsts, offsets, segments[i] + y - tops[i])
                at -= count
                to_red = to_green = to_blue = none
                for p in range(count):
                    cover, x = alpha[start + p], left + p
                    by_red, by_green, by_blue = to_mean[0, y, x], to_mean[1, y, x], to_mean[2, y, x]
                    from_red, from_green, from_blue = below[0, at + p], below[1, at + p], below[2, at + p]
                    away = third * (from_red * from_red + from_green * from_green + from_blue * from_blue)
                    by_variance, varied = to_variance[y, x], below[3, at + p]
                    bare, keeps = max(full - cover, none), one - cover
                    rising = share * (bare - cover) if bare > none else none
                    slope[start + p] = by_variance * (rising * (varied + away) - two * keeps * varied) - (
                        by_red * from_red + by_green * from_green + by_blue * from_blue
                    )
                    crossed = two * third * share * cover * bare * by_variance
                    to_red += cover * by_red - crossed * from_red
                    to_green += cover * by_green - crossed * from_green
                    to_blue += cover * by_blue - crossed * from_blue
                to_color[band, i, 0] += to_red
                to_color[band, i, 1] += to_green
                to_color[band, i, 2] += to_blue
                for p in range(count):
                    cover, x = alpha[start + p], left + p
                    keeps, doubt = one - cover, share * cover * max(full - cover, none)
                    crossed = two * third * doubt * to_variance[y, x]
                    to_mean[0, y, x] = keeps * to_mean[0, y, x] + crossed * below[0, at + p]
                    to_mean[1, y, x] = keeps * to_mean[1, y, x] + crossed * below[1, at + p]
                    to_mean[2, y, x] = keeps * to_mean[2, y, x] + crossed * below[2, at + p]
                    to_variance[y, x] *= keeps * keeps + doubt
