"""The inner loops that lay strokes of uncertain coverage: mean and variance of every pixel, and their gradients.

Compiled by numba, in the manner of kernels.py: no range writes to memory that another range writes to. The
recurrences and their derivation are in docs/renderer.md. `share` and `full` are those of `CoverageSpread`.
"""

import numpy as np
from numba import njit

from frida_painter.render.kernels import BAND, run

_SUMS = {"reassoc", "contract", "nsz"}


@njit(nogil=True, cache=True, fastmath=_SUMS)
def blend(begin, end, strokes, marks, base, alpha, color, spread, mean, variance):  # type: ignore[no-untyped-def]
    """Lays strokes[0] to strokes[1] - 1 in order over bands begin to end - 1 of mean and variance [3, H, W]."""
    share, full = spread
    one, none = mean.dtype.type(1), mean.dtype.type(0)
    for band in range(begin, end):
        for i in range(strokes[0], strokes[1]):
            for y in range(max(marks.top[i], band * BAND), min(marks.bottom[i], (band + 1) * BAND)):
                left, start, count = run(marks, i, y)
                packed = start - np.uint64(base)
                for channel in range(3):
                    paint = color[i, channel]
                    for p in range(count):
                        cover, x = alpha[packed + p], left + p
                        away = mean[channel, y, x] - paint
                        doubt, keeps = share * cover * max(full - cover, none), one - cover
                        kept = (keeps * keeps + doubt) * variance[channel, y, x]
                        variance[channel, y, x] = kept + doubt * away * away
                        mean[channel, y, x] -= cover * away


@njit(nogil=True, cache=True, fastmath=_SUMS)
def climb(begin, end, marks, alpha, reach, color, spread, canvas, below):  # type: ignore[no-untyped-def]
    """Mean and variance under each stroke, to below [6, packed pixels of `reach`], in bands begin to end - 1."""
    _, height, width = canvas.shape
    share, full = spread
    one, none = canvas.dtype.type(1), canvas.dtype.type(0)
    mean = np.empty((3, BAND, width), canvas.dtype)
    variance = np.empty((3, BAND, width), canvas.dtype)
    for band in range(begin, end):
        top = band * BAND
        rows = min(BAND, height - top)
        variance[:] = none
        mean[:, :rows] = canvas[:, top : top + rows]
        for i in range(len(color)):
            for y in range(max(reach.top[i], top), min(reach.bottom[i], top + BAND)):
                left, start, count = run(reach, i, y)
                for channel in range(3):
                    for p in range(count):
                        below[channel, start + p] = mean[channel, y - top, left + p]
                        below[channel + 3, start + p] = variance[channel, y - top, left + p]
                left, start, count = run(marks, i, y)
                for channel in range(3):
                    paint = color[i, channel]
                    for p in range(count):
                        cover, x = alpha[start + p], left + p
                        away = mean[channel, y - top, x] - paint
                        doubt, keeps = share * cover * max(full - cover, none), one - cover
                        kept = (keeps * keeps + doubt) * variance[channel, y - top, x]
                        variance[channel, y - top, x] = kept + doubt * away * away
                        mean[channel, y - top, x] -= cover * away


@njit(nogil=True, cache=True, fastmath=_SUMS)
def descend(begin, end, marks, alpha, reach, color, spread, below, to_mean, to_variance, slope, to_color):  # type: ignore[no-untyped-def]
    """Goes down through the strokes in bands begin to end - 1.

    to_mean, to_variance [3, H, W] come as the gradients to the moments of the whole and leave as those to the
    canvas; slope (packed as `reach`) receives the gradient to the coverage; to_color [bands, n, 3] comes as
    zeros and receives each band's part of the gradient to the colours.
    """
    share, full = spread
    number = to_mean.dtype.type
    one, two, none = number(1), number(2), number(0)
    width = to_mean.shape[2]
    covers, rises = np.empty(width, to_mean.dtype), np.empty(width, to_mean.dtype)
    for band in range(begin, end):
        for i in range(len(reach.top) - 1, -1, -1):
            for y in range(max(reach.top[i], band * BAND), min(reach.bottom[i], (band + 1) * BAND)):
                left, start, count = run(reach, i, y)
                inner, packed, inked = run(marks, i, y)
                for p in range(count):
                    covers[p] = none
                    rises[p] = none
                shift = inner - left if inked > 0 else np.uint64(0)
                for p in range(inked):
                    covers[shift + p] = alpha[packed + p]
                for channel in range(3):
                    paint = color[i, channel]
                    pulled = none
                    for p in range(count):
                        cover, x = covers[p], left + p
                        from_mean, from_variance = to_mean[channel, y, x], to_variance[channel, y, x]
                        away, varied = below[channel, start + p] - paint, below[channel + 3, start + p]
                        bare, keeps = max(full - cover, none), one - cover
                        doubt = share * cover * bare
                        rising = share * (bare - cover) if bare > none else none
                        rises[p] += (
                            from_variance * (rising * (varied + away * away) - two * keeps * varied) - from_mean * away
                        )
                        crossed = two * doubt * away * from_variance
                        pulled += cover * from_mean - crossed
                        to_mean[channel, y, x] = keeps * from_mean + crossed
                        to_variance[channel, y, x] = (keeps * keeps + doubt) * from_variance
                    to_color[band, i, channel] += pulled
                if len(slope) > 0:
                    for p in range(count):
                        slope[start + p] = rises[p]
