"""Where on the canvas strokes may be: parts that a person has painted, or wants to paint, stay untouched."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import images
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.errors import ConfigError
from frida_painter.frames import ALL_ROWS, CanvasSize, PixelGrid, Rows
from frida_painter.objectives.objective import Objective
from frida_painter.plan import Plan
from frida_painter.planning.scene import Scene
from frida_painter.render import render
from frida_painter.strokes import Strokes

_SEEN = 1 / 512  # coverage that changes no 8-bit pixel
_INSISTENCE = 4.0
_DIRECTIONS = 12
_SHRINKING = (1.0, 0.6, 0.3)
_STEPS = (0.01, 0.02, 0.035, 0.055, 0.08, 0.12)  # metres


@dataclass(frozen=True)
class Region:
    """The part of a canvas that is not to be touched: forbidden [H, W] bool, a picture of the whole canvas.

    margin: metres by which strokes keep away from it, because hands are not as exact as plans.
    Raises ConfigError where all of the canvas is forbidden.
    """

    forbidden: Tensor
    margin: float = 0.003

    def __post_init__(self) -> None:
        if self.forbidden.dim() != 2 or self.forbidden.dtype != torch.bool:
            raise ConfigError("A protected region is a picture of yes and no; draw it again.")
        if bool(self.forbidden.all()):
            raise ConfigError("All of the canvas is protected, so nothing can be painted; leave some of it free.")

    def on(self, grid: PixelGrid, *, widened: bool = True) -> Tensor:
        """What is forbidden [rows, columns] bool on a grid: pixels of which any part is, or comes near it."""
        picture = self.forbidden.float()[None, None]
        rows, columns = self.forbidden.shape
        if rows > grid.rows or columns > grid.columns:
            picture = functional.adaptive_max_pool2d(picture, (grid.rows, grid.columns))
        else:
            picture = functional.interpolate(picture, (grid.rows, grid.columns), mode="nearest")
        reach = int(torch.tensor(self.margin / min(grid.pitch)).ceil()) if widened else 0
        return functional.max_pool2d(picture, 2 * reach + 1, 1, reach)[0, 0] > 0

    def spared(self, picture: Tensor, canvas: Tensor, size: CanvasSize) -> Tensor:
        """The picture [3, H, W] with the canvas [3, H, W], as it is, in what is forbidden."""
        forbidden = self.on(PixelGrid(size, *picture.shape[1:]), widened=False).to(picture.device)
        return torch.where(forbidden, canvas, picture)

    def guarded(self, scene: Scene) -> Scene:
        """The scene with objectives for which nothing is gained by touching what is forbidden, and much is lost."""
        forbidden = self.on(PixelGrid(scene.size, *scene.canvas.shape[1:])).to(scene.canvas.device)

        def guard(objective: Objective, rows: Rows = ALL_ROWS) -> Objective:
            closed, canvas = rows.of(forbidden), rows.of(scene.canvas)

            def guarded(picture: Tensor, variance: Tensor | None = None) -> Tensor:
                changed = ((picture - canvas).square() * closed).mean()
                varies = None if variance is None else variance.masked_fill(closed, 0)
                return objective(torch.where(closed, canvas, picture), varies) + _INSISTENCE * changed

            return guarded

        validation = None if scene.validation is None else guard(scene.validation)
        some = scene.objective_on_rows
        on_rows = None if some is None else lambda rows: guard(some(rows), rows)
        return replace(scene, objective=guard(scene.objective), validation=validation, objective_on_rows=on_rows)

    def touched_by(self, strokes: Strokes, model: StrokeModel, size: CanvasSize, rows: int) -> Tensor:
        """Which strokes have a rendered pixel in it, [n] bool, each drawn alone in a picture of so many rows."""
        grid = PixelGrid.of_height(size, rows)
        forbidden = self.on(grid).to(strokes.color.device)
        white = strokes.color.new_ones(3, grid.rows, grid.columns)
        black = strokes.with_groups(color=torch.zeros_like(strokes.color))
        touched = torch.zeros(len(strokes), dtype=torch.bool, device=forbidden.device)
        if not bool(forbidden.any()):
            return touched
        with torch.no_grad():
            for index in range(len(strokes)):
                covered = 1 - render(black[index : index + 1], model, white, size)[0]
                touched[index] = bool((covered[forbidden] > _SEEN).any())
        return touched

    def keep_clear(self, strokes: Strokes, model: StrokeModel, size: CanvasSize, rows: int) -> tuple[Strokes, Tensor]:
        """Strokes of which none touches it, and which of those given they are, [m].

        A stroke that touches it is moved, and made shorter where it must be, to the nearest place that
        is clear; where there is none it is left out.
        """
        touched = self.touched_by(strokes, model, size, rows)
        kept: list[Strokes] = []
        numbers: list[int] = []
        for index in range(len(strokes)):
            stroke = strokes[index : index + 1]
            if bool(touched[index]):
                found = self._clear_place(stroke, model, size, rows)
                if found is None:
                    continue
                stroke = found
            kept.append(stroke)
            numbers.append(index)
        return Strokes.join(*kept) if kept else strokes[:0], torch.tensor(numbers, dtype=torch.long)

    def cleared(self, plan: Plan, models: Mapping[str, StrokeModel], rows: int, device: torch.device) -> Plan:
        """The plan with its strokes kept clear, those that cannot be left out.

        models: of its brushes, on that device, by their names; rows: of the pictures in which strokes are drawn.
        """
        found = []
        for part in plan.filled_layers():
            model = models[part.layers[0].brush]
            strokes, kept = self.keep_clear(part.strokes.to(device), model, plan.canvas, rows)
            found.append(replace(part.part(kept.tolist()), strokes=strokes.to("cpu")))
        return plan.with_parts(found)

    def _clear_place(self, stroke: Strokes, model: StrokeModel, size: CanvasSize, rows: int) -> Strokes | None:
        """The nearest place where the stroke is clear, None where there is none near."""
        turns = torch.arange(_DIRECTIONS) * (2 * torch.pi / _DIRECTIONS)
        around = torch.stack((turns.cos(), turns.sin()), -1).to(stroke.position)  # [d, 2]
        for step in (0.0, *_STEPS):
            for shrinking in _SHRINKING:
                shorter = replace(stroke, length=stroke.length * shrinking, bend=stroke.bend * shrinking)
                middle = stroke.path(stroke.length.new_tensor([0.5])) - shorter.path(stroke.length.new_tensor([0.5]))
                offsets = middle[0] + step * (around if step else around[:1] * 0)  # [d, 2]
                candidates = Strokes.join(*(replace(shorter, position=shorter.position + by) for by in offsets))
                candidates = candidates.project(model.limits, size)
                outside = ~self._crossed_by(candidates, size, rows)
                candidates = candidates[outside]
                clear = (~self.touched_by(candidates, model, size, rows)).nonzero()
                if len(clear):
                    first = int(clear[0])
                    return candidates[first : first + 1]
        return None

    def _crossed_by(self, strokes: Strokes, size: CanvasSize, rows: int) -> Tensor:
        """Which strokes' paths, without any width, cross it, [n] bool: told much sooner than by drawing them."""
        grid = PixelGrid.of_height(size, rows)
        along = torch.linspace(0, 1, 9).to(strokes.length)
        pixel = grid.to_pixels(strokes.path(along)).round().long()  # [n, 9, 2]
        column, row = pixel[..., 0].clamp(0, grid.columns - 1), pixel[..., 1].clamp(0, grid.rows - 1)
        return self.on(grid).to(row.device)[row, column].any(1)


def region_of(picture: Tensor, *, only_inside: bool) -> Region:
    """The region that a person drew: light on dark [3, H, W]; either not to be touched, or the only one that may be.

    Raises ConfigError where nothing was drawn, or nothing is left.
    """
    drawn = images.fit(picture, *picture.shape[1:]).mean(0) > 0.5
    if not bool(drawn.any()):
        raise ConfigError("Nothing was drawn; draw over the part of the canvas that is meant.")
    return Region(~drawn if only_inside else drawn)
