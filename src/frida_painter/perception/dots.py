"""Dots of paint that are new on the canvas, and which of them are the ones that were meant."""

from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.frames import PixelGrid
from frida_painter.perception.light import to_linear

_FAINTEST = 0.25  # share of its light that the canvas loses where paint covers it
_SOLID = 0.5  # of its smallest enclosing circle that a dot fills at least
_ODDEST_AREA = 4.0  # times larger or smaller than the usual dot
_SMALLEST = 4  # pixels
_MOST_SPOTS = 200
_MOST_TURN = np.tan(np.radians(20))
_MOST_SCALE = 0.1


@dataclass(frozen=True)
class Match:
    """Which dots are which. meant [k]: indices of those meant; seen [k]: of those seen."""

    meant: NDArray[np.intp]
    seen: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.meant)


def find_dots(before: Tensor, after: Tensor, grid: PixelGrid) -> NDArray[np.float64]:
    """Centres of roundish new marks of about one size, canvas metres [n, 2].

    before, after: the rectified canvas, sRGB [3, rows, columns] of `grid`. The centre is that of the
    paint that was added, weighed by how much of the canvas it covers.
    """
    bare, seen = to_linear(before).mean(0), to_linear(after).mean(0)
    covered = (1 - seen / bare.clamp(min=1e-3)).clamp(0, 1).numpy()
    covered = np.asarray(cv2.medianBlur(covered, 3), np.float32)
    count, label, facts, _ = cv2.connectedComponentsWithStats((covered > _FAINTEST).astype(np.uint8))
    dots: list[tuple[float, float]] = []
    areas: list[float] = []
    for number in range(1, count):
        left, top, width, height, area = (int(fact) for fact in facts[number])
        if area < _SMALLEST:
            continue
        box = np.s_[top : top + height, left : left + width]
        weight = np.where(label[box] == number, covered[box], 0)
        rows, columns = np.indices(weight.shape)
        row, column = (weight * rows).sum() / weight.sum(), (weight * columns).sum() / weight.sum()
        inside = np.argwhere(label[box] == number)[:, ::-1]
        _, radius = cv2.minEnclosingCircle(inside.astype(np.float32))
        if area >= _SOLID * np.pi * (radius + 0.5) ** 2:
            dots.append((left + float(column), top + float(row)))
            areas.append(float(area))
    if not dots:
        return np.empty((0, 2))
    usual = np.median(sorted(areas)[-_MOST_SPOTS:])
    alike = (np.array(areas) < _ODDEST_AREA * usual) & (np.array(areas) > usual / _ODDEST_AREA)
    chosen = np.array(dots)[alike][:_MOST_SPOTS]
    return np.asarray(grid.to_canvas(torch.from_numpy(chosen)).numpy(), np.float64)


def match_dots(meant: NDArray[np.float64], seen: NDArray[np.float64], *, reach: float, tolerance: float) -> Match:
    """The largest set of dots [k, 2] that one shift, turn and slight change of size carries from meant to seen.

    Any may be missing, and others be there. reach: how far from where it is meant a dot is looked
    for; tolerance: how far from where the others put it; both in metres. All pairs of dots are
    tried, not a sample of them (M. Fischler and R. Bolles, "Random sample consensus", 1981).
    """
    nothing = Match(np.empty(0, np.intp), np.empty(0, np.intp))
    near = np.linalg.norm(seen[None] - meant[:, None], axis=-1) <= reach if len(seen) else np.zeros((len(meant), 0))
    pairs = np.argwhere(near)
    best = nothing
    complex_meant, complex_seen = meant @ (1, 1j), seen @ (1, 1j)
    for (i, a), (j, b) in combinations(pairs.tolist(), 2):
        if i == j or a == b:
            continue
        growth = (complex_seen[b] - complex_seen[a]) / (complex_meant[j] - complex_meant[i])
        if not (abs(abs(growth) - 1) <= _MOST_SCALE and abs(growth.imag) <= _MOST_TURN * growth.real):
            continue
        expected = complex_seen[a] + growth * (complex_meant - complex_meant[i])
        found = _nearest(expected, complex_seen, tolerance)
        if len(found) > len(best):
            best = found
    return best


def _nearest(expected: NDArray[np.complexfloating], seen: NDArray[np.complexfloating], tolerance: float) -> Match:
    """Pairs of which each is the nearest to the other, and not further than the tolerance."""
    away = np.abs(seen[None] - expected[:, None])
    mine, theirs = away.argmin(1), away.argmin(0)
    number = np.arange(len(expected))
    good = (theirs[mine] == number) & (away[number, mine] <= tolerance)
    return Match(number[good], mine[good])
