"""The picture of a surprise: where the canvas that was seen differs from the one that was expected."""

import cv2
import numpy as np
import torch
from torch import Tensor

from frida_painter.palette import to_lab

CLEARLY = 50.0
"""Distance in Lab that gets the strongest colour."""
_UNSEEN = 3.0
# White, yellow, orange, red, wine: evenly darker, so that the order also shows without colour vision.
_HEAT = ((1.0, 1.0, 1.0), (1.0, 0.835, 0.467), (0.961, 0.502, 0.243), (0.765, 0.122, 0.184), (0.345, 0.047, 0.180))


def difference(expected: Tensor, seen: Tensor) -> Tensor:
    """Distances in Lab between two pictures sRGB [3, H, W] as a heat map [3, H, W] over the pale picture seen.

    White-grey means as expected (below what an eye can tell apart), then yellow, orange, red and
    wine at a distance of 50 and more. Grain finer than a hundredth of the picture is smoothed away.
    """
    first, second = (_smoothed(picture) for picture in (expected, seen))
    apart = (to_lab(first) - to_lab(second)).norm(dim=-1)  # [H, W]
    strength = ((apart - _UNSEEN) / (CLEARLY - _UNSEEN)).clamp(0, 1) * (len(_HEAT) - 1)
    heat = torch.tensor(_HEAT).to(seen)
    below = strength.floor().clamp(max=len(_HEAT) - 2).long()
    share = (strength - below)[..., None]
    color = heat[below] * (1 - share) + heat[below + 1] * share  # [H, W, 3]
    light = to_lab(seen.permute(1, 2, 0))[..., :1] / 100  # [H, W, 1]
    return (color * (0.8 + 0.2 * light)).permute(2, 0, 1).clamp(0, 1)


def _smoothed(picture: Tensor) -> Tensor:
    """The picture as [H, W, 3] without its finest grain."""
    pixels = np.ascontiguousarray(picture.detach().permute(1, 2, 0).cpu().numpy(), dtype=np.float32)
    smooth = cv2.GaussianBlur(pixels, (0, 0), max(0.5, max(pixels.shape) / 400))
    return torch.from_numpy(np.clip(smooth, 0, 1)).to(picture)
