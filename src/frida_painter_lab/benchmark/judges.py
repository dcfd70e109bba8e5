"""Judges of a painting: how near the true canvas is to the photograph, or to a combined goal.

They see the true canvas of the virtual studio, from the front and in even light, at the size of the photograph.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from frida_painter import images, weights
from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.convolutional import EfficientNetLite
from frida_painter_lab.measures import feature_distance, psnr, ssim

PSNR, SSIM, PERCEPTUAL, FORECAST = "PSNR, dB", "SSIM", "perceptual distance", "forecast, dB"
LEFT = "goal left"
MINUTES, DIPS, CPU = "robot minutes", "dips", "CPU s"
STROKES, PAINTS = "strokes", "paints"
MEASURES = (PSNR, SSIM, PERCEPTUAL, LEFT, FORECAST, MINUTES, DIPS, CPU, STROKES, PAINTS)
"""Names of all figures, in the order of tables."""
MORE_IS_BETTER = {PSNR: True, SSIM: True, FORECAST: True, PERCEPTUAL: False, LEFT: False}
JUDGE_NETWORK = "efficientnet-lite1"
"""Network of the perceptual distance (Apache-2.0); no planner of this project uses it."""
_SIDE = 240  # pixels of its views


@dataclass(frozen=True)
class Judges:
    """Judges of pictures.

    seer: network of the perceptual distance; None if its weights were not fetched
    """

    seer: Seer | None

    @classmethod
    def open(cls) -> Self:
        """Returns the judges, with the network if its weights were fetched."""
        if weights.find(JUDGE_NETWORK) is None:
            return cls(None)
        return cls(EfficientNetLite(weights.tensors(JUDGE_NETWORK)))

    def of_picture(self, truth: Tensor, target: Tensor) -> Mapping[str, float]:
        """Returns the figures of a true canvas [3, h, w] beside its photograph [3, H, W]."""
        seen = images.resize_by_area(truth, *target.shape[1:])
        figures = {PSNR: psnr(seen, target), SSIM: ssim(seen, target)}
        if self.seer is not None:
            figures[PERCEPTUAL] = feature_distance(self.seer, seen, target, _SIDE)
        return figures


def lacks_network(figures: Mapping[str, float]) -> bool:
    """Returns True if the network is here now, and was not when a picture got these figures."""
    return PSNR in figures and PERCEPTUAL not in figures and weights.find(JUDGE_NETWORK) is not None


def forecast_fidelity(foretold: Tensor, truth: Tensor) -> float:
    """Returns how near the foretold picture [3, H, W] came to the true canvas [3, h, w], in dB."""
    with torch.no_grad():
        return psnr(foretold, images.resize_by_area(truth, *foretold.shape[1:]))


def finite(figures: Mapping[str, float]) -> dict[str, float]:
    """Returns the figures that are finite."""
    return {name: float(value) for name, value in figures.items() if math.isfinite(value)}
