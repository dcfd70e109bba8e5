"""The inner loops that lay strokes of uncertain coverage: mean and variance of every pixel, and their gradients.

Compiled by numba, in the manner of kernels.py: no range writes to memory that another range writes to. The
recurrences and their derivation are in docs/renderer.md. `share` and `full` are those of `CoverageSpread`.
"""

import numpy as np
from numba import njit

from frida_painter.render.kernels import BAND, run

_SUMS = {"reassoc", "contract", "nsz"}


@njit(nogil=True, cache=True, fastmath=_SUMS)
def blend(begin, end, strokes, spans, base, alpha, color, spread, mean, variance):  # type: ignore[no-untyped-def]
    """Lays strokes[0] to strokes[1] - 1 in order over bands begin to end - 1 of mean and variance [3, H, W]."""
    share, full = spread
    one, none = mean.dtype.type(1), mean.dtype.type(0)
    for band in range(begin, end):
        for i in range(strokes[0], strokes[1]):
            for y in range(max(spans.top[i], band * BAND), min(spans.bottom[i], (band + 1) * BAND)):
                left, start, count = run(spans, i, y)
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
def pull_through(  # type: ignore[no-untyped-def]
    begin, end, spans, alpha, color, spread, canvas, uncertain, to_mean, to_variance, slope, to_color
):  # fmt: skip
    """Goes up and down through the strokes in bands begin to end - 1, one band after another.

    Upwards, mean and variance under every stroke are found anew, of one band only, so that they stay in the cache.
    canvas, uncertain [3, H, W]: mean and variance of the canvas. to_mean, to_variance [3, H, W] come as the gradients
    to the moments of the whole and leave as those to the canvas's; slope (packed) receives the gradient to the
    coverage; to_color [bands, n, 3] comes as zeros and receives each band's part of the gradient to the colours.
    """
    _, height, width = canvas.shape
    share, full = spread
    number = to_mean.dtype.type
    one, two, none = number(1), number(2), number(0)
    mean, variance = np.empty((3, BAND, width), canvas.dtype), np.empty((3, BAND, width), canvas.dtype)
    below = np.empty((6, 0), canvas.dtype)
    for band in range(begin, end):
        top = band * BAND
        rows = min(BAND, height - top)
        pixels = np.int64(0)
        for i in range(len(color)):
            for y in range(max(spans.top[i], top), min(spans.bottom[i], top + BAND)):
                pixels += np.int64(run(spans, i, y)[2])
        if pixels > below.shape[1]:
            below = np.empty((6, pixels), canvas.dtype)
        mean[:, :rows] = canvas[:, top : top + rows]
        variance[:, :rows] = uncertain[:, top : top + rows]
        at = np.uint64(0)
        for i in range(len(color)):
            for y in range(max(spans.top[i], top), min(spans.bottom[i], top + BAND)):
                left, start, count = run(spans, i, y)
                for channel in range(3):
                    paint = color[i, channel]
                    for p in range(count):
                        cover, x = alpha[start + p], left + p
                        old, varied = mean[channel, y - top, x], variance[channel, y - top, x]
                        below[channel, at + p], below[channel + 3, at + p] = old, varied
                        away = old - paint
                        doubt, keeps = share * cover * max(full - cover, none), one - cover
                        variance[channel, y - top, x] = (keeps * keeps + doubt) * varied + doubt * away * away
                        mean[channel, y - top, x] = old - cover * away
                at += count
        for i in range(len(color) - 1, -1, -1):
            for y in range(min(spans.bottom[i], top + BAND) - 1, max(spans.top[i], top) - 1, -1):
                left, start, count = run(spans, i, y)
                at -= count
                for p in range(count):
                    slope[start + p] = none
                for channel in range(3):
                    paint = color[i, channel]
                    pulled = none
                    for p in range(count):
                        cover, x = alpha[start + p], left + p
                        from_mean, from_variance = to_mean[channel, y, x], to_variance[channel, y, x]
                        away, varied = below[channel, at + p] - paint, below[channel + 3, at + p]
                        bare, keeps = max(full - cover, none), one - cover
                        doubt = share * cover * bare
                        rising = share * (bare - cover) if bare > none else none
                        slope[start + p] += (
                            from_variance * (rising * (varied + away * away) - two * keeps * varied) - from_mean * away
                        )
                        crossed = two * doubt * away * from_variance
                        pulled += cover * from_mean - crossed
                        to_mean[channel, y, x] = keeps * from_mean + crossed
                        to_variance[channel, y, x] = (keeps * keeps + doubt) * from_variance
                    to_color[band, i, channel] += pulled
