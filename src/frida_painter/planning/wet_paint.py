"""Wet paint on wet paint: how it changes the expected picture, and how much of it a painting shows.

A brush takes up wet paint along its way, and its mark mixes with the wet paint below it. The state of the canvas is,
for each pixel, the amount of wet paint (1 is a full mark) with its absorption K and scattering S; a mark adds its
own, and each second takes the same amount away until the paint has set. Mixtures are those of Kubelka and Munk
(mixing/recipe.py), here in three bands. docs/lab/planning.md has the measurements.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import interpolate

from frida_painter.calibration import WetPaint
from frida_painter.errors import PlanError
from frida_painter.frames import PixelGrid
from frida_painter.planning.optimize import PictureChange
from frida_painter.planning.problem import PlanningProblem, PlanningProblems
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import Strokes
from frida_painter.system import images
from frida_painter.system.devices import array
from frida_painter.system.images import to_linear

_ROWS = 64  # of the picture in which wet paint is reckoned; it changes a picture less sharply than marks do
_ALONG = 17  # places along a path at which the brush takes up paint
_SEEN = 0.02  # coverage below which a pixel is not part of a mark
_TRACE = 1e-4  # amount of paint that counts as none
_TYPICAL = WetPaint(rate=10.0, share=0.1, drying=300.0)
_COARSE, _FINE = 2.0, 1.2  # factors of the search
_MIN_EXPLAINED = 0.05
ENOUGH = 300
"""Number of last strokes from which wet paint is learned."""
_DARKEST, _LIGHTEST = 0.006, 0.985  # reflectance of paints


class Wetness(NamedTuple):
    """Exchange of wet paint, and the times at which strokes are painted.

    paint: exchange of brush and canvas
    painted_at: second at which each stroke of a plan is painted, in painting order
    below, below_at: strokes on the canvas that may still be wet, and the second at which each was painted. None: the
    canvas is dry.
    """

    paint: WetPaint
    painted_at: Sequence[float]
    below: Plan | None = None
    below_at: Sequence[float] = ()

    def change_on(self, scenes: PlanningProblems, grid: PixelGrid) -> PictureChange:
        """Returns the function from the strokes of the plan to the change of their expected picture on a grid."""
        below = scenes.stack(self.below, torch.ones(3, grid.rows, grid.columns), grid) if self.below else ([], [])
        at, seen = (*self.below_at, *self.painted_at), len(self.below_at)

        def change(strokes: Sequence[Strokes], problems: Sequence[PlanningProblem]) -> Tensor:
            return change_by_wet_paint([*below[0], *strokes], [*below[1], *problems], self.paint, at, seen)

        return change


def change_by_wet_paint(
    strokes: Sequence[Strokes],
    problems: Sequence[PlanningProblem],
    wet: WetPaint,
    painted_at: Sequence[float],
    seen: int = 0,
) -> Tensor:
    """Returns the change [3, H, W] of the expected picture by wet paint, without slopes.

    strokes, problems: one for each brush in painting order; the canvas of the first problem is dry.
    painted_at: second at which each stroke is painted, for the strokes of all brushes.
    seen: number of first strokes that the picture shows already; they only leave wet paint.
    Raises PlanError if there is not one time for each stroke, or a time is before the one of the stroke before.
    """
    rows, columns = problems[-1].canvas.shape[1:]
    grid = PixelGrid.of_height(problems[0].size, min(_ROWS, rows))
    packed = pack_marks(strokes, problems, grid)
    laid = lay_packed_marks(packed, wet, painted_at, grid.rows * grid.columns, seen).reshape(1, 3, grid.rows, -1)
    small = laid.to(problems[0].canvas)
    return interpolate(small, (rows, columns), mode="bilinear", align_corners=False)[0]


@dataclass(frozen=True)
class PaintedPart:
    """Strokes that were painted on a dry canvas, and the photograph of it.

    strokes, problems, painted_at: as for `change_by_wet_paint`
    seen [3, h, w]: photograph of the canvas after them
    expected [3, H, W]: expected picture without wet paint
    """

    strokes: Sequence[Strokes]
    problems: Sequence[PlanningProblem]
    painted_at: Sequence[float]
    seen: Tensor
    expected: Tensor


@torch.no_grad()
def learn_wet_paint(painted: Sequence[PaintedPart]) -> WetPaint | None:
    """Returns the wet paint that explains best how photographs differ from the expected pictures.

    None if it explains less than a share of `_MIN_EXPLAINED` of the squared difference.
    """
    known = []
    for part in painted:
        grid = PixelGrid.of_height(part.problems[0].size, min(_ROWS, part.expected.shape[1]))
        seen, expected = (
            images.resize_by_area(picture.to(part.problems[0].canvas), grid.rows, grid.columns)
            for picture in (part.seen, part.expected)
        )
        off = (seen - expected).flatten(1)
        known.append((pack_marks(part.strokes, part.problems, grid), part.painted_at, off.cpu()))

    def error(wet: WetPaint) -> float:
        laid = ((lay_packed_marks(marks, wet, at, off.shape[1]), off) for marks, at, off in known)
        return sum(float((off - change).square().mean()) for change, off in laid)

    best, least = _TYPICAL, error(_TYPICAL)
    factor = _COARSE
    while factor >= _FINE:
        near = [
            replace(best, **{name: value})
            for name, (low, high) in WetPaint.BOUNDS.items()
            for value in (getattr(best, name) * factor, getattr(best, name) * (1 / factor))
            if low <= value <= high
        ]
        better = min(((error(one), one) for one in near), key=lambda each: each[0])
        if better[0] < least:
            least, best = better
        else:
            factor **= 0.5
    without = sum(float(off.square().mean()) for _, _, off in known)
    return best if least < (1 - _MIN_EXPLAINED) * without else None


class PackedMarks(NamedTuple):
    """Marks of n strokes on the pixels that they cover, mark after mark, for the compiled loops (kernels.py).

    begin [n + 1]: first pixel of each mark, and the number of all
    pixel, alpha [k]: numbers of the pixels, and their coverage
    nearest [k]: the place along the path that is nearest to each
    steps [n, 17]: metres from the place before; 0 at the first
    color [n, 3]: sRGB of the paints
    """

    begin: NDArray[np.int64]
    pixel: NDArray[np.int32]
    alpha: NDArray[Any]
    nearest: NDArray[np.int8]
    steps: NDArray[Any]
    color: Tensor


def pack_marks(strokes: Sequence[Strokes], problems: Sequence[PlanningProblem], grid: PixelGrid) -> PackedMarks:
    """Returns the marks of the strokes of all brushes on a grid."""
    from frida_painter.planning import kernels  # loads the compiler
    from frida_painter.render.kernels import find_spans, painted_boxes

    found = []
    for part, problem in zip(strokes, problems, strict=True):
        small = replace(problem, canvas=problem.canvas.new_empty(3, grid.rows, grid.columns))
        with torch.no_grad():
            place = grid.to_pixels(part.path(torch.linspace(0, 1, _ALONG).to(part.length)))  # [n, 17, 2]
            metres = place * place.new_tensor(grid.pitch)
            step = torch.cat((place.new_zeros(len(part), 1), (metres[:, 1:] - metres[:, :-1]).norm(dim=2)), 1)
            magnitude, affine, path, way = (array(each.cpu()) for each in (*small.marks(part), place, step))
        spans = find_spans(affine, painted_boxes(magnitude), grid.rows, grid.columns)
        most, begin = spans.pixels, np.empty(len(part) + 1, np.int64)
        pixels = np.empty(most, np.int32), np.empty(most, magnitude.dtype), np.empty(most, np.int8)
        kernels.cover(magnitude, affine, path, spans, grid.columns, _SEEN, begin, *pixels)
        found.append((begin, *(each[: begin[-1]] for each in pixels), way))
    begins, *rest = zip(*found, strict=True)
    before = np.cumsum([0, *(begin[-1] for begin in begins)])
    begin = np.concatenate([*(one[:-1] + first for one, first in zip(begins, before, strict=False)), before[-1:]])
    pixel, alpha, nearest, steps = map(np.concatenate, rest)
    return PackedMarks(begin, pixel, alpha, nearest, steps, torch.cat([part.color for part in strokes]).detach().cpu())


def lay_packed_marks(
    marks: PackedMarks, wet: WetPaint, painted_at: Sequence[float], pixels: int, seen: int = 0
) -> Tensor:
    """Returns the change [3, P] of a picture of P pixels, whose canvas is dry, by wet paint after packed marks.

    seen: number of first marks that the picture shows already.
    """
    from frida_painter.planning import kernels

    begin, pixel, alpha, nearest, steps, color = marks
    if len(painted_at) != len(color) or not all(before <= after for before, after in pairwise(painted_at)):
        raise PlanError(
            f"{len(painted_at)} times were given for {len(color)} strokes; give one for each, in painting order."
        )
    # K and S of each paint relative to the S of white. K / S is that of a thick film; deep colours hold less white and
    # scatter less.
    reflected = to_linear(color.T.clamp(0, 1)).clamp(_DARKEST, _LIGHTEST)
    ratio = (1 - reflected).square() / (2 * reflected)
    scattering = (1 + ratio).rsqrt()
    own = torch.cat((ratio * scattering, scattering)).T.contiguous()
    change, amount, pigment = color.new_zeros(pixels, 3), color.new_zeros(pixels), color.new_ones(pixels, 6)
    times = np.array(painted_at, np.float64)
    settled = np.full(pixels, times[0] if len(times) else 0.0)
    numbers = wet.rate, wet.share, wet.drying
    canvas = array(change), array(amount), array(pigment), settled
    kernels.lay(begin, pixel, alpha, nearest, steps, array(own), times, seen, numbers, _TRACE, *canvas)
    return change.T
