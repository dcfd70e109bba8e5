"""How different two colours look: CIEDE2000, where 1 is about the least that a person sees."""

import numpy as np
import torch
from torch import Tensor

from frida_painter.palette import to_lab


def difference(one: Tensor, other: Tensor) -> Tensor:
    """CIEDE2000 between sRGB colours in [0, 1], [..., 3] and [..., 3] -> [...]. Not differentiable."""
    return ciede2000(to_lab(one.clamp(0, 1)), to_lab(other.clamp(0, 1)))


def ciede2000(one: Tensor, other: Tensor) -> Tensor:
    """CIEDE2000 between CIE L*a*b* colours, [..., 3] and [..., 3] -> [...], with all weights 1. Not differentiable."""
    from skimage.color import deltaE_ciede2000

    pair = (lab.detach().cpu().numpy() for lab in torch.broadcast_tensors(one, other))  # type: ignore[no-untyped-call]
    return torch.from_numpy(np.asarray(deltaE_ciede2000(*pair))).to(one)
