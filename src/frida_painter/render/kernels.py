"""The inner loops of the scanline renderer, compiled by numba; the derivation is in docs/explanation/renderer.md.

Each kernel works on a range of strokes or of bands of rows and writes to no memory that another
range writes to, so that any number of threads computes the same bits. The loops over a run of
pixels are split, and see nothing but slices, so that the compiler turns all but the look-ups in
the map into vector code. Reordering of sums is allowed, nothing else: NaN and infinity go through
as they must.
"""

import numpy as np
from numba import float32, int64, njit, types

from frida_painter.render.spans import spans_type

BAND = 8  # rows
LANES = 8  # samples are located so many at a time
_SUMS = {"reassoc", "contract", "nsz"}


@njit(nogil=True, cache=True)
def run(firsts, offsets, k):  # type: ignore[no-untyped-def]
    """Of segment k of `Spans`: its first column, where its packed pixels begin, and how many they are.

    Unsigned, so that no index made of them could count from an array's end: that would keep the
    compiler from vectorising. It takes two arrays and not the spans, of which every call would count the references to
    all five, twice: that takes longer than the pixels of a run.
    """
    start = offsets[k]
    return np.uint64(firsts[k]), np.uint64(start), np.uint64(offsets[k + 1] - start)


# fastmath is inherited from the caller unless it is refused by name.
@njit(nogil=True, cache=True, fastmath=False)
def _locate(place, columns, left, count, y, stride, cell, right_share, below_share):  # type: ignore[no-untyped-def]
    """For `count` columns on row y: the bordered map's cell at the upper left of each sample, and the shares beyond.

    Rounds as `reference.composite` does, operation by operation, so that both fall on the same side
    of every kink. Fills whole vectors; what lies beyond the count means nothing.
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
    """Copies the rows of a map [h, w] that its box touches into the middle of `bordered` [(h + 2) (w + 2)].

    The first and last column of it are zero for good; the rows around the box are made so.
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
    """Coverage of strokes begin to end - 1 at their packed pixels, to sampled[0, offset - base].

    To sampled[1] and sampled[2] goes by how much it rises from one map column and one map row to the next.
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
    """Lays strokes[0] to strokes[1] - 1 in order over bands begin to end - 1 of the picture [3, H, W]."""
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
    """Goes up and down through the strokes in bands begin to end - 1, with C the picture below each of them.

    Upwards only the scalar g . C is carried, never the colours. through [H, W] comes as ones and leaves as what
    reaches the canvas. slope (packed, or empty if not wanted) receives the gradient to the coverage, which is
    g . (c - C) times what the strokes above let through; to_color [bands, n, 3] comes as zeros and receives each
    band's part of the gradient to the colours.
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
def pull_to_strokes(begin, end, affine, boxes, columns, spans, sampled, slope, to_affine, to_map):  # type: ignore[no-untyped-def]
    """Gradients to the affine maps [n, 2, 3], which come as zeros, and to the maps [n, h, w] of those strokes.

    Either is left out where it has no strokes. sampled [3, packed]: as `sample` left it; slope (packed): the gradient
    to the coverage.
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


def argument_types():  # type: ignore[no-untyped-def]
    """The loops, each with the types of its arguments where a plan is made in float32; see compiled.py."""
    line, table, maps, boxes, spans = float32[::1], float32[:, ::1], float32[:, :, ::1], int64[:, ::1], spans_type()
    some, pair = (int64, int64), types.UniTuple(int64, 2)  # type: ignore[no-untyped-call]
    return (
        (sample, (*some, maps, maps, boxes, line, spans, int64, table)),
        (blend, (*some, pair, spans, int64, line, table, maps)),
        (pull_through, (*some, spans, line, table, maps, maps, table, line, maps)),
        (pull_to_strokes, (*some, maps, boxes, line, spans, table, line, maps, maps)),
    )
