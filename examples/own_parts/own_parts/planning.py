"""A planner, a mixer and an exporter, each in a few lines."""

import json

import torch
from torch.nn import functional

from frida_painter.plugins import (
    ExporterKind,
    ExportOptions,
    Finish,
    MixerKind,
    Palette,
    Plan,
    PlannerKind,
    PlanningTask,
    Strokes,
)


def plan_rows(task: PlanningTask) -> Plan:
    """Level strokes in rows from the top, as long as the brush allows, in the mean colours of the picture there."""
    model = next(iter(task.planner.models.values()))
    limits = model.limits.within(task.size)
    across = max(1, int(task.size.width / limits.length[1]))
    down = -(-task.strokes // across)
    guide = next((term.guide for term in task.goal.terms if term.guide is not None), task.canvas)
    colors = functional.adaptive_avg_pool2d(guide, (down, across)).flatten(1).T[: task.strokes]  # [n, 3], row by row
    palette = Palette.cluster(colors, torch.ones(len(colors)), min(task.colors, len(colors)), task.seed)
    paint, order = palette.nearest(colors).sort(stable=True)
    place = torch.stack((order % across + 0.1, down - order // across - 0.5), 1)
    position = place * torch.tensor([task.size.width / across, task.size.height / down])
    one = torch.ones(task.strokes)
    strokes = Strokes(position, 0 * one, limits.length[1] * one, 0 * one, 0.5 * one, palette.color[paint])
    inside = strokes.project(limits, task.size)
    facts = {"brush": model.brush, "limits": limits, "canvas": task.size, "ground": task.planner.ground}
    return Plan.of(inside, palette, paint, **facts)


def mix_light(parts: torch.Tensor, absorption: torch.Tensor, scattering: torch.Tensor, finish: Finish) -> torch.Tensor:
    """The mean of the paints' reflectances, as of tiny dots side by side."""
    ratio = absorption / scattering
    pure = 1 + ratio - (ratio.square() + 2 * ratio).sqrt()
    return parts / parts.sum(1, keepdim=True) @ pure


def write_paths(plan: Plan, options: ExportOptions) -> str:
    """The middle line of each stroke in millimetres, as JSON."""
    points = plan.strokes.path(torch.linspace(0, 1, 9)) * 1000
    return json.dumps([[[round(x, 2), round(y, 2)] for x, y in path] for path in points.tolist()])


ROWS = PlannerKind("rows", "Level strokes in rows.", plan_rows)
DOTS = MixerKind("dots", "Dots side by side.", mix_light)
PATHS = ExporterKind("paths", "Middle lines in millimetres, as JSON.", write_paths)
