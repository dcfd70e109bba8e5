"""Inner loops of a stroke table for the CPU in float32, compiled by numba; `StrokeTable.plainly` computes the same.

Loops over cells use only slices and have no branches, so that the compiler can vectorise them. Sums may be
reordered, but NaN keeps its meaning.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[Any]

_SUMS = {"reassoc", "contract", "nsz"}
_NONE, _ONE = np.float32(0), np.float32(1)
_LOG2_E, _LN_2 = np.float32(1.4426950408889634), np.float32(0.6931471805599453)
_LARGEST = np.float32(80)  # its exponential is finite
# 1 / k!, k = 2 ... 6: the exponential series, to 2e-7 for |x| <= ln 2 / 2
_C2, _C3, _C4, _C5, _C6 = (np.float32(1 / k) for k in (2, 6, 24, 120, 720))


class TableArrays(NamedTuple):
    """Buffers of a `StrokeTable`, see there, and the overshoot of the squash."""

    coefficients: Array
    basis: Array
    mean: Array
    counts: Array
    part_of: Array
    first_of: Array
    corners: Array
    inside: Array
    beyond: np.float32


@njit(cache=True)
def part_by_part(place, spans, table):  # type: ignore[no-untyped-def]
    """Returns the indices [n] of strokes at coordinates [3, n], grouped by part, and their parts [n].

    Also returns the end of each part in this order, [parts + 1]. It counts instead of sorting, because numba
    needs a second to compile a sort.
    """
    n = place.shape[1]
    part, ends = np.zeros(n, np.int64), np.zeros(len(table.counts) + 1, np.int64)
    for axis in range(3):
        for i in range(n):
            span = np.int64(place[axis, i] * np.float32(spans[axis]))
            part[i] += table.part_of[axis, min(max(span, 0), spans[axis] - 1)]
    for i in range(n):
        ends[part[i] + 1] += 1
    for k in range(len(table.counts)):
        ends[k + 1] += ends[k]
    order, parts = np.empty(n, np.int64), np.empty(n, np.int64)
    for i in range(n):  # until here, each entry is the start of its part
        at = ends[part[i]]
        ends[part[i]] += 1
        order[at], parts[at] = i, part[i]
    return order, parts, ends


@njit(cache=True, fastmath=_SUMS, error_model="numpy")
def look_up(place, spans, table, maps, shift):  # type: ignore[no-untyped-def]
    """Writes magnitudes of n strokes at coordinates [3, n] in [0, 1] to windows [n, rows x columns].

    shift [n, 2, 3]: zeros at first; receives the shifts of `StrokeTable.windows`
    Four strokes of a part are computed together, because reading the basis takes longer than computing.
    """
    rank, most = table.basis.shape[1:]
    weight, slope = np.empty((3, 4), np.float32), np.empty((3, 4), np.float32)
    first = np.empty(3, np.int64)
    coordinates, logits = np.empty((4, rank), np.float32), np.empty((4, most), np.float32)
    bits = np.empty(most, np.int32)
    order, parts, ends = part_by_part(place, spans, table)
    begin = 0
    while begin < len(order):
        part = parts[begin]
        four = order[begin : min(begin + 4, ends[part])]
        count, cells = table.counts[part], table.inside[part]
        for j in range(4):  # if there are fewer, the last one is repeated
            _weigh(place[:, four[min(j, len(four) - 1)]], spans, table, first, weight, slope)
            _sum_up(table.coefficients[part], first, weight, coordinates[j])
            line, mean = logits[j], table.mean[part]
            for k in range(count):
                line[k] = mean[k]
        _add_up(coordinates, table.basis[part], count, logits[0], logits[1], logits[2], logits[3])
        for j in range(len(four)):
            line, mark = logits[j, :count], maps[four[j]]
            shift[four[j], 0, 2], shift[four[j], 1, 2] = table.corners[part, 0], table.corners[part, 1]
            for k in range(len(mark)):
                mark[k] = _NONE
            _squash(line, bits[:count], table.beyond)
            for k in range(count):
                mark[cells[k]] = line[k]
        begin += len(four)


@njit(cache=True, fastmath=_SUMS)
def _add_up(coordinates, basis, count, one, two, three, four):  # type: ignore[no-untyped-def]
    """Adds the maps of a basis [rank, most], weighted by coordinates [4, rank], to four lines of logits."""
    for r in range(0, len(basis), 4):
        a, b, c, d = basis[r], basis[r + 1], basis[r + 2], basis[r + 3]
        share = coordinates[:, r : r + 4]
        a1, b1, c1, d1 = share[0, 0], share[0, 1], share[0, 2], share[0, 3]
        a2, b2, c2, d2 = share[1, 0], share[1, 1], share[1, 2], share[1, 3]
        a3, b3, c3, d3 = share[2, 0], share[2, 1], share[2, 2], share[2, 3]
        a4, b4, c4, d4 = share[3, 0], share[3, 1], share[3, 2], share[3, 3]
        for k in range(count):
            one[k] += (a1 * a[k] + b1 * b[k]) + (c1 * c[k] + d1 * d[k])
            two[k] += (a2 * a[k] + b2 * b[k]) + (c2 * c[k] + d2 * d[k])
            three[k] += (a3 * a[k] + b3 * b[k]) + (c3 * c[k] + d3 * d[k])
            four[k] += (a4 * a[k] + b4 * b[k]) + (c4 * c[k] + d4 * d[k])


@njit(cache=True, fastmath=_SUMS)
def pull_back(place, spans, table, maps, upstream, to_place):  # type: ignore[no-untyped-def]
    """Computes gradients of coordinates [3, n] from those of the windows; four strokes together.

    maps, upstream [n, rows x columns]: windows and their gradients
    """
    rank, most = table.basis.shape[1:]
    weight, slope = np.empty((3, 4), np.float32), np.empty((3, 4), np.float32)
    first = np.empty(3, np.int64)
    pull, magnitude = np.zeros((4, most), np.float32), np.empty(most, np.float32)
    upon = np.empty((4, rank), np.float32)
    rim = table.beyond * (_ONE + table.beyond)
    scale = _ONE / (_ONE + np.float32(2) * table.beyond)
    order, parts, ends = part_by_part(place, spans, table)
    begin = 0
    while begin < len(order):
        part = parts[begin]
        four = order[begin : min(begin + 4, ends[part])]
        count, cells, along = table.counts[part], table.inside[part], table.coefficients[part]
        for j in range(len(four)):
            mark, above, line = maps[four[j]], upstream[four[j]], pull[j]
            for k in range(count):
                magnitude[k] = mark[cells[k]]
                line[k] = above[cells[k]]
            for k in range(count):
                inside = magnitude[k] - magnitude[k] * magnitude[k]
                line[k] *= (inside + rim) * scale if inside > np.float32(0) else np.float32(0)
        _dot(pull[0], pull[1], pull[2], pull[3], table.basis[part], count, upon)
        for j in range(len(four)):
            i = four[j]
            _weigh(place[:, i], spans, table, first, weight, slope)
            x = y = z = np.float32(0)
            for p in range(4):
                for q in range(4):
                    for s in range(4):
                        row = along[first[0] + p, first[1] + q, first[2] + s]
                        dot = np.float32(0)
                        for r in range(rank):
                            dot += row[r] * upon[j, r]
                        x += slope[0, p] * weight[1, q] * weight[2, s] * dot
                        y += weight[0, p] * slope[1, q] * weight[2, s] * dot
                        z += weight[0, p] * weight[1, q] * slope[2, s] * dot
            to_place[0, i], to_place[1, i], to_place[2, i] = x, y, z
        begin += len(four)


@njit(cache=True, fastmath=_SUMS)
def _dot(one, two, three, four, basis, count, upon):  # type: ignore[no-untyped-def]
    """Writes the products of four lines with the maps of a basis [rank, most] to upon [4, rank]; two maps at a time."""
    for r in range(0, len(basis), 2):
        a, b = basis[r], basis[r + 1]
        a1 = a2 = a3 = a4 = b1 = b2 = b3 = b4 = np.float32(0)
        for k in range(count):
            a1 += one[k] * a[k]
            a2 += two[k] * a[k]
            a3 += three[k] * a[k]
            a4 += four[k] * a[k]
            b1 += one[k] * b[k]
            b2 += two[k] * b[k]
            b3 += three[k] * b[k]
            b4 += four[k] * b[k]
        upon[0, r], upon[1, r], upon[2, r], upon[3, r] = a1, a2, a3, a4
        upon[0, r + 1], upon[1, r + 1], upon[2, r + 1], upon[3, r + 1] = b1, b2, b3, b4


@njit(cache=True, fastmath=_SUMS)
def _weigh(place, spans, table, first, weight, slope):  # type: ignore[no-untyped-def]
    """Writes, for each axis, the first of four knots inside the part, their weights and the derivatives of these."""
    for axis in range(3):
        at = place[axis] * np.float32(spans[axis])
        span = min(max(np.int64(np.floor(at)), 0), spans[axis] - 1)
        t = at - np.float32(span)
        s = _ONE - t
        six, half = np.float32(1 / 6), np.float32(0.5) * np.float32(spans[axis])
        weight[axis, 0] = s * s * s * six
        weight[axis, 1] = (np.float32(4) - np.float32(6) * t * t + np.float32(3) * t * t * t) * six
        weight[axis, 2] = (np.float32(4) - np.float32(6) * s * s + np.float32(3) * s * s * s) * six
        weight[axis, 3] = t * t * t * six
        slope[axis, 0] = -s * s * half
        slope[axis, 1] = (np.float32(3) * t * t - np.float32(4) * t) * half
        slope[axis, 2] = (np.float32(4) * s - np.float32(3) * s * s) * half
        slope[axis, 3] = t * t * half
        first[axis] = table.first_of[axis, span]


@njit(cache=True, fastmath=_SUMS)
def _sum_up(coefficients, first, weight, coordinates):  # type: ignore[no-untyped-def]
    for r in range(len(coordinates)):
        coordinates[r] = _NONE
    for p in range(4):
        for q in range(4):
            for s in range(4):
                share = weight[0, p] * weight[1, q] * weight[2, s]
                row = coefficients[first[0] + p, first[1] + q, first[2] + s]
                for r in range(len(coordinates)):
                    coordinates[r] += share * row[r]


@njit(cache=True, fastmath=_SUMS, error_model="numpy")  # checks for zeros prevent vectorisation
def _squash(line, bits, beyond):  # type: ignore[no-untyped-def]
    """Computes `squash` in place; e^-x is 2^n times a polynomial, and 2^n is written as bits."""
    for k in range(len(line)):
        x = -line[k]
        x = _LARGEST if x > _LARGEST else x
        x = -_LARGEST if x < -_LARGEST else x
        n = np.floor(x * _LOG2_E + np.float32(0.5))
        r = x - n * _LN_2
        line[k] = _ONE + r * (_ONE + r * (_C2 + r * (_C3 + r * (_C4 + r * (_C5 + r * _C6)))))
        bits[k] = (np.int32(n) + 127) << 23
    power = bits.view(np.float32)
    stretch = _ONE + np.float32(2) * beyond
    for k in range(len(line)):
        m = stretch / (_ONE + line[k] * power[k]) - beyond
        m = np.float32(0) if m < np.float32(0) else m
        line[k] = _ONE if m > _ONE else m
