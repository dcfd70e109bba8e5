"""Small canvases, pictures and brushes to plan with in a moment."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import torch
from torch import Tensor

from frida_painter.brush.table import StrokeTable, TableDetail
from frida_painter.brush.weights import AnyBrush
from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.interpretation import prepare
from frida_painter.objectives.objective import Goal
from frida_painter.planning.effort import Effort
from frida_painter.planning.materials import Materials
from frida_painter.planning.problem import PlanningProblem
from frida_painter.planning.settings import PlannerSettings
from frida_painter.strokes.palette import to_lab
from frida_painter.strokes.strokes import Strokes
from frida_painter.system import images
from marks import SMALL, ribbon

CANVAS = CanvasSize(0.12, 0.09)


def plain(
    size: CanvasSize | str,
    model: AnyBrush | Sequence[AnyBrush],
    effort: Effort | None = None,
    rows: int = 256,
    shares: tuple[float, ...] | None = None,
    **settings: Any,
) -> tuple[PlannerSettings, Materials, Effort | None]:
    """Settings, materials and effort of a planner that does one thing at a time, if these do not say otherwise."""
    chosen = PlannerSettings.of(
        canvas=size, **{"layers": 1, "new_paints": False, "focus": "none", "form": 0.0, **settings}
    )
    chosen = chosen.model_copy(update={"render_height": rows})  # fewer than people may have
    return chosen, replace(Materials.of(chosen, model), shares=shares), effort


def as_it_is(picture: Tensor, weight: float = 1.0, importance: Tensor | None = None) -> Goal:
    """A photograph that is not sharpened before it is planned."""
    return Goal((ImageTerm(picture, weight, importance, picture),))


@cache
def small_table() -> StrokeTable:
    """The ribbon of the small brush, tabulated coarsely."""
    return StrokeTable.of(ribbon(), detail=TableDetail((4, 5, 5), 48))


def picture(rows: int = 64, columns: int = 86) -> Tensor:
    """A dark disc and a red bar before a pale, graded ground, [3, rows, columns]."""
    y, x = torch.meshgrid(torch.linspace(0, 1, rows), torch.linspace(0, 1, columns), indexing="ij")
    image = torch.stack((0.9 - 0.2 * y, 0.85 - 0.1 * x, 0.6 + 0.3 * x))
    disc = ((x - 0.3) ** 2 + (y - 0.4) ** 2) < 0.04
    bar = (x > 0.55) & (x < 0.9) & (y > 0.6) & (y < 0.8)
    image = torch.where(disc, torch.tensor([0.1, 0.15, 0.3])[:, None, None], image)
    return torch.where(bar, torch.tensor([0.8, 0.2, 0.1])[:, None, None], image)


def goal() -> Goal:
    return as_it_is(picture(120, 160))


def problem(rows: int = 48, dtype: torch.dtype = torch.float32) -> PlanningProblem:
    """A white canvas on which `goal` is to be painted with the small brush."""
    grid = PixelGrid.of_height(CANVAS, rows)
    model = small_table() if dtype == torch.float32 else ribbon().to(dtype)
    return PlanningProblem(torch.ones(3, grid.rows, grid.columns, dtype=dtype), CANVAS, model, prepare(goal(), grid))


def target(of: PlanningProblem) -> Tensor:
    """What the scene's objective compares with, at its resolution."""

    return images.fit(goal().terms[0].image, *of.canvas.shape[1:])


def some_strokes(count: int, seed: int = 0, dtype: torch.dtype = torch.float32) -> Strokes:
    """Random strokes of the small brush that lie on the canvas, light to dark."""
    chance = torch.Generator().manual_seed(seed)

    def random(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=chance, dtype=torch.float64).to(dtype)

    color = random(count, 3)
    strokes = Strokes(
        position=random(count, 2) * torch.tensor([CANVAS.width, CANVAS.height], dtype=dtype),
        angle=6 * (random(count) - 0.5),
        length=0.01 + 0.02 * random(count),
        bend=0.012 * (random(count) - 0.5),
        thickness=random(count),
        color=color,
    ).project(SMALL.limits, CANVAS)

    return strokes[torch.argsort(to_lab(strokes.color)[:, 0], descending=True, stable=True)]
