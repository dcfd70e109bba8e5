"""Planning with soft strokes by gradient descent: large ones first, each where the picture is most wrong."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import torch
import torch.nn.functional as functional
from torch import Tensor

from frida_painter import images
from frida_painter.experiments.soft_strokes import Freedom, SoftStrokes, marks, render
from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.palette import Palette
from frida_painter.planning.initialize import round_sizes
from frida_painter.render import composite

# First steps in metres (points, radii), shares (opacity) and sRGB.
_UNITS = {"points": 0.002, "radius": 0.001, "opacity": 0.04, "color": 0.03}
_FIRST_OPACITY = 0.8


@dataclass(frozen=True)
class SoftEffort:
    """rounds of placing, steps of `settling` after each, and of `polishing` at the end."""

    rounds: int = 6
    settling: int = 30
    polishing: int = 120

    def scaled(self, factor: float) -> Self:
        """So many times the steps, and at least one of each."""
        return replace(self, settling=math.ceil(factor * self.settling), polishing=math.ceil(factor * self.polishing))

    @property
    def steps(self) -> int:
        """All steps."""
        return self.rounds * self.settling + 2 * self.polishing


@dataclass(frozen=True)
class SoftPlan:
    """Strokes and the picture [3, H, W] that they are thought to make."""

    strokes: SoftStrokes
    picture: Tensor


def plan(
    target: Tensor,
    size: CanvasSize,
    freedom: Freedom,
    count: int,
    *,
    colors: int | None,
    effort: SoftEffort,
    seed: int,
    notify: Callable[[float], None] = lambda share: None,
) -> SoftPlan:
    """`count` strokes on a white canvas towards `target` [3, H, W], by the mean squared difference.

    colors: how many paints there are (None: every stroke has its own colour). notify: hears the
    share of the work that is done.
    """
    generator = torch.Generator().manual_seed(seed)
    bare = torch.ones_like(target)
    strokes = SoftStrokes(torch.zeros(0, 3, 2), torch.zeros(0, 2), torch.zeros(0, 2), torch.zeros(0, 3))
    done = 0

    def step() -> None:
        nonlocal done
        done += 1
        notify(done / effort.steps)

    quotas = round_sizes(count, effort.rounds)
    for number, quota in enumerate(quotas):
        smallness = number / max(1, len(quotas) - 1)
        new = _placed(strokes, quota, smallness, bare, target, size, freedom, generator)
        strokes = _settled(SoftStrokes.join(strokes, new), bare, target, size, freedom, effort.settling, step)
    strokes = _settled(strokes, bare, target, size, freedom, effort.polishing, step)
    if colors is not None:
        palette = Palette.cluster(strokes.color, strokes.length() * strokes.radius.mean(1), colors, seed)
        strokes = replace(strokes, color=palette.color[palette.nearest(strokes.color)])
    strokes = _settled(strokes, bare, target, size, freedom, effort.polishing, step, vary_color=colors is None)
    with torch.no_grad():
        return SoftPlan(strokes, render(strokes, bare, size))


@torch.no_grad()
def seen_colors(strokes: SoftStrokes, canvas: Tensor, size: CanvasSize) -> Tensor:
    """What colour [n, 3] each stroke's place has once it is laid over those before it: opacity mixed in."""
    maps, affine = marks(strokes, canvas, size)
    found, picture = [], canvas
    ones = torch.ones(1, 3).to(canvas)
    for index in range(len(strokes)):
        one = slice(index, index + 1)
        picture = composite(maps[one], affine[one], strokes.color[one], picture)
        share = composite(maps[one], affine[one], ones, torch.zeros_like(canvas))  # [3, H, W], of this stroke alone
        found.append((picture * share).sum((1, 2)) / share.sum((1, 2)).clamp(min=1e-6))
    return torch.stack(found)


@torch.no_grad()
def _placed(
    strokes: SoftStrokes,
    count: int,
    smallness: float,
    bare: Tensor,
    target: Tensor,
    size: CanvasSize,
    freedom: Freedom,
    generator: torch.Generator,
) -> SoftStrokes:
    """New strokes where the error is large, from the largest that may be (smallness 0) down to small ones (1)."""
    picture = render(strokes, bare, size) if len(strokes) else bare
    least, most = freedom.radius
    radius = most * max(least / most, 0.12) ** smallness
    grid = PixelGrid(size, *target.shape[1:])
    width = 2 * round(radius / grid.pitch[1] / 2) + 1
    error = (target - picture).square().sum(0)
    error = functional.avg_pool2d(error[None, None], width, 1, width // 2, count_include_pad=False)[0, 0]
    chosen = torch.multinomial(error.flatten() + 1e-12, count, replacement=True, generator=generator)
    pixel = torch.stack((chosen % error.shape[1], chosen // error.shape[1]), 1)
    middle = grid.to_canvas(pixel.float())
    angle = torch.rand(count, generator=generator) * torch.pi
    length = (2 * radius * (0.5 + 1.5 * torch.rand(count, generator=generator))).clamp(*freedom.length)
    half = torch.stack((torch.cos(angle), torch.sin(angle)), 1) * length[:, None] / 2
    smooth = images.fit(target, max(1, target.shape[1] // width), max(1, target.shape[2] // width))
    place = torch.stack((2 * middle[:, 0] / size.width - 1, 1 - 2 * middle[:, 1] / size.height), 1)
    color = functional.grid_sample(smooth[None], place[None, None], align_corners=False, padding_mode="border")
    new = SoftStrokes(
        torch.stack((middle - half, middle, middle + half), 1),
        torch.full((count, 2), radius),
        torch.full((count, 2), _FIRST_OPACITY),
        color[0, :, 0].T,
    )
    return freedom.project(new, size)


def _settled(
    strokes: SoftStrokes,
    bare: Tensor,
    target: Tensor,
    size: CanvasSize,
    freedom: Freedom,
    steps: int,
    step: Callable[[], None],
    *,
    vary_color: bool = True,
) -> SoftStrokes:
    """Adam on all strokes together; the best that were seen."""
    varied = [name for name in _UNITS if vary_color or name != "color"]
    leaves = {name: (strokes.arrays()[name] / _UNITS[name]).clone().requires_grad_() for name in varied}
    adam = torch.optim.Adam(leaves.values(), lr=1.0, betas=(0.9, 0.98), foreach=True)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, steps, eta_min=0.1)
    best, least = strokes, float("inf")
    for _ in range(steps):
        current = replace(strokes, **{name: leaf * _UNITS[name] for name, leaf in leaves.items()})
        loss = (render(current, bare, size) - target).square().mean()
        if loss.item() < least:
            least = loss.item()
            best = SoftStrokes(**{name: part.detach().clone() for name, part in current.arrays().items()})
        adam.zero_grad()
        torch.autograd.backward(loss)
        adam.step()
        schedule.step()
        with torch.no_grad():
            moved = replace(strokes, **{name: leaf * _UNITS[name] for name, leaf in leaves.items()})
            for name, part in freedom.project(moved, size).arrays().items():
                if name in leaves:
                    leaves[name].copy_(part / _UNITS[name])
        step()
    return best
