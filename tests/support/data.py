"""Photographs that come with the project, as bytes [H, W, 3]."""

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

TARGETS = Path(__file__).parents[2] / "src/frida_painter_lab/targets"


def coffee() -> NDArray[np.uint8]:
    return _load("coffee")


def cat() -> NDArray[np.uint8]:
    return _load("cat")


def grey(name: str) -> torch.Tensor:
    """A photograph without colour, as a tensor [3, H, W] in [0, 1]."""
    return torch.from_numpy(_load(name)).float().mean(2).expand(3, -1, -1) / 255


def _load(name: str) -> NDArray[np.uint8]:
    return np.array(Image.open(TARGETS / f"{name}.jpg"))
