"""The inner loops of the scanline renderer, compiled by numba; the derivation is in docs/renderer.md.

Each kernel works on a range of strokes or of bands of rows and writes to no memory that another
range writes to, so that any number of threads computes the same bits. The loops over a run of
pixels are split so that the compiler turns all but the look-ups in the map into vector code.
Reordering of sums is allowed, nothing else: NaN and infinity go through as they must.
"""

import numpy as np
from numba import njit

BAND = 8  # rows
_SUMS = {"reassoc", "contract", "nsz"}


# fastmath is inherited from the caller unless it is refused by name.
@njit(nogil=True, cache=True, fastmath=False)
def _locate(place, columns, y, begin, count, stride, cell, right_share, below_share):  # type: ignore[no-untyped-def]
    """For a run of pixels: the bordered map's cell at the upper left of each sample, and the shares beyond it.

    Rounds as `reference.composite` does, operation by operation, so that both fall on the same side
    of every kink.
    """
    a, b, c = place[0, 0], place[0, 1], place[0, 2]
    d, e, f = place[1, 0], place[1, 1], place[1, 2]
    across, down = b * y, e * y
    for k in range(count):
        x = columns[begin + k]
        column, row = a * x + across + c, d * x + down + f
        left, above = np.floor(column), np.floor(row)
        right_share[k] = column - left
        below_share[k] = row - above
        cell[k] = (np.int32(above) + 1) * stride + np.int32(left) + 1


@njit(nogil=True, cache=True)
def _border(mark, bordered):  # type: ignore[no-untyped-def]
    """Copies a map [h, w] into the middle of `bordered` [(h + 2) (w + 2)], whose rim is zero."""
    h, w = mark.shape
    for i in range(h):
        for j in range(w):
            bordered[(i + 1) * (w + 2) + j + 1] = mark[i, j]


@njit(nogil=True, cache=True, fastmath=_SUMS)
def sample(begin, end, magnitude, affine, columns, spans, base, alpha):  # type: ignore[no-untyped-def]
    """Coverage of strokes begin to end - 1 at their packed pixels, to alpha[offset - base]."""
    _, h, w = magnitude.shape
    number = magnitude.dtype.type
    stride = w + 2
    bordered = np.zeros((h + 2) * stride, magnitude.dtype)
    cell = np.empty(len(columns), np.uint32)
    right_share, below_share = np.empty_like(columns), np.empty_like(columns)
    for i in range(begin, end):
        _border(magnitude[i], bordered)
        for y in range(spans.top[i], spans.bottom[i]):
            k = spans.segment[i] + y - spans.top[i]
            count = spans.offset[k + 1] - spans.offset[k]
            packed = spans.offset[k] - base
            _locate(affine[i], columns, number(y), spans.first[k], count, stride, cell, right_share, below_share)
            for p in range(count):
                at = cell[p]
                upper_left, upper_right = bordered[at], bordered[at + 1]
                lower_left, lower_right = bordered[at + stride], bordered[at + stride + 1]
                upper = upper_left + right_share[p] * (upper_right - upper_left)
                lower = lower_left + right_share[p] * (lower_right - lower_left)
                alpha[packed + p] = upper + below_share[p] * (lower - upper)


@njit(nogil=True, cache=True, fastmath=_SUMS)
def blend(begin, end, strokes, spans, base, alpha, color, picture):  # type: ignore[no-untyped-def]
    """Lays strokes[0] to strokes[1] - 1 in order over bands begin to end - 1 of the picture [3, H, W]."""
    height = picture.shape[1]
    for band in range(begin, end):
        for i in range(strokes[0], strokes[1]):
            for y in range(max(spans.top[i], band * BAND), min(spans.bottom[i], (band + 1) * BAND, height)):
                k = spans.segment[i] + y - spans.top[i]
                count = spans.offset[k + 1] - spans.offset[k]
                packed, left = spans.offset[k] - base, spans.first[k]
                for channel in range(3):
                    paint = color[i, channel]
                    line = picture[channel, y]
                    for p in range(count):
                        line[left + p] += alpha[packed + p] * (paint - line[left + p])


@njit(nogil=True, cache=True, fastmath=_SUMS)
def find_slopes(begin, end, spans, alpha, color, canvas, gradient, slope):  # type: ignore[no-untyped-def]
    """g . (c - C) at every packed pixel of bands begin to end - 1, where C is the picture below the stroke.

    Only the scalar g . C is carried upwards from stroke to stroke, never the colours.
    """
    _, height, width = canvas.shape
    below = np.empty((BAND, width), canvas.dtype)
    for band in range(begin, end):
        top = band * BAND
        for y in range(top, min(top + BAND, height)):
            for x in range(width):
                below[y - top, x] = (
                    gradient[0, y, x] * canvas[0, y, x]
                    + gradient[1, y, x] * canvas[1, y, x]
                    + gradient[2, y, x] * canvas[2, y, x]
                )
        for i in range(len(color)):
            red, green, blue = color[i, 0], color[i, 1], color[i, 2]
            for y in range(max(spans.top[i], top), min(spans.bottom[i], top + BAND)):
                k = spans.segment[i] + y - spans.top[i]
                packed, left = spans.offset[k], spans.first[k]
                under = below[y - top]
                for p in range(spans.offset[k + 1] - packed):
                    x = left + p
                    paint = red * gradient[0, y, x] + green * gradient[1, y, x] + blue * gradient[2, y, x]
                    slope[packed + p] = paint - under[x]
                    under[x] += alpha[packed + p] * (paint - under[x])


