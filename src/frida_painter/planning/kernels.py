"""Compiled loops (numba) of the planner on the CPU: variables to strokes, and wet paint on wet paint.

variables.py has PyTorch versions of the first with equal results; tests/planning/test_wet_paint.py has a plain twin of
the second, which knows no slopes.
"""

import math

import numpy as np
from numba import njit

# Variables of the optimiser. The numbers of a stroke are its middle x and y, angle, length, bend and thickness, each in
# its unit from variables.py.


@njit(cache=True)
def start_of(numbers, unit):  # type: ignore[no-untyped-def]
    """Returns the start of a stroke with these numbers [6], and the cosine and sine of its angle."""
    half = unit.dtype.type(0.5)
    angle, length, bend = numbers[2] * unit[2], half * numbers[3] * unit[3], half * numbers[4] * unit[4]
    cos, sin = math.cos(angle), math.sin(angle)
    x = numbers[0] * unit[0] - cos * length + sin * bend
    return x, numbers[1] * unit[1] - sin * length - cos * bend, cos, sin


@njit(cache=True)
def to_strokes(shape, unit, order, position, angle, length, bend, thickness):  # type: ignore[no-untyped-def]
    """Writes the strokes of shape [n, 6], in the given order [n], into the output arrays."""
    for i in range(len(order)):
        numbers = shape[order[i]]
        position[i, 0], position[i, 1], _, _ = start_of(numbers, unit)
        angle[i], length[i], bend[i] = numbers[2] * unit[2], numbers[3] * unit[3], numbers[4] * unit[4]
        thickness[i] = numbers[5] * unit[5]


@njit(cache=True)
def pull_to_shape(shape, unit, order, position, angle, length, bend, thickness, to_shape):  # type: ignore[no-untyped-def]
    """Turns gradients with respect to the ordered strokes into gradients with respect to their shape [n, 6]."""
    half = unit.dtype.type(0.5)
    for i in range(len(order)):
        numbers, to = shape[order[i]], to_shape[order[i]]
        _, _, cos, sin = start_of(numbers, unit)
        along, aside = half * numbers[3] * unit[3], half * numbers[4] * unit[4]
        x, y = position[i, 0], position[i, 1]
        to[0], to[1] = x * unit[0], y * unit[1]
        turned = x * (sin * along + cos * aside) + y * (sin * aside - cos * along)
        to[2] = (angle[i] + turned) * unit[2]
        to[3] = (length[i] - half * (cos * x + sin * y)) * unit[3]
        to[4] = (bend[i] + half * (sin * x - cos * y)) * unit[4]
        to[5] = thickness[i] * unit[5]


@njit(cache=True)
def bring_inside(shape, unit, length, bend, width, height):  # type: ignore[no-untyped-def]
    """Projects shape [n, 6] in place like `Strokes.project`.

    length, bend: (least, most) in metres, in the precision of the other arguments.
    """
    none, half, one = unit.dtype.type(0), unit.dtype.type(0.5), unit.dtype.type(1)
    for i in range(len(shape)):
        numbers = shape[i]
        x, y, cos, sin = start_of(numbers, unit)
        along = _between(numbers[3] * unit[3], length[0], length[1])
        aside = _between(numbers[4] * unit[4], bend[0], bend[1])
        x += _way_back(x, cos * along, -sin * aside, width)
        y += _way_back(y, sin * along, cos * aside, height)
        numbers[0] = (x + half * (cos * along - sin * aside)) / unit[0]
        numbers[1] = (y + half * (sin * along + cos * aside)) / unit[1]
        numbers[3], numbers[4] = along / unit[3], aside / unit[4]
        numbers[5] = _between(numbers[5] * unit[5], none, one) / unit[5]


@njit(cache=True, error_model="numpy")
def step(leaf, slope, mean, square, first, second, length, spread, epsilon):  # type: ignore[no-untyped-def]
    """Makes one Adam step for numbers [n] in place; `Adam.step` in optimize.py has an equal PyTorch version."""
    one = leaf.dtype.type(1)
    for i in range(len(leaf)):
        mean[i] += (one - first) * (slope[i] - mean[i])
        square[i] = second * square[i] + (one - second) * slope[i] * slope[i]
        leaf[i] -= length * mean[i] / (np.sqrt(square[i]) / spread + epsilon)


@njit(cache=True)
def _between(value, least, most):  # type: ignore[no-untyped-def]
    """Returns the value clamped to the range; NaN stays NaN."""
    return least if value < least else most if value > most else value


@njit(cache=True)
def _way_back(start, along, aside, most):  # type: ignore[no-untyped-def]
    """Returns the shift that brings the path start + along t + 3 aside t (1 - t), t in [0, 1], between 0 and most."""
    number = type(most)
    lowest, highest = min(start, start + along), max(start, start + along)
    if abs(number(3) * aside) >= number(1e-12):
        turn = _between(number(0.5) + along / (number(6) * aside), number(0), number(1))
        there = start + turn * along + number(3) * turn * (number(1) - turn) * aside
        lowest, highest = min(lowest, there), max(highest, there)
    return max(-lowest, number(0)) - max(highest - most, number(0))


# Wet paint. The pixels of all marks are packed, mark after mark: mark i has the pixels from begin[i] to begin[i + 1].


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
