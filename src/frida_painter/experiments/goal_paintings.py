"""Paintings of goals that networks judge: planned, and painted by the virtual robot without looking in between."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.brush.table_cache import cached_table
from frida_painter.brush.weights import load_stroke_model
from frida_painter.experiments.execution import execute, open_easel
from frida_painter.experiments.outcome import Notify, Progress
from frida_painter.experiments.result_cache import Measurement, ResultCache
from frida_painter.experiments.scale import PlanningScale
from frida_painter.frames import CanvasSize
from frida_painter.goal import Goal
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.planning.optimize import Step
from frida_painter.planning.planner import Effort, Planner
from frida_painter.session.opening import planning_device

_PLANNING = 0.9  # share of the time that a painting takes
_PHOTOGRAPH_ROWS = 512


FULL = PlanningScale(strokes=100, colors=12, rows=256, effort=0.3)
QUICK = PlanningScale(strokes=6, colors=3, rows=48, effort=0.03, quick=True)


@dataclass(frozen=True)
class Painted:
    """The plan as a picture and the photograph of the canvas, [3, rows, columns], and the CPU seconds of planning."""

    planned: Tensor
    photograph: Tensor
    seconds: float


@dataclass(frozen=True)
class Bench:
    """What all paintings of a run share: brush, canvas, scale, and the networks that goals are seen through.

    keep: a folder in which finished paintings wait in case the rest is interrupted.
    """

    brush: str
    canvas: CanvasSize
    scale: PlanningScale
    encoders: EncoderRegistry
    keep: Path | None

    def recall(self, name: str, measure: Callable[[], Measurement], /, **depends: object) -> Measurement:
        """A painting's figures and pictures; painted and measured where it is not kept with all it depends on."""
        shared = {"brush": self.brush, "canvas": str(self.canvas), "scale": repr(self.scale)}
        return ResultCache(self.keep, {**shared, **depends}).recall(name, measure)

    def paint(self, goal: Goal, picture: Tensor, seed: int, notify: Notify, words: str) -> Painted:
        """Plans the goal and has the virtual robot paint it; it stands as far off as the seed says.

        The canvas lies as `picture` [3, H, W] does; words: what `notify` says is being done. Raises
        WeightsError where a network is missing.
        """
        started = time.process_time()
        size, scale = self.canvas.turned_like(*picture.shape[1:]), self.scale
        model = cached_table(load_stroke_model(self.brush))
        planner = Planner(
            goal,
            size,
            model,
            rows=scale.rows,
            effort=Effort().scaled(scale.effort),
            seed=seed,
            encoders=self.encoders,
            device=planning_device(),
        )
        bare = torch.ones(3, planner.fine.rows, planner.fine.columns)

        def hear(step: Step) -> None:
            notify(Progress(_PLANNING * step.iteration / step.of, f"{words}: planning"))

        plan = planner.plan(bare, scale.strokes, scale.colors, hear)
        seconds = time.process_time() - started
        notify(Progress(_PLANNING, f"{words}: painting"))
        photograph = execute(plan, open_easel(size, model.brush, seed), _PHOTOGRAPH_ROWS)
        grid = planner.fine
        return Painted(planner.expected(plan, bare), images.fit(photograph, grid.rows, grid.columns), seconds)
