"""What the benchmarks share: an experiment that a clock measures, and what a planner works on."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import ClassVar

import torch
from torch import Tensor

from frida_painter.brush.table import StrokeTable, cached_table
from frida_painter.brush.weights import load_stroke_model
from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.interpretation import prepare
from frida_painter.objectives.objective import Goal
from frida_painter.planning.problem import ObjectiveForms, PlanningProblem
from frida_painter.planning.variables import Paints
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.strokes import Strokes
from frida_painter.system import images
from frida_painter_lab.experiment import Experiment
from frida_painter_lab.runs import Value
from frida_painter_lab.targets import load_shipped_targets

CANVAS = CanvasSize(0.3556, 0.2794)
COLORS = 12


@dataclass(frozen=True, kw_only=True)
class Benchmark(Experiment):
    """Experiment whose runs are measured by a clock, one after another, on a machine that does nothing else.

    TEXT: what its part of docs/benchmarks.md says beside the tables
    ELSEWHERE: True if it needs another machine than the others
    """

    TEXT: ClassVar[str]
    ELSEWHERE: ClassVar[bool] = False

    def settings(self) -> dict[str, Value]:
        return {"brush": self.brush}


def cpu_seconds(work: Callable[[], object]) -> float:
    """CPU seconds that this process spends on the work, in all its threads."""
    start = time.process_time()
    work()
    return time.process_time() - start


def median_seconds(work: Callable[[], object], repeats: int) -> float:
    """The median of several times; the first turn only warms up."""
    return median([cpu_seconds(work) for _ in range(repeats + 1)][1:])


def photograph(name: str) -> Tensor:
    """One of the project's photographs as sRGB [3, H, W] in [0, 1]."""
    return load_shipped_targets([name])[0].picture


def in_paints(strokes: Strokes, colors: int) -> tuple[Strokes, Paints]:
    """The strokes in the nearest of so many paints, from light to dark."""
    palette = Palette.cluster(strokes.color, torch.ones_like(strokes.length), colors, 0)
    paint = torch.cdist(strokes.color, palette.color).argmin(1)
    order = torch.argsort(paint, stable=True)
    return strokes[order].with_groups(color=palette.color[paint[order]]), Paints(palette.color, paint[order])


def blank_problem(picture: Tensor, size: CanvasSize, rows: int, model: StrokeTable) -> tuple[PlanningProblem, Tensor]:
    """A bare white canvas of that many rows on which the picture is wanted, and the picture fitted to it."""
    grid = PixelGrid.of_height(size, rows)
    objective = prepare(Goal((ImageTerm(picture),)), grid)
    canvas = torch.ones(3, grid.rows, grid.columns)
    problem = PlanningProblem(canvas, size, model, objective, ObjectiveForms(on_rows=objective.on_rows))
    return problem, images.fit(picture, grid.rows, grid.columns)


def broad_brush() -> StrokeTable:
    """The stroke model of the shipped broad brush, as the planner uses it."""
    return cached_table(load_stroke_model("broad"))
