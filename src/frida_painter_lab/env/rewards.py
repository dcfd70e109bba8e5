"""Judges: how near a canvas is to its goal. The gain of the judge is the reward of a step.

All judge the true canvas, sRGB in [0, 1], at the size of the observation. A higher number is better.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.errors import ConfigError

Judge = Callable[[Tensor, Tensor], NDArray[np.float64]]
"""Returns a number [n] for each canvas and its goal, [n, 3, rows, columns] each."""
_MIN_ERROR = 1e-8


def _psnr(canvas: Tensor, goal: Tensor) -> NDArray[np.float64]:
    """Returns the peak signal-to-noise ratio in dB."""
    error = (canvas - goal).square_().mean((1, 2, 3)).double().numpy()
    return np.asarray(-10 * np.log10(np.maximum(error, _MIN_ERROR)), np.float64)


def _ssim(canvas: Tensor, goal: Tensor) -> NDArray[np.float64]:
    """Returns the structural similarity of the experiments, in [-1, 1]."""
    from frida_painter_lab.measures import ssim  # loaded here because few callers need it

    return np.array([ssim(*pair) for pair in zip(canvas, goal, strict=True)], np.float64)


def _perceptual() -> Judge:
    """Returns the judge of features: minus the distance of unit features of VGG16."""
    from frida_painter.objectives.encoders.loading import EncoderRegistry
    from frida_painter_lab.measures import perceptual_distance

    network = EncoderRegistry().style()

    def judge(canvas: Tensor, goal: Tensor) -> NDArray[np.float64]:
        pairs = zip(canvas.contiguous(), goal.contiguous(), strict=True)
        return np.array([-perceptual_distance(network, *pair) for pair in pairs], np.float64)

    return judge


JUDGES = ("psnr", "ssim", "perceptual")
"""Names of the judges."""
SSIM_WINDOW = 11
"""Pixels along a side of the windows of "ssim"; pictures are at least as large."""


def open_judge(name: str) -> Judge:
    """Returns a judge by its name.

    "psnr" is in dB, "ssim" in [-1, 1], "perceptual" minus the distance of features of a network, which must be fetched.
    Raises ConfigError for another name, and WeightsError if the network is missing.
    """
    match name:
        case "psnr":
            return _psnr
        case "ssim":
            return _ssim
        case "perceptual":
            return _perceptual()
    raise ConfigError(f"The judge {str(name)[:40]!r} was given; take {', '.join(JUDGES)}.")
