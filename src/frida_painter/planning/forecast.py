"""How near a painting will come to its photograph: what is expected of a plan, and within which range.

The expectation is exact for the moments of the marks that the stroke model knows (docs/renderer.md). The range has
three parts: chance, which lets every stroke leave another mark; the placement, as long as it is not known where the
robot's strokes land; and what the model does not know, which was measured on paintings.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
import torch
from torch import Tensor

from frida_painter import images
from frida_painter.frames import PixelGrid, pixel_to_map
from frida_painter.goal import Goal
from frida_painter.planning.placement import Placement, moved
from frida_painter.planning.scene import Scene
from frida_painter.render import composite_moments
from frida_painter.strokes import Strokes

_LIKELY = 2.0  # standard deviations
_UNKNOWN_DB = 0.4
_LEAST_ERROR = 1e-6


@dataclass(frozen=True)
class SimilarityForecast:
    """Similarity of the finished painting to its photograph, PSNR in dB: expected, and the least and most to expect."""

    expected: float
    least: float
    most: float

    def __str__(self) -> str:
        return f"{self.expected:.1f} dB expected, {self.least:.1f} to {self.most:.1f}"

    @classmethod
    def of_error(cls, error: float, deviation: float) -> Self:
        """From the mean squared error that is expected, and its standard deviation from painting to painting."""
        error = max(error, _LEAST_ERROR)
        expected = -10 * math.log10(error)
        relative = _LIKELY * deviation / error * 10 / math.log(10)
        half = math.hypot(relative, _UNKNOWN_DB)
        return cls(expected, expected - half, expected + half)


def forecast(
    goal: Goal, strokes: Strokes, scene: Scene, placement: Placement | None = None, unseen: int = 0
) -> SimilarityForecast | None:
    """What is to be expected of strokes, in painting order, in a scene; None where the goal has no photograph.

    placement: what is known of where strokes land, None for everything; unseen: how many strokes are painted before the
    next look makes it known better. Later ones are planned on what is then seen.
    """
    photograph = next((term.picture for term in goal.terms if term.is_pixelwise), None)
    if photograph is None:
        return None
    target = images.fit(photograph.to(scene.canvas), *scene.canvas.shape[1:])
    error, chance = _error_and_chance(strokes, scene, target)
    if placement is None or unseen == 0:
        return SimilarityForecast.of_error(error, chance)
    # Three-point Gauss-Hermite rule along each axis of the placement's covariance, about what is believed.
    covariance = np.linalg.inv(np.array(placement.information))
    lengths, axes = np.linalg.eigh(covariance)
    shift, variance = 0.0, chance**2
    for length, axis in zip(lengths, axes.T, strict=True):
        step = math.sqrt(3 * max(float(length), 0.0)) * axis
        up, down = (_error(_landed(strokes, sign * step, scene, unseen), scene, target) for sign in (1, -1))
        shift += (up + down - 2 * error) / 6
        variance += ((up - down) ** 2 / 2 + (up + down - 2 * error) ** 2 / 9) / 6
    return SimilarityForecast.of_error(error + max(shift, 0.0), math.sqrt(variance))


def _landed(strokes: Strokes, error: np.ndarray[tuple[int], np.dtype[np.float64]], scene: Scene, count: int) -> Strokes:
    """The strokes, the first `count` of which land beside where they are meant by that placement error."""
    astray = moved(strokes[:count], tuple(error.tolist()), scene.size)
    return Strokes.join(astray, strokes[count:])


@torch.no_grad()
def _error(strokes: Strokes, scene: Scene, target: Tensor) -> float:
    """The mean squared error to the target that is expected."""
    mean, variance = scene.moments(strokes)
    return float((mean - target).square().mean() + variance.mean())


def _error_and_chance(strokes: Strokes, scene: Scene, target: Tensor) -> tuple[float, float]:
    """The mean squared error that is expected, and its standard deviation by chance.

    A stroke that leaves more or less paint than its mean does so along the whole mark, strokes independently: to first
    order the error's variance is the sum of squares of what each stroke's deviation makes of it.
    """
    spread = scene.spread
    if len(strokes) == 0 or spread.share == 0:
        return _error(strokes, scene, target), 0.0
    with torch.no_grad():
        magnitude = scene.model(strokes.thickness, strokes.length, strokes.bend)
        grid = PixelGrid(scene.size, *scene.canvas.shape[1:])
        affine = pixel_to_map(strokes.position, strokes.angle, grid, scene.model.frame)
    magnitude = magnitude.detach().requires_grad_()
    mean, variance = composite_moments(magnitude, affine, strokes.color, scene.canvas, spread, bare_cells_answer=False)
    error = (mean - target).square().mean() + variance.mean()
    (slope,) = torch.autograd.grad(error, magnitude)
    deviation = spread.variance(magnitude.detach()).sqrt()
    by_stroke = (slope * deviation).sum((1, 2))
    return float(error.detach()), float(by_stroke.square().sum().sqrt())
