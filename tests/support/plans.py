"""Made-up plans for tests: random strokes on a small canvas, in random but repeatable colours."""

from dataclasses import replace

import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import StrokeLimits, Strokes

CANVAS = CanvasSize(0.3, 0.2)
LIMITS = StrokeLimits((0.01, 0.06), (-0.016, 0.016))


def made_up_strokes(count: int, seed: int = 0, canvas: CanvasSize = CANVAS) -> Strokes:
    generator = torch.Generator().manual_seed(seed)

    def random(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=generator)

    return Strokes(
        position=random(count, 2) * torch.tensor([canvas.width, canvas.height]),
        angle=(random(count) - 0.5) * 6,
        length=0.01 + 0.05 * random(count),
        bend=(random(count) - 0.5) * 0.03,
        thickness=random(count),
        color=random(count, 3),
    ).project(LIMITS, canvas)


def in_layers(plan: Plan, *sizes: int) -> Plan:
    """The plan with its strokes in layers of so many, all of the same brush and paints."""
    return replace(plan, layers=tuple(replace(plan.layers[0], strokes=size) for size in sizes))


def made_up_plan(count: int = 40, colors: int = 5, seed: int = 0, paint: list[int] | None = None) -> Plan:
    """`paint` gives the paint of every stroke; without it the paints follow each other from light to dark."""
    generator = torch.Generator().manual_seed(seed + 1)
    palette = Palette.sort_light_to_dark(torch.rand(colors, 3, generator=generator))
    chosen = torch.tensor(paint) if paint else torch.arange(count) * colors // max(1, count)
    strokes = made_up_strokes(len(chosen), seed)
    return Plan.of(strokes, palette, chosen, canvas=CANVAS, brush="medium", limits=LIMITS, about=(("seed", str(seed)),))


SMALL_LIMITS = StrokeLimits((0.01, 0.03), (-0.008, 0.008))
"""Limits of the brush "small" of `plan_of_paints`."""


def plan_of_paints(paint: list[int], length: float = 0.02, thickness: float = 0.5) -> Plan:
    """Equal strokes at one place of the stub easel's canvas, each in one of three paints, from light to dark."""
    n = len(paint)
    strokes = Strokes(
        torch.tensor([[0.03, 0.04]]).expand(n, 2),
        torch.zeros(n),
        torch.full((n,), length),
        torch.zeros(n),
        torch.full((n,), thickness),
        torch.zeros(n, 3),
    )
    palette = Palette(torch.tensor([[0.9, 0.9, 0.9], [0.5, 0.5, 0.5], [0.1, 0.1, 0.1]]))
    canvas = CanvasSize(0.12, 0.09)
    return Plan.of(strokes, palette, torch.tensor(paint), canvas=canvas, brush="small", limits=SMALL_LIMITS)
