"""Between logits, in which marks are smooth, and magnitudes, in which they are opaque, soft-edged, or not there.

The squash is a sigmoid that is stretched a little beyond [0, 1] and cut off there: away from a mark
the magnitude is exactly zero, and hundreds of strokes over one another leave no haze.
"""

import torch
from torch import Tensor

BEYOND = 0.005
"""How far the sigmoid is stretched beyond 0 and 1."""


def stretched(logits: Tensor) -> Tensor:
    """The sigmoid before it is cut off, in [-BEYOND, 1 + BEYOND]; for training, since its slope never dies."""
    return torch.sigmoid(logits).mul(1 + 2 * BEYOND).sub(BEYOND)


def squash(logits: Tensor) -> Tensor:
    """Logits to magnitudes in [0, 1], any shape."""
    return stretched(logits).clamp(0, 1)


def unsquash(magnitude: Tensor) -> Tensor:
    """The logits whose magnitude this is; for 0 and 1 those at which the cut begins."""
    return torch.logit((magnitude + BEYOND) / (1 + 2 * BEYOND))
