"""Where strokes start: uniformly at random as in the paper, or placed where a guiding picture needs them."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
import torch.nn.functional as functional
from torch import Tensor

from frida_painter.frames import CanvasSize
from frida_painter.palette import to_lab
from frida_painter.planning.flow import along_flow
from frida_painter.planning.optimize import Step, optimize
from frida_painter.planning.proposals import layers, pick, propose, weigh
from frida_painter.planning.scene import Scene
from frida_painter.planning.variables import Paints
from frida_painter.strokes import StrokeLimits, Strokes

_COARSENESS = 3  # pixels, of the picture in which a start is planned
_DESCENDING, _DESCENT = 60, 0.05  # steps, and their size in sRGB


def uniform(count: int, limits: StrokeLimits, size: CanvasSize, generator: torch.Generator) -> Strokes:
    """`count` strokes sampled uniformly over the parameters (paper, Algorithm 1, `init_brush_strokes`)."""

    def between(low: float, high: float) -> Tensor:
        return low + (high - low) * torch.rand(count, generator=generator)

    limits = limits.within(size)
    strokes = Strokes(
        position=torch.rand(count, 2, generator=generator) * torch.tensor([size.width, size.height]),
        angle=between(-torch.pi, torch.pi),
        length=between(*limits.length),
        bend=between(*limits.bend),
        thickness=between(0, 1),
        color=torch.rand(count, 3, generator=generator),
    )
    return strokes.project(limits, size)


@dataclass(frozen=True)
class Growth:
    """How a plan grows: in `rounds` rounds of more and more strokes, each settled by `settling` joint steps.

    proposals: how many are weighed for each stroke that is placed.
    """

    rounds: int = 8
    settling: int = 25
    proposals: int = 12


def progressive(
    count: int,
    scene: Scene,
    target: Tensor,
    *,
    paints: Paints | None,
    light_to_dark: bool,
    growth: Growth,
    generator: torch.Generator,
    notify: Callable[[Step], None] = lambda step: None,
) -> tuple[Strokes, Paints | None]:
    """`count` strokes, in painting order, grown towards `target` [3, H, W] (of the scene's resolution).

    In every round the error of the picture so far says where strokes are proposed; those that gain
    most are placed, and all are settled together by gradient descent on the scene's objective.
    """
    strokes = Strokes.empty(device=scene.canvas.device)
    if paints is not None:
        paints = replace(paints, paint=paints.paint[:0])
    quotas = round_sizes(count, growth.rounds)
    for number, quota in enumerate(quotas):
        strokes, paints = place(
            strokes, paints, quota, scene, target, growth.proposals, light_to_dark=light_to_dark, generator=generator
        )

        def tell(step: Step, done: int = number) -> None:
            before = done * growth.settling
            notify(replace(step, iteration=before + step.iteration, of=len(quotas) * growth.settling))

        strokes, paints = optimize(
            strokes, scene, iterations=growth.settling, paints=paints, light_to_dark=light_to_dark, notify=tell
        )
    return strokes, paints


def place(
    strokes: Strokes,
    paints: Paints | None,
    count: int,
    scene: Scene,
    target: Tensor,
    proposals: int,
    *,
    light_to_dark: bool,
    generator: torch.Generator,
) -> tuple[Strokes, Paints | None]:
    """`count` more strokes where they gain most; strokes and paints come and go in painting order."""
    while count > 0:
        found = best_proposals(
            strokes, paints, count, scene, target, proposals, light_to_dark=light_to_dark, generator=generator
        )
        strokes, paints = insert(strokes, paints, found, light_to_dark=light_to_dark)
        count -= len(found.strokes)
    return strokes, paints


def descended(scene: Scene) -> Tensor:
    """A picture [3, H, W] for strokes to be placed towards where the goal has none: gradient descent from the canvas.

    It is no finer than strokes are, or networks would be pleased by patterns that no brush can paint. Against strokes
    that start at random, as in the paper, plans of 24 and 60 strokes towards four such goals ended a third nearer.
    """
    _, rows, columns = scene.canvas.shape
    shape = (max(1, rows // _COARSENESS), max(1, columns // _COARSENESS))
    small = functional.adaptive_avg_pool2d(scene.canvas[None], shape).clone().requires_grad_()
    adam = torch.optim.Adam([small], lr=_DESCENT)

    def picture() -> Tensor:
        return functional.interpolate(small, (rows, columns), mode="bilinear")[0]

    for _ in range(_DESCENDING):
        adam.zero_grad()
        torch.autograd.backward(scene.objective(picture()))
        adam.step()
        with torch.no_grad():
            small.clamp_(0, 1)
    return picture().detach()


@dataclass(frozen=True)
class Found:
    """Proposed strokes, best first: what each gains (summed squared error) and, with a palette, its paint."""

    strokes: Strokes
    gain: Tensor
    paint: Tensor | None

    def first(self, count: int) -> "Found":
        """The best `count` of them."""
        return Found(self.strokes[:count], self.gain[:count], None if self.paint is None else self.paint[:count])


@torch.no_grad()
def best_proposals(
    strokes: Strokes,
    paints: Paints | None,
    count: int,
    scene: Scene,
    target: Tensor,
    proposals: int,
    *,
    light_to_dark: bool,
    generator: torch.Generator,
) -> Found:
    """From 1 to `count` strokes that would gain most and keep clear of each other; `proposals` are weighed for each."""
    under = layers(strokes, scene, light_to_dark=light_to_dark)
    error = (target - under.picture).square().sum(0)
    if scene.importance is not None:
        error = error * scene.importance
    error = _blurred(error)
    many = max(64, proposals * count)
    candidates = propose(error, many, scene.limits, scene.size, generator)
    if scene.flow is not None:
        candidates = along_flow(candidates, scene.flow.to(error), scene.limits, scene.size, generator)
    gain, candidates, paint = weigh(candidates, under, target, paints, scene)
    chosen = pick(candidates, gain, count, scene.model)
    if len(chosen) == 0:  # nothing gains any more; the rest still has to be somewhere
        chosen = torch.argsort(gain, descending=True)[:count]
    return Found(candidates[chosen], gain[chosen], None if paint is None else paint[chosen])


def insert(
    strokes: Strokes, paints: Paints | None, found: Found, *, light_to_dark: bool
) -> tuple[Strokes, Paints | None]:
    """The strokes with those found put where they belong in the painting order."""
    strokes = Strokes.join(strokes, found.strokes)
    if paints is not None and found.paint is not None:
        paints = replace(paints, paint=torch.cat([paints.paint, found.paint]))
    if not light_to_dark:
        return strokes, paints
    order = torch.argsort(to_lab(strokes.color)[:, 0], descending=True, stable=True)
    return strokes[order], None if paints is None else replace(paints, paint=paints.paint[order])


def round_sizes(count: int, rounds: int) -> list[int]:
    """`count` split into at most `rounds` growing parts, each at least 1."""
    rounds = min(rounds, count)
    if rounds == 0:
        return []
    share = torch.arange(1, rounds + 1, dtype=torch.float64).cumsum(0)
    ends = (share / share[-1] * (count - rounds)).round().long() + torch.arange(1, rounds + 1)
    return torch.diff(ends, prepend=ends.new_zeros(1)).tolist()


def _blurred(error: Tensor) -> Tensor:
    """The error [H, W] over a neighbourhood of about a twentieth of the height."""
    width = 2 * (error.shape[0] // 40) + 1
    return functional.avg_pool2d(error[None, None], width, 1, width // 2, count_include_pad=False)[0, 0]
