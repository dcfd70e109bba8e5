"""Looking at a picture from here and there: what is only noise to a network from one side is not so from another."""

import math

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.devices import sent

# kornia.augmentation's random perspectives and crops draw from the global generator, not from a seed of ours, and take
# twice as long: 54 ms of one core for eight views of 224 pixels with their gradient, against 25 ms here.
_CLOSEST = 0.65  # of the picture's sides that the tightest crop still shows
_TILT = 0.12  # by how much, of a half side, each corner may move on its own


class Views:
    """`count` ways of looking at pictures: the first at all of it, the others by random crops and perspectives.

    size: rows and columns of a view, in pixels. The ways are drawn once, from `seed`, so that a
    target can be prepared for each.
    """

    def __init__(self, count: int, size: int, seed: int) -> None:
        generator = torch.Generator().manual_seed(seed)
        whole = torch.eye(3)
        self._maps = torch.stack([whole, *(_look(generator) for _ in range(count - 1))])  # [count, 3, 3]
        self._size = size

    def __len__(self) -> int:
        return len(self._maps)

    def of(self, picture: Tensor, which: Tensor) -> Tensor:
        """picture [3, H, W] as it is seen in the ways numbered `which` [n] (of the CPU), [n, 3, size, size]."""
        side = self._size * 5 // 4
        small = functional.interpolate(picture[None], [side, side], mode="bilinear", antialias=True)
        along = (torch.arange(self._size) + 0.5) / self._size * 2 - 1
        y, x = torch.meshgrid(along, along, indexing="ij")
        points = torch.stack((x, y, torch.ones_like(x)), -1)  # [size, size, 3]
        seen = torch.einsum("nij,hwj->nhwi", self._maps[which], points)
        grid = sent((seen[..., :2] / seen[..., 2:]).to(picture.dtype), picture.device)
        return functional.grid_sample(
            small.expand(len(which), -1, -1, -1), grid, mode="bilinear", padding_mode="reflection", align_corners=False
        )


def _look(generator: torch.Generator) -> Tensor:
    """A homography from the corners of a view, at -1 and 1, to where they lie in the picture."""
    share, right, down = torch.rand(3, generator=generator).tolist()
    share = _CLOSEST + (1 - _CLOSEST) * math.sqrt(share)
    tilt = _TILT * (2 * torch.rand(4, 2, generator=generator) - 1)
    corners = torch.tensor([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    middle = (1 - share) * torch.tensor([2 * right - 1, 2 * down - 1])
    seen = (corners + tilt) * share + middle
    rows = []
    for (x, y), (u, v) in zip(corners.tolist(), seen.tolist(), strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
    solved = torch.linalg.solve(torch.tensor(rows, dtype=torch.float64), seen.double().flatten())
    return torch.cat((solved, solved.new_ones(1))).reshape(3, 3).float()
