"""Places as they are seen from a stroke's own path: how far along it, how far to its side.

A brush leaves much the same edge along a bent stroke as along a straight one. Seen from the path,
strokes of all lengths and bends look alike, and little is left to be learned about each.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

_SAMPLES = 25


@dataclass(frozen=True)
class PathView:
    """n places seen from the paths of their strokes; all in metres.

    along [n]: arc length from the start, below 0 before it; ahead [n]: what is left to the end;
    aside [n]: distance to the left of the path, positive where strokes of bend above 0 bend to.
    """

    along: Tensor
    ahead: Tensor
    aside: Tensor

    @classmethod
    def of(cls, place: Tensor, stroke: Tensor, length: Tensor, bend: Tensor, blend: float) -> "PathView":
        """How `place` [n, 2] looks from the path of stroke number `stroke` [n] of those of length and bend [k].

        Every point of the path sees a place in its own direction; what they see is blended by their
        distance, over about `blend` metres, so that the view changes smoothly everywhere, also inside
        a tight bend. Along a straight path it is exact. Differentiable in length and bend.
        """
        fraction = torch.linspace(0, 1, _SAMPLES, dtype=length.dtype, device=length.device)
        x = length[:, None] * fraction  # [k, samples]
        y = bend[:, None] * (3 * fraction * (1 - fraction))
        slope_y = bend[:, None] * (3 - 6 * fraction)
        speed = torch.sqrt(length[:, None] ** 2 + slope_y**2 + 1e-12)
        turn_x, turn_y = length[:, None] / speed, slope_y / speed
        step = torch.hypot(x.diff(dim=1), y.diff(dim=1) + 1e-9)
        walked = torch.nn.functional.pad(step.cumsum(1), (1, 0))
        # What a point sees is linear in the place, and so is what makes the difference between distances:
        # three numbers for each point of a path, and all is matrix products.
        ahead_of = walked - x * turn_x - y * turn_y
        left_of = x * turn_y - y * turn_x
        nearness = torch.stack((2 * x, 2 * y, -(x * x + y * y)), -1)[stroke] / blend**2  # [n, samples, 3]
        share = torch.softmax(nearness[..., 0] * place[:, :1] + nearness[..., 1] * place[:, 1:] + nearness[..., 2], -1)
        turn = (share[..., None] * torch.stack((turn_x, turn_y, ahead_of, left_of), -1)[stroke]).sum(1)  # [n, 4]
        along = turn[:, 0] * place[:, 0] + turn[:, 1] * place[:, 1] + turn[:, 2]
        aside = turn[:, 0] * place[:, 1] - turn[:, 1] * place[:, 0] + turn[:, 3]
        return cls(along, walked[:, -1][stroke] - along, aside)
