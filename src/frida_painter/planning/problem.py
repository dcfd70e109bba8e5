"""What the planner plans on: a canvas as it is now, a brush, and what the picture shall become."""

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn
from torch.nn import functional

from frida_painter import images
from frida_painter.brush.kinds import CoverageSpread, StrokeModel, painted_area, spread_of
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, PlanError
from frida_painter.frames import ALL_ROWS, PixelGrid, Rows
from frida_painter.objectives.interpretation import WeightedObjective
from frida_painter.objectives.objective import Goal, Objective
from frida_painter.objectives.pixel_loss import spread
from frida_painter.objectives.style_flow import flow_of
from frida_painter.plan import Plan
from frida_painter.render import Marks, Moments, marks_of, render, render_moments
from frida_painter.strokes import StrokeLimits, Strokes

# Marks vary more in a painting than in a stroke library: paint lies on paint that may be wet, the brush is not always
# full, and of all strokes those are chosen for which the model is wrong in their favour. Measured on three photographs.
_IN_A_PAINTING = 1.5
PAINT_PRICE = 0.0003
"""Of strokes towards a photograph, as a share of the loss for as much paint as the brush's largest mark takes."""
_NOISE = 0.03  # of sRGB, by which a photograph of a bare canvas may differ from it


@dataclass(frozen=True)
class Scene:
    """A canvas picture [3, H, W] (blank, or a photograph of the real one) of `size`, a brush and an objective.

    validation: says which of several plans is best where the objective cannot: where it looks at a picture
    in another way every time, or could be fooled. importance [H, W]: how much an error matters at each
    place when strokes are placed, 1 in the mean; None: everywhere the same. flow [3, H, W]: which way strokes go where
    they are placed, as objectives/style_flow.py tells it; None: any way. paint_price: by which share the
    loss would have to fall for as much more paint as the brush's largest mark takes. objective_on_rows: the
    objective for pictures that have some rows only; None where it judges whole pictures. rows: which rows of the
    canvas are rendered and judged. darkest [3]: sRGB of the darkest paint that there is; None: black.
    """

    canvas: Tensor
    size: CanvasSize
    model: StrokeModel
    objective: Objective
    validation: Objective | None = None
    importance: Tensor | None = None
    flow: Tensor | None = None
    paint_price: float = 0.0
    objective_on_rows: Callable[[Rows], Objective] | None = None
    rows: Rows = ALL_ROWS
    darkest: Tensor | None = None

    @property
    def limits(self) -> StrokeLimits:
        """What the brush can do on this canvas."""
        return self.model.limits.within(self.size)

    def in_paint(self, color: Tensor) -> Tensor:
        """sRGB [..., 3] as near as paint comes to it: in [0, 1], and no band darker than in the darkest paint."""
        return color.clamp(0, 1) if self.darkest is None else torch.maximum(color.clamp(max=1), self.darkest)

    def marks(self, strokes: Strokes) -> Marks:
        """The marks that the brush makes of strokes, on the rows that are looked at."""
        return marks_of(strokes, self.model, PixelGrid(self.size, *self.canvas.shape[1:]), self.rows)

    def render(self, strokes: Strokes) -> Tensor:
        """The picture [3, H, W] that the strokes, in their order, would make of the canvas."""
        return render(strokes, self.model, self.canvas, self.size, self.rows)

    def moments(self, strokes: Strokes) -> Moments:
        """Mean and variance of that picture, since no two marks of one stroke are the same."""
        return render_moments(strokes, self.model, self.canvas, self.size, self.spread, self.rows)

    @property
    def spread(self) -> CoverageSpread:
        """How much the marks of a painting vary about what the model says."""
        return spread_of(self.model).widened(_IN_A_PAINTING)

    def expected_loss(self, strokes: Strokes, objective: Objective | None = None) -> Tensor:
        """What the objective (default: the scene's own) says on average of the pictures that the strokes would make."""
        judge = objective or self.objective
        if self.spread.share == 0:
            return judge(self.render(strokes))
        return judge(*self.moments(strokes))

    def paint_cost(self, strokes: Strokes) -> Tensor:
        """What the paint of strokes costs, as a share of the loss."""
        longest = self.model.limits.length[1]
        return self.paint_price * painted_area(strokes.length / longest, strokes.thickness, 1.0).sum()


def is_bare(canvas: Tensor, ground: tuple[float, float, float]) -> bool:
    """Whether a canvas picture [3, H, W] shows nothing but its ground (sRGB) and the noise of a camera."""
    return bool((canvas - torch.tensor(ground).to(canvas)[:, None, None]).abs().amax() <= _NOISE)


def on_device(model: StrokeModel, device: torch.device) -> StrokeModel:
    """The model on a device: a copy of it where that is another than the CPU, on which others draw with it."""
    return copy.deepcopy(model).to(device) if device.type != "cpu" and isinstance(model, nn.Module) else model


# Where on the canvas strokes may be: parts that a person has painted, or wants to paint, stay untouched.

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


# The scenes that a planner plans in: one goal, one canvas size and the brushes, for any canvas picture and grid.


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


# Telling a lack of memory from other failures: processors and their libraries each say it in their own way.

_SAID = ("out of memory", "not enough memory", "can't allocate memory", "cannot allocate memory")


def is_lack_of_memory(failure: Exception) -> bool:
    """Whether an exception says that there was not memory enough, on the machine or on its accelerator."""
    return isinstance(failure, MemoryError) or any(words in str(failure).lower() for words in _SAID)
