"""Conversion between sRGB and linear light, in which light adds up and averages (IEC 61966-2-1)."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor


def to_linear(srgb: Tensor) -> Tensor:
    """Converts sRGB in [0, 1] to linear light in [0, 1], any shape."""
    return torch.where(srgb <= 0.04045, srgb / 12.92, ((srgb.clamp(min=0.04045) + 0.055) / 1.055) ** 2.4)


def to_srgb(linear: Tensor) -> Tensor:
    """Converts linear light to sRGB, any shape; clips to [0, 1]."""
    linear = linear.clamp(0, 1)
    return torch.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear.clamp(min=0.0031308) ** (1 / 2.4) - 0.055)


def light_of_bytes(photograph: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Converts a photograph in sRGB bytes to linear light in [0, 1], any shape."""
    tones: NDArray[np.float32] = to_linear(torch.linspace(0, 1, 256)).numpy()
    return tones[photograph]
