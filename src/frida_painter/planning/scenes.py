"""The scenes that a planner plans in: one goal, one canvas size and the brushes, for any canvas picture and grid."""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.errors import PlanError
from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.goal import Goal
from frida_painter.objectives.brushwork import flow_of
from frida_painter.objectives.interpretation import WeightedObjective
from frida_painter.objectives.replication import spread
from frida_painter.plan import Plan
from frida_painter.planning.region import Region
from frida_painter.planning.scene import PAINT_PRICE, Scene
from frida_painter.strokes import Strokes


@dataclass(frozen=True)
class Scenes:
    """Makes scenes.

    models: by the names of the brushes; objectives: of the goal, by grid; initial_objective: what strokes are grown
    towards, where that is another; both are on `device`, as the scenes are; region: what strokes keep clear of;
    darkest: sRGB of the darkest paint, None for black.
    """

    size: CanvasSize
    models: Mapping[str, StrokeModel]
    goal: Goal
    objectives: Mapping[PixelGrid, WeightedObjective]
    initial_objective: WeightedObjective | None
    device: torch.device
    region: Region | None = None
    darkest: tuple[float, float, float] | None = None

    def of(self, canvas: Tensor, grid: PixelGrid, brush: str, objective: WeightedObjective | None = None) -> Scene:
        """A canvas picture [3, H, W], on a grid, with a brush. Raises PlanError where there is no model of that."""
        if brush not in self.models:
            known = ", ".join(self.models)
            raise PlanError(f"The plan is for the brush {brush!r}, and here are {known}; name it in --brushes.")
        objective, model = objective or self.objectives[grid], self.models[brush]
        picture = images.fit(canvas.to(self.device), grid.rows, grid.columns)
        matters, way = self._importance(grid), flow_of(self.goal, grid)
        price = PAINT_PRICE if all(term.is_pixelwise for term in self.goal.terms) else 0.0
        judge, some = objective.validation, objective.on_rows
        floor = None if self.darkest is None else torch.tensor(self.darkest, device=self.device)
        scene = Scene(picture, self.size, model, objective, judge, matters, way, price, some, darkest=floor)
        return scene if self.region is None else self.region.guarded(scene)

    def initial(self, canvas: Tensor, grid: PixelGrid, brush: str) -> Scene:
        """The one in which strokes grow."""
        return self.of(canvas, grid, brush, self.initial_objective)

    def stack(self, plan: Plan, canvas: Tensor, grid: PixelGrid) -> tuple[list[Strokes], list[Scene]]:
        """The strokes of each brush in turn, and the canvas with that brush; a plan of no strokes has one of each."""
        runs = plan.by_brush() or [(plan.layers[0].brush, plan.strokes)]
        return [strokes.to(self.device) for _, strokes in runs], [self.of(canvas, grid, brush) for brush, _ in runs]

    def guide(self, scene: Scene) -> Tensor | None:
        """The picture, of the scene's resolution, that says where strokes are needed; None: only the objective does."""
        picture = next((term.guide for term in self.goal.initial_terms if term.guide is not None), None)
        if picture is None:
            return None
        guide = images.fit(picture.to(self.device), *scene.canvas.shape[1:])
        return guide if self.region is None else self.region.spared(guide, scene.canvas, self.size)

    def _importance(self, grid: PixelGrid) -> Tensor | None:
        """How much errors matter where, while strokes are placed."""
        matters = self.goal.initial_terms[0].importance
        return None if matters is None else spread(matters.to(self.device), grid.rows, grid.columns)