@njit(nogil=True, cache=True, fastmath=_SUMS)
def pull_through(begin, end, spans, alpha, gradient, through, slope, to_color):  # type: ignore[no-untyped-def]
    """Goes down through the strokes in bands begin to end - 1 with what those above let through.

    through [H, W] comes as ones and leaves as what reaches the canvas. slope [packed], empty if
    not wanted, is turned into the gradient to the coverage; to_color [bands, n, 3], empty if not
    wanted, receives each band's part of the gradient to the colours.
    """
    height, width = through.shape
    share = np.empty(width, through.dtype)
    for band in range(begin, end):
        for i in range(len(spans.top) - 1, -1, -1):
            for y in range(max(spans.top[i], band * BAND), min(spans.bottom[i], (band + 1) * BAND, height)):
                k = spans.segment[i] + y - spans.top[i]
                packed, left = spans.offset[k], spans.first[k]
                count = spans.offset[k + 1] - packed
                seen = through[y]
                if len(slope) > 0:
                    for p in range(count):
                        slope[packed + p] *= seen[left + p]
                for p in range(count):
                    share[p] = seen[left + p] * alpha[packed + p]
                    seen[left + p] -= share[p]
                if len(to_color) > 0:
                    red = green = blue = through.dtype.type(0)
                    for p in range(count):
                        red += gradient[0, y, left + p] * share[p]
                        green += gradient[1, y, left + p] * share[p]
                        blue += gradient[2, y, left + p] * share[p]
                    to_color[band, i, 0] += red
                    to_color[band, i, 1] += green
                    to_color[band, i, 2] += blue


@njit(nogil=True, cache=True, fastmath=_SUMS)
def pull_to_affine(begin, end, magnitude, affine, columns, spans, slope, to_affine):  # type: ignore[no-untyped-def]
    """Gradient to the affine maps [n, 2, 3] of strokes begin to end - 1."""
    _, h, w = magnitude.shape
    number = magnitude.dtype.type
    stride = w + 2
    bordered = np.zeros((h + 2) * stride, magnitude.dtype)
    cell = np.empty(len(columns), np.uint32)
    right_share, below_share = np.empty_like(columns), np.empty_like(columns)
    by_column, by_row = np.empty_like(columns), np.empty_like(columns)
    for i in range(begin, end):
        _border(magnitude[i], bordered)
        for y in range(spans.top[i], spans.bottom[i]):
            k = spans.segment[i] + y - spans.top[i]
            packed, left = spans.offset[k], spans.first[k]
            count = spans.offset[k + 1] - packed
            _locate(affine[i], columns, number(y), left, count, stride, cell, right_share, below_share)
            for p in range(count):
                at = cell[p]
                upper_left, upper_right = bordered[at], bordered[at + 1]
                lower_left, lower_right = bordered[at + stride], bordered[at + stride + 1]
                upper, lower = upper_right - upper_left, lower_right - lower_left
                by_column[p] = slope[packed + p] * (upper + below_share[p] * (lower - upper))
                by_row[p] = slope[packed + p] * (lower_left - upper_left + right_share[p] * (lower - upper))
            column_sum = column_x = row_sum = row_x = number(0)
            for p in range(count):
                column_sum += by_column[p]
                column_x += by_column[p] * columns[left + p]
                row_sum += by_row[p]
                row_x += by_row[p] * columns[left + p]
            to_affine[i, 0, 0] += column_x
            to_affine[i, 0, 1] += column_sum * number(y)
            to_affine[i, 0, 2] += column_sum
            to_affine[i, 1, 0] += row_x
            to_affine[i, 1, 1] += row_sum * number(y)
            to_affine[i, 1, 2] += row_sum


@njit(nogil=True, cache=True, fastmath=_SUMS)
def pull_to_map(begin, end, affine, columns, spans, slope, to_map):  # type: ignore[no-untyped-def]
    """Gradient to the maps [n, h, w] of strokes begin to end - 1.

    Each sample adds four numbers to its own upper-left cell only: the gradient, and that times its
    share to the right, below, and both. The weights of the four cells around follow from their
    sums, once per cell instead of once per sample.
    """
    _, h, w = to_map.shape
    number = to_map.dtype.type
    stride = w + 2
    cell = np.empty(len(columns), np.uint32)
    right_share, below_share = np.empty_like(columns), np.empty_like(columns)
    moments = np.empty(((h + 2) * stride, 4), to_map.dtype)
    for i in range(begin, end):
        moments[:] = number(0)
        for y in range(spans.top[i], spans.bottom[i]):
            k = spans.segment[i] + y - spans.top[i]
            packed = spans.offset[k]
            count = spans.offset[k + 1] - packed
            _locate(affine[i], columns, number(y), spans.first[k], count, stride, cell, right_share, below_share)
            for p in range(count):
                at = cell[p]
                whole = slope[packed + p]
                below = whole * below_share[p]
                moments[at, 0] += whole
                moments[at, 1] += whole * right_share[p]
                moments[at, 2] += below
                moments[at, 3] += below * right_share[p]
        for row in range(h):
            for column in range(w):
                at = (row + 1) * stride + column + 1
                before, over = at - 1, at - stride
                to_map[i, row, column] = (
                    (moments[at, 0] - moments[at, 1] - moments[at, 2] + moments[at, 3])
                    + (moments[before, 1] - moments[before, 3])
                    + (moments[over, 2] - moments[over, 3])
                    + moments[over - 1, 3]
                )
