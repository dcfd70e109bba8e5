"""Abstract first pictures: a ground and patches of colour, arranged until a network sees the words in them.

Pictures of so few numbers cannot hold the fine patterns by which a network is fooled, and its slope reaches all of
them at once. Compare Tian & Ha, "Modern evolution strategies for creativity", EvoMUSART 2022, who paint with a few
triangles.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.objectives.encoders.base import Reader
from frida_painter.objectives.semantic_loss import Views
from frida_painter.objectives.word_settings import USUAL

_PATCHES = 8
_NUMBERS = 9  # of a patch: x, y, half width, half height, angle, squareness, red, green, blue
_TRIED, _KEPT, _FOUND = 24, 3, 1  # pictures at the beginning, those that are moved, and those of the second half
_VIEWS = 16
_AT_A_TIME = (1, 2)  # views of each picture in a step of the first half, while several are moved, and of the second
_ROWS = 96  # of a picture while it is moved
_RATE = 0.06
_NOISE = 0.03  # standard deviation, of sRGB
_SOFTEST, _SHARPEST = 0.35, 0.06  # width of a patch's edge, relative to its size
_SIZE = (0.1, 0.5)  # half sizes of a patch at the beginning, relative to the height


@dataclass(frozen=True)
class Patches:
    """Pictures of patches: numbers [n, patches, 9] and colours of the ground's upper and lower end [n, 2, 3].

    All numbers are free: sizes are logarithms, colours and places pass through a logistic function.
    """

    patches: Tensor
    ground: Tensor

    def draw(self, rows: int, columns: int, edge: float = _SHARPEST) -> Tensor:
        """Returns the pictures: [n, 3, rows, columns] in [0, 1]. Differentiable.

        edge: width of the patches' edges, relative to their sizes
        """
        y = ((torch.arange(rows) + 0.5) / rows)[:, None]
        x = ((torch.arange(columns) + 0.5) / rows)[None]
        width = columns / rows
        upper, lower = self.ground.sigmoid()[:, :, :, None, None].unbind(1)
        picture = upper + (lower - upper) * y.expand(rows, columns)
        for number in range(self.patches.shape[1]):
            right, down, wide, high, turn, square, *_ = self.patches[:, number, :, None, None].unbind(1)
            dx, dy = x - width * right.sigmoid(), y - down.sigmoid()
            along, across = dx * turn.cos() + dy * turn.sin(), dy * turn.cos() - dx * turn.sin()
            power = 2 + 6 * square.sigmoid()  # an ellipse of 2 becomes a rectangle of 8
            parts = torch.stack((along * torch.exp(-wide), across * torch.exp(-high))).abs().clamp(min=1e-4)
            radius = (parts[0] ** power + parts[1] ** power) ** (1 / power)
            over = ((1 - radius) / edge).sigmoid()[:, None]
            color = self.patches[:, number, 6:, None, None].sigmoid()
            picture = picture + over * (color - picture)
        return picture

    def some(self, which: Tensor) -> "Patches":
        """Returns the pictures numbered `which`."""
        return Patches(self.patches[which], self.ground[which])


def scatter(count: int, seed: int) -> Patches:
    """Returns pictures of random patches, larger ones below smaller ones."""
    generator = torch.Generator().manual_seed(seed)
    spread = torch.randn(count, _PATCHES, _NUMBERS, generator=generator)
    least, most = map(math.log, _SIZE)
    sizes = most - (most - least) * torch.rand(count, _PATCHES, generator=generator).sort(dim=1).values
    spread[..., 2:4] = sizes[..., None] + 0.3 * spread[..., 2:4]
    spread[..., 4] = math.pi * torch.rand(count, _PATCHES, generator=generator)
    spread[..., 6:] *= 2.0
    return Patches(
        spread,
        2.0 * torch.randn(count, 1, 3, generator=generator) + 0.5 * torch.randn(count, 2, 3, generator=generator),
    )


def arrange(
    wish: Callable[[Tensor], Tensor],
    reader: Reader,
    size: tuple[int, int],
    seed: int,
    steps: int = USUAL.first_steps,
) -> Tensor:
    """Returns the picture [3, H, W] of patches in which a network sees the words best.

    wish: distances [n] of pictures [n, 3, h, w] from the words
    reader: network that measures them; only its size counts here
    size: H and W
    steps: number of steps in which the patches are moved
    """
    rows, columns = size[0] * _ROWS // min(size), size[1] * _ROWS // min(size)
    views, judge = (Views(_VIEWS, reader.side, seed + number, _VIEWS // 2 - 1) for number in (0, 1))
    generator = torch.Generator().manual_seed(seed)

    def seen(pictures: Tensor, by: Views, which: Sequence[int]) -> Tensor:
        """Returns the mean distance [n] of pictures in some views."""
        numbers = torch.tensor(which)
        every = torch.cat([by.of_squares(picture, numbers, [0.5] * len(which)) for picture in pictures])
        return wish(every).reshape(len(pictures), len(which)).mean(1)

    found = scatter(_TRIED, seed)
    with torch.no_grad():
        first = seen(found.draw(rows, columns), judge, [0])
    found = found.some(first.argsort()[:_KEPT])
    for half in (0, 1):
        leaves = [found.patches.clone().requires_grad_(), found.ground.clone().requires_grad_()]
        adam = torch.optim.Adam(leaves, _RATE, (0.9, 0.98))
        for step in range(steps // 2):
            done = (half + step / (steps // 2)) / 2
            edge = _SOFTEST * (_SHARPEST / _SOFTEST) ** done
            which = views.some(_AT_A_TIME[half], generator).tolist()
            adam.zero_grad()
            pictures = Patches(leaves[0], leaves[1]).draw(rows, columns, edge)
            noisy = pictures + _NOISE * torch.randn(pictures.shape, generator=generator)
            torch.autograd.backward(seen(noisy, views, which).sum())
            adam.param_groups[0]["lr"] = _RATE * (1 - 0.8 * done)
            adam.step()
        found = Patches(leaves[0].detach(), leaves[1].detach())
        with torch.no_grad():
            order = seen(found.draw(rows, columns), judge, [1, 2, 3]).argsort()
        found = found.some(order[: _FOUND if half == 0 else 1])
    return functional.interpolate(found.draw(rows, columns), size, mode="bilinear", antialias=True)[0].clamp(0, 1)
