"""The inner loops that lay strokes of uncertain coverage: mean and variance of every pixel, and their gradients.

Compiled by numba, in the manner of kernels.py: no range writes to memory that another range writes to. The
recurrences and their derivation are in docs/explanation/renderer.md. `share` and `full` are those of `CoverageSpread`.
"""

import numpy as np
from numba import float32, int64, njit, types

from frida_painter.render.kernels import BAND, run
from frida_painter.render.spans import spans_type

_SUMS = {"reassoc", "contract", "nsz"}


@njit(nogil=True, cache=True, fastmath=_SUMS)
def blend(begin, end, strokes, spans, base, alpha, color, spread, mean, variance):  # type: ignore[no-untyped-def]
    """Lays strokes[0] to strokes[1] - 1 in order over bands begin to end - 1 of mean [3, H, W] and variance [H, W]."""
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
def pull_through(  # type: ignore[no-untyped-def]
    begin, end, spans, alpha, color, spread, canvas, uncertain, to_mean, to_variance, slope, to_color
):  # fmt: skip
    """Goes up and down through the strokes in bands begin to end - 1, one band after another.

    Upwards, mean and variance under every stroke are found anew, of one band only, so that they stay in the cache.
    canvas [3, H, W], uncertain [H, W]: mean and variance of the canvas. to_mean [3, H, W], to_variance [H, W] come as
    the gradients to the moments of the whole and leave as those to the canvas's; slope (packed) receives the gradient
    to the coverage; to_color [bands, n, 3] comes as zeros and receives each band's part of the gradient to the colours.
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
        for row in range(rows):  # not by slices: numba compiles half of its strings to say that two do not fit
            for x in range(width):
                mean[0, row, x], mean[1, row, x] = canvas[0, top + row, x], canvas[1, top + row, x]
                mean[2, row, x], variance[row, x] = canvas[2, top + row, x], uncertain[top + row, x]
        at = np.uint64(0)
        for i in range(len(color)):
            red, green, blue = color[i, 0], color[i, 1], color[i, 2]
            for y in range(max(tops[i], top), min(bottoms[i], top + BAND)):
                left, start, count = run(firsts, offsets, segments[i] + y - tops[i])
                row = y - top
                # What lies below is kept as its distance from the paint.
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


def argument_types():  # type: ignore[no-untyped-def]
    """The loops, each with the types of its arguments where a plan is made in float32; see compiled.py."""
    line, table, maps, spans = float32[::1], float32[:, ::1], float32[:, :, ::1], spans_type()
    some, pair = (int64, int64), types.UniTuple(int64, 2)  # type: ignore[no-untyped-call]
    spread = types.UniTuple(float32, 2)  # type: ignore[no-untyped-call]
    return (
        (blend, (*some, pair, spans, int64, line, table, spread, maps, table)),
        (pull_through, (*some, spans, line, table, spread, maps, table, maps, table, line, maps)),
    )
