"""Compiled loops (numba) that turn optimiser variables into strokes on the CPU.

variables.py has PyTorch versions with equal results. The numbers of a stroke are its middle x and y, angle, length,
bend and thickness, each in its unit from variables.py.
"""

import math

import numpy as np
from numba import float32, int64, njit, types


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
def to_colors(color, number, found, unit):  # type: ignore[no-untyped-def]
    """Writes colours by number into found [n, 3]: color[number[i]] times the unit, with color [k, 3] and number [n]."""
    for i in range(len(number)):
        for band in range(3):
            found[i, band] = color[number[i], band] * unit


@njit(cache=True)
def pull_to_colors(upstream, number, to_color, unit):  # type: ignore[no-untyped-def]
    """Adds gradients with respect to found [n, 3] to those with respect to the colours [k, 3], which start at zero."""
    for i in range(len(number)):
        for band in range(3):
            to_color[number[i], band] += upstream[i, band] * unit


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


def argument_types():  # type: ignore[no-untyped-def]
    """Returns the loops with the types of their arguments for a plan in float32; see compiled.py."""
    number, line, table, index = float32, float32[::1], float32[:, ::1], int64[::1]
    strokes = (table, line, index, table, line, line, line, line)
    pair = types.UniTuple(float32, 2)  # type: ignore[no-untyped-call]
    return (
        (to_strokes, strokes),
        (to_colors, (table, index, table, number)),
        (pull_to_shape, (*strokes, table)),
        (pull_to_colors, (table, index, table, number)),
        (bring_inside, (table, line, pair, pair, number, number)),
        (step, (line,) * 4 + (number,) * 5),
    )
