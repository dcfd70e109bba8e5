"""Where in a picture networks see what words say."""

from collections.abc import Callable

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.objectives.compositing import softened

_SIDE = 180  # pixels of the shorter side, at which it is looked at
_LOOKS, _NOISE = 6, 0.08
_NEAR = 0.09  # of the shorter side, over which what is found is smoothed
_LEAST, _MOST = 0.3, 0.97  # shares of the picture that do not count, and below which not all counts


def saliency(picture: Tensor, distance: Callable[[Tensor], Tensor], seed: int) -> Tensor:
    """How much of what words say is seen where in a picture [3, h, w], [h, w] in [0, 1]; distance: from the words.

    That is where the distance changes most with the colours, in the mean of several noisy looks (D. Smilkov and
    others, "SmoothGrad: removing noise by adding noise", 2017). Three tenths of the picture count nothing; where no
    change is seen at all, everything counts.
    """
    shorter = min(1.0, _SIDE / min(picture.shape[1:]))
    small = images.fit(picture, *(max(1, round(shorter * side)) for side in picture.shape[1:]))
    noise = torch.Generator().manual_seed(seed)
    change = torch.zeros(small.shape[1:])
    for _ in range(_LOOKS):
        noisy = (small + _NOISE * torch.randn(small.shape, generator=noise)).requires_grad_()
        with torch.enable_grad():
            (slope,) = torch.autograd.grad(distance(noisy), noisy)
        change += slope.abs().sum(0)
    near = max(1, round(_NEAR * min(small.shape[1:])))
    change = softened(change[None], near)[0]
    if not float(change.max()) > 0:
        return torch.ones(picture.shape[1:])
    low, high = torch.quantile(change, _LEAST), torch.quantile(change, _MOST)
    seen = ((change - low) / (high - low).clamp(min=1e-12)).clamp(0, 1)
    return images.fit(seen[None], *picture.shape[1:])[0]
