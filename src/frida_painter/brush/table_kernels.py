"""The inner loops of a stroke table on the CPU in float32, compiled by numba. `StrokeTable.plainly` is their twin.

Loops over cells see nothing but slices and have no branches, so that the compiler turns them into vector code.
Reordering of sums is allowed, nothing else: NaN goes through as it must.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[Any]

_SUMS = {"reassoc", "contract", "nsz"}
_ONE = np.float32(1)
_LOG2_E, _LN_2 = np.float32(1.4426950408889634), np.float32(0.6931471805599453)
_LARGEST = np.float32(80)  # exp of it is finite
# 1 / k!, k = 2 ... 6: the exponential series, to 2e-7 for |x| <= ln 2 / 2
_C2, _C3, _C4, _C5, _C6 = (np.float32(1 / k) for k in (2, 6, 24, 120, 720))


class TableArrays(NamedTuple):
    """The buffers of a `StrokeTable`, as they are explained there, and how far its magnitudes are stretched."""

    coefficients: Array
    basis: Array
    mean: Array
    cells: Array
    counts: Array
    part_of: Array
    first_of: Array
    beyond: np.float32


@njit(cache=True)
def part_by_part(place, spans, table):  # type: ignore[no-untyped-def]
    """The numbers [n] of the strokes at place [3, n], those of one part one after another: its basis is cached."""
    part = np.zeros(place.shape[1], np.int64)
    for axis in range(3):
        for i in range(place.shape[1]):
            span = np.int64(place[axis, i] * np.float32(spans[axis]))
            part[i] += table.part_of[axis, min(max(span, 0), spans[axis] - 1)]
    return np.argsort(part)


@njit(cache=True, fastmath=_SUMS)
def look_up(place, spans, table, maps):  # type: ignore[no-untyped-def]
    """Magnitudes of n strokes at place [3, n] in [0, 1], to maps [n, rows x columns], which come as zeros."""
    rank, most = table.basis.shape[1:]
    weight, slope = np.empty((3, 4), np.float32), np.empty((3, 4), np.float32)
    first = np.empty(3, np.int64)
    coordinates, logits = np.empty(rank, np.float32), np.empty(most, np.float32)
    bits = np.empty(most, np.int32)
    for i in part_by_part(place, spans, table):
        part = _weigh(place[:, i], spans, table, first, weight, slope)
        _sum_up(table.coefficients[part], first, weight, coordinates)
        count = table.counts[part]
        line = logits[:count]
        line[:] = table.mean[part, :count]
        for r in range(0, rank, 4):
            a, b, c, d = coordinates[r], coordinates[r + 1], coordinates[r + 2], coordinates[r + 3]
            one, two = table.basis[part, r, :count], table.basis[part, r + 1, :count]
            three, four = table.basis[part, r + 2, :count], table.basis[part, r + 3, :count]
            for k in range(count):
                line[k] += (a * one[k] + b * two[k]) + (c * three[k] + d * four[k])
        _squash(line, bits[:count], table.beyond)
        cells, mark = table.cells[part], maps[i]
        for k in range(count):
            mark[cells[k]] = line[k]


@njit(cache=True, fastmath=_SUMS)
def pull_back(place, spans, table, maps, upstream, to_place):  # type: ignore[no-untyped-def]
    """From gradients to the maps, both [n, rows x columns], to those of the places [3, n]."""
    rank, most = table.basis.shape[1:]
    weight, slope = np.empty((3, 4), np.float32), np.empty((3, 4), np.float32)
    first = np.empty(3, np.int64)
    pull, magnitude = np.empty(most, np.float32), np.empty(most, np.float32)
    upon = np.empty(rank, np.float32)
    rim = table.beyond * (_ONE + table.beyond)
    scale = _ONE / (_ONE + np.float32(2) * table.beyond)
    for i in part_by_part(place, spans, table):
        part = _weigh(place[:, i], spans, table, first, weight, slope)
        count = table.counts[part]
        cells, mark, above = table.cells[part], maps[i], upstream[i]
        for k in range(count):
            magnitude[k] = mark[cells[k]]
            pull[k] = above[cells[k]]
        for k in range(count):
            inside = magnitude[k] - magnitude[k] * magnitude[k]
            pull[k] *= (inside + rim) * scale if inside > np.float32(0) else np.float32(0)
        for r in range(0, rank, 4):
            one, two = table.basis[part, r, :count], table.basis[part, r + 1, :count]
            three, four = table.basis[part, r + 2, :count], table.basis[part, r + 3, :count]
            a = b = c = d = np.float32(0)
            for k in range(count):
                a += pull[k] * one[k]
                b += pull[k] * two[k]
                c += pull[k] * three[k]
                d += pull[k] * four[k]
            upon[r], upon[r + 1], upon[r + 2], upon[r + 3] = a, b, c, d
        along = table.coefficients[part]
        x = y = z = np.float32(0)
        for p in range(4):
            for q in range(4):
                for s in range(4):
                    row = along[first[0] + p, first[1] + q, first[2] + s]
                    dot = np.float32(0)
                    for r in range(rank):
                        dot += row[r] * upon[r]
                    x += slope[0, p] * weight[1, q] * weight[2, s] * dot
                    y += weight[0, p] * slope[1, q] * weight[2, s] * dot
                    z += weight[0, p] * weight[1, q] * slope[2, s] * dot
        to_place[0, i], to_place[1, i], to_place[2, i] = x, y, z


@njit(cache=True, fastmath=_SUMS)
def _weigh(place, spans, table, first, weight, slope):  # type: ignore[no-untyped-def]
    """Fills in, per axis, the first of four knots inside the part, their weights and slopes; returns the part."""
    part = 0
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
        part += table.part_of[axis, span]
        first[axis] = table.first_of[axis, span]
    return part


@njit(cache=True, fastmath=_SUMS)
def _sum_up(coefficients, first, weight, coordinates):  # type: ignore[no-untyped-def]
    coordinates[:] = np.float32(0)
    for p in range(4):
        for q in range(4):
            for s in range(4):
                share = weight[0, p] * weight[1, q] * weight[2, s]
                row = coefficients[first[0] + p, first[1] + q, first[2] + s]
                for r in range(len(coordinates)):
                    coordinates[r] += share * row[r]


@njit(cache=True, fastmath=_SUMS)
def _squash(line, bits, beyond):  # type: ignore[no-untyped-def]
    """`squash` in place; e^-x is 2^n times a polynomial, and 2^n is written bit by bit."""
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
