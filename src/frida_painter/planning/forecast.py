"""Forecast of the similarity of a painting to its photograph: the expected value and its range.

The expectation is exact for the moments of the marks in the stroke model (docs/explanation/renderer.md). The range
has three parts: the random differences of marks, the unknown placement error of the robot, and the error of the
model, which was measured on paintings. In 80 % of paintings the similarity is in the range (docs/lab/planning.md).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import torch
from torch import Tensor

from frida_painter.frames import PixelGrid
from frida_painter.objectives.objective import Goal
from frida_painter.planning.layers import beneath
from frida_painter.planning.optimize import stacked_moments
from frida_painter.planning.placement import Placement, displace_strokes
from frida_painter.planning.problem import FailureTolerance, PlanningProblem, PlanningProblems
from frida_painter.planning.refine import loss_of_paint, visible_area
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import Strokes
from frida_painter.system import images

_LIKELY = 1.28  # standard deviations: 80 % of a normal distribution
_REPAIRED, _UNKNOWN = 0.15, 0.2  # shares of the variance: what later plans repair, and its standard deviation
_UNKNOWN_DB = 0.1  # standard deviation of the error of the mean picture
_MIN_ERROR = 1e-6


@dataclass(frozen=True)
class SimilarityForecast:
    """Forecast of the PSNR between the finished painting and its photograph, in dB.

    expected: expected PSNR.
    least, most: ends of the likely range.
    """

    expected: float
    least: float
    most: float

    def __str__(self) -> str:
        return f"{self.expected:.1f} dB expected, {self.least:.1f} to {self.most:.1f}"

    @classmethod
    def of_error(cls, error: float, deviation: float) -> Self:
        """Returns the forecast for an expected mean squared error and its standard deviation between paintings."""
        error = max(error, _MIN_ERROR)
        expected = -10 * math.log10(error)
        half = _LIKELY * math.hypot(deviation / error * 10 / math.log(10), _UNKNOWN_DB)
        return cls(expected, expected - half, expected + half)


def forecast(
    goal: Goal,
    strokes: Sequence[Strokes],
    problems: Sequence[PlanningProblem],
    placement: Placement | None = None,
    unseen: int = 0,
    change: Tensor | None = None,
    painted: int = 0,
) -> SimilarityForecast | None:
    """Forecasts the similarity of a painting to its photograph; None if the goal has no photograph.

    strokes, problems: one for each brush in painting order; all are painted on the canvas of the first problem.
    placement: placement error of the robot as known so far. None: strokes land exactly.
    unseen: number of strokes painted before the next photograph improves the placement. Later strokes are planned
    on that photograph and repair a part of the earlier errors, equal to their share of the plan.
    change [3, H, W]: change of the expected picture by wet paint (wet_paint.py). None: all paint is dry.
    painted: number of strokes painted before these.
    """
    problems = [replace(one, wishes=replace(one.wishes, unrest=None)) for one in problems]
    photograph = next((term.picture for term in goal.terms if term.is_pixelwise), None)
    if photograph is None:
        return None
    canvas = problems[0].canvas
    target = images.resize_by_area(photograph.to(canvas), *canvas.shape[1:])
    target = target if change is None else target - change  # the same difference to the expected picture
    error, variance, chance = _error_and_chance(strokes, problems, target)
    count = sum(map(len, strokes))
    repaired = _REPAIRED * variance * (count - unseen) / max(count + painted, 1)
    shift, spread = 0.0, chance**2 + (_UNKNOWN * variance) ** 2
    if placement is None or unseen == 0:
        return SimilarityForecast.of_error(error - repaired, math.sqrt(spread))
    lasting = min(1.0, unseen / count)
    # Three-point Gauss-Hermite rule along each axis of the placement's covariance, about the believed error.
    covariance = np.linalg.inv(np.array(placement.information))
    lengths, axes = np.linalg.eigh(covariance)

    def error_if(step: Sequence[float]) -> float:
        """Returns the error if the first strokes, which are not seen, land beside their places."""
        landed, first = [], unseen
        for part in strokes:
            astray = displace_strokes(part[:first], tuple(step), problems[0].size)
            landed.append(Strokes.join(astray, part[first:]))
            first = max(0, first - len(part))
        return _error(landed, problems, target)

    for length, axis in zip(lengths, axes.T, strict=True):
        step = math.sqrt(3 * max(float(length), 0.0)) * axis
        up, down = error_if(step.tolist()), error_if((-step).tolist())
        shift += lasting * (up + down - 2 * error) / 6
        spread += lasting**2 * ((up - down) ** 2 / 2 + (up + down - 2 * error) ** 2 / 9) / 6
    return SimilarityForecast.of_error(error - repaired + max(shift, 0.0), math.sqrt(spread))


@torch.no_grad()
def _error(strokes: Sequence[Strokes], problems: Sequence[PlanningProblem], target: Tensor) -> float:
    """Returns the expected mean squared error to the target."""
    mean, variance = stacked_moments(strokes, problems)
    return float((mean - target).square().mean() + variance.mean())


def _error_and_chance(
    strokes: Sequence[Strokes], problems: Sequence[PlanningProblem], target: Tensor
) -> tuple[float, float, float]:
    """Returns the expected mean squared error, the mean variance in it, and the error's deviation by chance.

    A stroke that leaves more or less paint than its mean does so along the whole mark, and strokes are independent.
    To first order, the variance of the error is therefore the sum of the squared effects of each stroke's
    deviation.
    """
    parts = [(part, problem) for part, problem in zip(strokes, problems, strict=True) if len(part)]
    if not parts or all(problem.spread.share == 0 for _, problem in parts):
        return _error(strokes, problems, target), 0.0, 0.0
    laid, on = [part for part, _ in parts], [replace(problem, canvas=problems[0].canvas) for _, problem in parts]
    with torch.no_grad():
        marks = [problem.marks(part) for part, problem in zip(laid, on, strict=True)]
    magnitudes = [each.magnitude.requires_grad_() for each in marks]
    mean, variance = stacked_moments(laid, on, marks)
    error = (mean - target).square().mean() + variance.mean()
    slopes = torch.autograd.grad(error, magnitudes)
    by_chance = 0.0
    for problem, magnitude, slope in zip(on, magnitudes, slopes, strict=True):
        deviation = problem.spread.variance(magnitude.detach()).sqrt()
        by_chance += float((slope * deviation).sum((1, 2)).square().sum())
    return float(error.detach()), float(variance.detach().mean()), math.sqrt(by_chance)


@dataclass(frozen=True)
class Fading:
    """Cost of n strokes of a brush that runs dry, and lack a share f of their paint: f slope + f^2 square.

    slope, square [n]: in shares of the squared error of the whole plan's painting. A slope below 0 means that the
    stroke has too much paint.
    """

    slope: Tensor
    square: Tensor

    @property
    def without_paint(self) -> Tensor:
        """Cost of each stroke that lacks all of its paint, [n]."""
        return self.slope + self.square

    @classmethod
    def none(cls, strokes: int) -> Self:
        """Returns a zero cost for this number of strokes."""
        return cls(torch.zeros(strokes), torch.zeros(strokes))

    def of(self, strokes: Sequence[int]) -> Self:
        """Returns the costs of the strokes with these numbers."""
        return replace(self, slope=self.slope[strokes], square=self.square[strokes])


def fading_of(plan: Plan, canvas: Tensor, problems: PlanningProblems, grid: PixelGrid, seed: int) -> Fading:
    """Returns the cost of missing paint for each stroke of a plan, as seen under the strokes that follow.

    The cost is measured towards the picture that guides the plan. Without a guide picture, a stroke counts by its
    visible area. The cost is zero if memory is too short to compute it.
    canvas [3, H, W]: picture of the canvas.
    """
    parts, on = problems.stack(plan, canvas, grid)
    guide, laid = problems.guide(on[0]), list(zip(parts, on, strict=True))
    with FailureTolerance():
        if guide is None:
            areas = torch.cat([visible_area(*each) for each in laid]).clamp(min=0).cpu()
            return Fading(torch.zeros_like(areas), areas / areas.sum().clamp(min=1))
        found, below = [], on[0].canvas
        for number, (part, problem) in enumerate(laid, 1):
            here = replace(problem, canvas=below)
            seen, wanted = beneath(laid[number:], part, here, guide)
            found.append(loss_of_paint(part, seen, wanted, torch.Generator().manual_seed(seed)))
            with torch.no_grad():
                below = here.render(part)
        importance = on[0].wishes.importance
        matters = 1.0 if importance is None else importance
        whole = float((matters * (below - guide).square()).sum())
        slope, square = (torch.cat(each).cpu() / max(whole, 1e-9) for each in zip(*found, strict=True))
        return Fading(slope, square)
    return Fading.none(len(plan))
