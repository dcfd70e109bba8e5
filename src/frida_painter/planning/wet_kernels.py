"""Compiled loops (numba) of wet paint on wet paint, without slopes; tests/planning/test_wet_paint.py has a plain twin.

The pixels of all marks are packed, mark after mark: mark i has
the pixels from begin[i] to begin[i + 1].
"""

import math

import numpy as np
from numba import float32, float64, int8, int32, int64, njit, types

from frida_painter.render.kernels import spans_type


@njit(cache=True)
def cover(magnitude, affine, path, spans, columns, seen, begin, pixel, alpha, nearest):  # type: ignore[no-untyped-def]
    """Packs the pixels of marks with a coverage above `seen`.

    magnitude [n, h, w], affine [n, 2, 3]: marks
    path [n, p, 2]: pixels of places along each path
    spans: pixels that surely hold each mark
    begin [n + 1], pixel, alpha and nearest [number of pixels in the spans]: results
    """
    n, height, width = magnitude.shape
    count = 0
    for i in range(n):
        begin[i] = count
        a, b, c = affine[i, 0]
        d, e, f = affine[i, 1]
        for row in range(spans.top[i], spans.bottom[i]):
            k = spans.segment[i] + row - spans.top[i]
            first, length = spans.first[k], spans.offset[k + 1] - spans.offset[k]
            for column in range(first, first + length):
                x, y = a * column + b * row + c, d * column + e * row + f
                left, above = math.floor(x), math.floor(y)
                right_share, below_share = x - left, y - above
                found = x * 0
                for corner in range(4):
                    p, q = int(left) + (corner & 1), int(above) + (corner >> 1)
                    if 0 <= p < width and 0 <= q < height:
                        share = (right_share if corner & 1 else 1 - right_share) * (
                            below_share if corner >> 1 else 1 - below_share
                        )
                        found += share * magnitude[i, q, p]
                if found > seen:
                    best, least = 0, np.inf
                    for place in range(path.shape[1]):
                        far = (path[i, place, 0] - column) ** 2 + (path[i, place, 1] - row) ** 2
                        if far < least:
                            best, least = place, far
                    pixel[count], alpha[count], nearest[count] = row * columns + column, found, best
                    count += 1
    begin[n] = count


@njit(cache=True, error_model="numpy")
def lay(begin, pixel, alpha, nearest, steps, own, painted_at, seen, wet, trace, change, amount, pigment, settled):  # type: ignore[no-untyped-def]
    """Lays packed marks in painting order.

    steps [n, p]: metres to each place of a path from the place before
    own [n, 6]: K and S of the paints
    painted_at [n]: seconds
    seen: number of first marks that the picture shows already
    wet: rate per metre, share, and seconds of drying
    trace: amount of paint that counts as none
    change [P, 3], amount [P], pigment [P, 6], settled [P]: the canvas; the result is in `change`
    """
    rate, share, drying = wet
    places = steps.shape[1]
    there, amounts = np.empty(places, alpha.dtype), np.empty(places, alpha.dtype)
    paint, held = np.empty((places, 6), alpha.dtype), np.empty((places, 6), alpha.dtype)
    mixed, clean = np.empty(6, alpha.dtype), np.empty(3, alpha.dtype)
    for i in range(len(steps)):
        there[:], amounts[:], paint[:] = 1e-6, 0, 0
        wets = False
        for k in range(begin[i], begin[i + 1]):
            at, place = pixel[k], nearest[k]
            below = max(amount[at] - (painted_at[i] - settled[at]) / drying, 0.0)
            amount[at], settled[at] = below, painted_at[i]
            there[place] += alpha[k]
            if below > 0:
                wets = True
                amounts[place] += alpha[k] * below
                for band in range(6):
                    paint[place, band] += alpha[k] * below * pigment[at, band]
        for band in range(6):
            mixed[band] = own[i, band]
        for place in range(places if wets else 0):
            found = amounts[place] / there[place]
            taken = -math.expm1(-rate * steps[i, place] * found)
            for band in range(6):
                lifted = paint[place, band] / there[place] / max(found, trace)
                mixed[band] += taken * (lifted - mixed[band])
                held[place, band] = mixed[band]
        for band in range(3):
            clean[band] = _shown(own[i, band] / own[i, band + 3])
        for k in range(begin[i], begin[i + 1]):
            at, place, covers = pixel[k], nearest[k], alpha[k]
            below = amount[at]
            for band in range(6):
                brush = held[place, band] if wets else own[i, band]
                mixed[band] = brush + share * below * (pigment[at, band] - brush)
            kept = below * (1 - covers)
            total = kept + covers
            for band in range(3 if i >= seen else 0):
                off = _shown(mixed[band] / mixed[band + 3]) - clean[band] if wets else change.dtype.type(0)
                change[at, band] += covers * (off - change[at, band])
            for band in range(6):
                pigment[at, band] = (pigment[at, band] * kept + mixed[band] * covers) / total
            amount[at] = min(total, 1.0)


@njit(cache=True)
def _shown(ratio):  # type: ignore[no-untyped-def]
    """Returns the sRGB of a thick film with this K / S."""
    linear = 1 + ratio - math.sqrt(ratio * ratio + 2 * ratio)
    if linear <= 0.0031308:
        return linear * 12.92
    return 1.055 * linear ** (1 / 2.4) - 0.055


def argument_types():  # type: ignore[no-untyped-def]
    """Returns each loop with its argument types for plans in float32; see compiled.py."""
    maps, index = float32[:, :, ::1], int64[::1]
    packed = (index, int32[::1], float32[::1], int8[::1])
    numbers = types.UniTuple(float64, 3)  # type: ignore[no-untyped-call]
    flat, wide = float32[::1], float32[:, ::1]
    return (
        (cover, (maps, maps, maps, spans_type(), int64, float64, *packed)),
        (lay, (*packed, wide, wide, float64[::1], int64, numbers, float64, wide, flat, wide, float64[::1])),
    )
