"""First pictures of coarse colours: a pyramid of small pictures, coloured until a network sees the words in it.

The coarse levels are coloured first and the fine ones later, so that large forms stand before small ones. The finest
level has a few hundred cells, too few for the fine patterns by which a network is fooled. Compare "octaves" in
Mordvintsev et al., "Inceptionism", 2015, and the pyramids in Olah et al., "Feature visualization", 2017.
"""

import time
from collections.abc import Callable, Sequence

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.objectives.encoders.base import Reader
from frida_painter.objectives.semantic_loss import Views
from frida_painter.objectives.word_settings import ClipWork

_LEVELS = (1, 3, 6, 12, 20)  # cells of the shorter side
_BEGUN = (1.0, 1.0, 0.3, 0.3, 0.3)  # standard deviation of each level at the beginning, before the logistic function
_FROM = (0.0, 0.0, 0.0, 0.3, 0.6)  # share of the steps after which a level takes part
_COLORED = 2  # pictures; the best one is taken
_VIEWS = 24
_ROWS = 48  # of a picture while it is coloured
_RATE = 0.08
_NOISE = 0.05  # standard deviation, of sRGB
_MUCH_LONGER, _SOON = 1.5, 5  # times the told time, and seconds for which nothing is told anew
_SMOOTH = 1.0  # weight of the mean difference between neighbours


def draw_pyramid(levels: Sequence[Tensor], rows: int, columns: int) -> Tensor:
    """Returns the pictures of levels [n, 3, h, w], coarse to fine: [n, 3, rows, columns] in [0, 1]. Differentiable."""
    every = [functional.interpolate(level, [rows, columns], mode="bicubic", align_corners=False) for level in levels]
    return torch.stack(every).sum(0).sigmoid()


def color_in(
    wish: Callable[[Tensor], Tensor],
    reader: Reader,
    size: tuple[int, int],
    seed: int,
    budget: ClipWork,
    tell: Callable[[str], None] = lambda sentence: None,
    heed: Callable[[], None] = lambda: None,
) -> Tensor:
    """Returns the picture [3, H, W] of coarse colours that is nearest to the words for a network.

    wish: distances [n] of pictures [n, 3, h, w] from the words
    reader: network that measures them; only its size counts here
    size: H and W
    budget: number of steps in which the colours change, and of views, half of them for each picture
    tell: receives a sentence about the expected time, after the second step, and again if it takes much longer
    heed: called before each step; may raise to end the work
    """
    steps, at_a_time = budget.first_steps, max(1, budget.views // _COLORED)
    rows, columns = (side * _ROWS // min(size) for side in size)
    views, judge = (Views(_VIEWS, reader.side, seed + number, _VIEWS // 2 - 1) for number in (0, 1))
    generator = torch.Generator().manual_seed(seed)
    levels = []
    for cells, spread in zip(_LEVELS, _BEGUN, strict=True):
        shape = (max(1, round(cells * side / _ROWS)) for side in (rows, columns))
        levels.append(spread * torch.randn(_COLORED, 3, *shape, generator=generator))
    adam = torch.optim.Adam([level.requires_grad_() for level in levels], _RATE, (0.9, 0.98))
    expected, began = 0.0, time.monotonic()
    for step in range(steps):
        heed()
        if step == 1:
            began = time.monotonic()  # the first step is slower
        done = step / steps
        taking_part = [level for level, first in zip(levels, _FROM, strict=True) if done >= first]
        picture = draw_pyramid(taking_part, rows, columns)
        which = views.some(at_a_time, generator)
        seen = torch.cat([views.of_squares(one, which, [0.5] * at_a_time) for one in picture])
        distance = wish(seen + _NOISE * torch.randn(seen.shape, generator=generator)).sum()
        uneven = (picture.diff(dim=2).abs().mean() + picture.diff(dim=3).abs().mean()) * _COLORED
        adam.zero_grad()
        torch.autograd.backward(distance + _SMOOTH * uneven)
        adam.param_groups[0]["lr"] = _RATE * (1 - 0.8 * done)
        adam.step()
        whole = (steps - 1) * (time.monotonic() - began) / max(step, 1)
        left = max(1, round(whole * (1 - step / max(steps - 1, 1))))
        if step and whole >= _MUCH_LONGER * expected:
            expected = whole
            if step == 1:
                tell(f"A first picture is coloured for the words, in about {left} s; the plan follows.")
            elif left > _SOON:
                tell(f"The first picture takes longer, about {left} s more; this machine is busy.")
    with torch.no_grad():
        found = draw_pyramid(levels, *size)
        which = torch.tensor([1, 2, 3])
        seen = torch.cat([judge.of_squares(one, which, [0.5] * 3) for one in found])
        return found[int(wish(seen).reshape(_COLORED, 3).mean(1).argmin())].clamp(0, 1)
