"""Planning problem: the current canvas, a brush and an objective."""

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import TracebackType

import torch
from torch import Tensor, nn
from torch.nn import functional

from frida_painter.brush.kinds import CoverageSpread, StrokeModel, painted_area, spread_of
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, PlanError, PlanningDiverged
from frida_painter.frames import ALL_ROWS, PixelGrid, Rows
from frida_painter.objectives.image import spread
from frida_painter.objectives.interpretation import WeightedObjective
from frida_painter.objectives.objective import CanvasLoss, Goal, Sparing
from frida_painter.planning.brushwork import brushwork_cost
from frida_painter.render import Marks, Moments, marks_of, render, render_moments
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import StrokeLimits, Strokes
from frida_painter.system import images

# Factor of the spread, because marks vary more in a painting than in a stroke library: paint may lie on wet paint,
# the brush is not always full, and the plan prefers strokes for which the model errs in their favour. Measured on
# three photographs.
_IN_A_PAINTING = 1.5
PAINT_PRICE = 0.0003
"""Price of the paint of the brush's largest mark, as a share of the loss, for goals that are photographs."""
# Specks of the canvas: how much more their squared error counts; standard deviation of the blur that finds even areas,
# in metres; variance of an area that is half even; sRGB from which an area is light.
_SPECKS, _SURROUNDINGS, _EVEN, _LIGHT = 7.0, 0.004, 0.03**2, 0.5
_NOISE = 0.03  # largest difference in sRGB between a photograph of a bare canvas and its ground


@dataclass(frozen=True)
class ObjectiveForms:
    """Other forms of an objective, for purposes for which it is random, too slow, or needs whole pictures.

    validation: objective that compares plans, because the objective is random or could be fooled. None: it compares.
    on_rows: objective for pictures with some of the rows only. None: the objective needs whole pictures.
    sparing: maker of the objective for one optimisation if some of its terms are slow. None: none is.
    """

    validation: CanvasLoss | None = None
    on_rows: Callable[[Rows], CanvasLoss] | None = None
    sparing: Callable[[], Sparing] | None = None


@dataclass(frozen=True)
class StrokeWishes:
    """Wishes for strokes themselves, beside the picture that they make.

    importance [H, W]: weight of errors when strokes are placed, with mean 1. None: the same everywhere.
    brushwork [6, H, W]: wanted marks of strokes (objectives/style_flow.py). None: any marks.
    is_held: True if strokes are held to the brushwork as they descend; False if it only places them.
    paint_price: share by which the loss must fall for the paint of the brush's largest mark.
    darkest [3]: sRGB of the darkest available paint. None: black.
    unrest [H, W]: variance that the canvas counts as having before the strokes, so that they cover it. None: 0.
    """

    importance: Tensor | None = None
    brushwork: Tensor | None = None
    is_held: bool = True
    paint_price: float = 0.0
    darkest: Tensor | None = None
    unrest: Tensor | None = None


@dataclass(frozen=True)
class PlanningProblem:
    """Canvas picture [3, H, W] of `size` (blank or photographed), a brush and an objective.

    forms: other forms of the objective.
    wishes: what is wanted of the strokes themselves.
    rows: rows of the canvas that are rendered and judged.
    """

    canvas: Tensor
    size: CanvasSize
    model: StrokeModel
    objective: CanvasLoss
    forms: ObjectiveForms = field(default_factory=ObjectiveForms)
    wishes: StrokeWishes = field(default_factory=StrokeWishes)
    rows: Rows = ALL_ROWS

    @property
    def limits(self) -> StrokeLimits:
        """Limits of the brush on this canvas."""
        return self.model.limits.within(self.size)

    def in_paint(self, color: Tensor) -> Tensor:
        """Returns the nearest colour [..., 3] that paint can have: no channel is below that of the darkest paint."""
        darkest = self.wishes.darkest
        return color.clamp(0, 1) if darkest is None else torch.maximum(color.clamp(max=1), darkest)

    def marks(self, strokes: Strokes) -> Marks:
        """Returns the marks of strokes, on the rendered rows."""
        return marks_of(strokes, self.model, PixelGrid(self.size, *self.canvas.shape[1:]), self.rows)

    def render(self, strokes: Strokes) -> Tensor:
        """Renders the strokes, in their order, over the canvas; returns the picture [3, H, W]."""
        return render(strokes, self.model, self.canvas, self.size, self.rows)

    def moments(self, strokes: Strokes) -> Moments:
        """Returns mean and variance of the picture after the strokes; no two marks of one stroke are the same."""
        given = self.model, self.canvas, self.size, self.spread, self.rows
        return render_moments(strokes, *given, variance=self.unrest)

    @property
    def unrest(self) -> Tensor | None:
        """Unrest of the canvas (`StrokeWishes`), on the rendered rows; None if marks have no variance either."""
        given = self.wishes.unrest
        return None if given is None or self.spread.share == 0 else self.rows.of(given)

    @property
    def spread(self) -> CoverageSpread:
        """Spread of the marks of a painting about the stroke model."""
        return spread_of(self.model).widen(_IN_A_PAINTING)

    def expected_loss(self, strokes: Strokes, objective: CanvasLoss | None = None) -> Tensor:
        """Returns the expected loss over paintings of the strokes, by default for the objective of the scene."""
        judge = objective or self.objective
        if self.spread.share == 0:
            return judge(self.render(strokes))
        return judge(*self.moments(strokes))

    def stroke_cost(self, strokes: Strokes) -> Tensor:
        """Returns the price of the strokes' paint and of unwanted marks, as a share of the loss."""
        family = self.model.limits.family
        longest = self.model.limits.length[1] * (1.0 if family is None else family.way)
        cost = self.wishes.paint_price * painted_area(strokes.way() / longest, strokes.thickness, 1.0).sum()
        wanted = self.wishes.brushwork
        if wanted is None or not self.wishes.is_held:
            return cost
        return cost + brushwork_cost(strokes, wanted, self.model, self.size)


def is_bare(canvas: Tensor, ground: tuple[float, float, float]) -> bool:
    """Returns True if a canvas picture [3, H, W] shows only its ground (sRGB) and camera noise."""
    return bool((canvas - torch.tensor(ground).to(canvas)[:, None, None]).abs().amax() <= _NOISE)


def on_device(model: StrokeModel, device: torch.device) -> StrokeModel:
    """Returns the model on a device. On a GPU it is a copy, because others use the original on the CPU."""
    return copy.deepcopy(model).to(device) if device.type != "cpu" and isinstance(model, nn.Module) else model


_SEEN = 1 / 512  # coverage that changes no 8-bit pixel
_INSISTENCE = 4.0
_DIRECTIONS = 12
_SHRINKING = (1.0, 0.6, 0.3)
_STEPS = (0.01, 0.02, 0.035, 0.055, 0.08, 0.12)  # metres


@dataclass(frozen=True)
class Region:
    """Protected part of a canvas, such as a person has painted or wants to paint; no stroke may touch it.

    forbidden [H, W]: bool, True for protected pixels of a picture of the whole canvas.
    margin: distance in metres that strokes keep from it, because hands are less exact than plans.
    Raises ConfigError if `forbidden` is no bool picture, or if all of the canvas is forbidden.
    """

    forbidden: Tensor
    margin: float = 0.003

    def __post_init__(self) -> None:
        if self.forbidden.dim() != 2 or self.forbidden.dtype != torch.bool:
            raise ConfigError("A protected region is a picture of yes and no; draw it again.")
        if bool(self.forbidden.all()):
            raise ConfigError("All of the canvas is protected, so nothing can be painted; leave some of it free.")

    def on(self, grid: PixelGrid, *, widened: bool = True) -> Tensor:
        """Returns which pixels of a grid are forbidden, [rows, columns] bool: all that a forbidden region touches.

        widened: True if pixels within the margin are forbidden too.
        """
        picture = self.forbidden.float()[None, None]
        rows, columns = self.forbidden.shape
        if rows > grid.rows or columns > grid.columns:
            picture = functional.adaptive_max_pool2d(picture, (grid.rows, grid.columns))
        else:
            picture = functional.interpolate(picture, (grid.rows, grid.columns), mode="nearest")
        reach = int(torch.tensor(self.margin / min(grid.pitch)).ceil()) if widened else 0
        return functional.max_pool2d(picture, 2 * reach + 1, 1, reach)[0, 0] > 0

    def keep_forbidden(self, picture: Tensor, canvas: Tensor, size: CanvasSize) -> Tensor:
        """Returns the picture [3, H, W] with the forbidden pixels replaced by those of the canvas [3, H, W]."""
        forbidden = self.on(PixelGrid(size, *picture.shape[1:]), widened=False).to(picture.device)
        return torch.where(forbidden, canvas, picture)

    def guard(self, problem: PlanningProblem) -> PlanningProblem:
        """Returns the scene with objectives that gain nothing, and lose much, from strokes on forbidden pixels."""
        forbidden = self.on(PixelGrid(problem.size, *problem.canvas.shape[1:])).to(problem.canvas.device)

        def guard(objective: CanvasLoss, rows: Rows = ALL_ROWS) -> CanvasLoss:
            closed, canvas = rows.of(forbidden), rows.of(problem.canvas)

            def guarded(picture: Tensor, variance: Tensor | None = None) -> Tensor:
                changed = ((picture - canvas).square() * closed).mean()
                varies = None if variance is None else variance.masked_fill(closed, 0)
                return objective(torch.where(closed, canvas, picture), varies) + _INSISTENCE * changed

            return guarded

        def guard_sparing(made: Sparing) -> Sparing:
            return replace(made, anew=guard(made.anew), between=guard(made.between))

        judge, some, make = problem.forms.validation, problem.forms.on_rows, problem.forms.sparing
        forms = ObjectiveForms(
            None if judge is None else guard(judge),
            None if some is None else lambda rows: guard(some(rows), rows),
            None if make is None else lambda: guard_sparing(make()),
        )
        return replace(problem, objective=guard(problem.objective), forms=forms)

    def find_touching(self, strokes: Strokes, model: StrokeModel, size: CanvasSize, rows: int) -> Tensor:
        """Returns True for each stroke with a rendered pixel in the region, [n], drawn alone in a picture of `rows`."""
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
        """Returns strokes that do not touch the region, and their indices [m] in the given strokes.

        A stroke that touches the region is moved, and shortened if necessary, to the nearest clear place. It is
        left out if there is no clear place near it.
        """
        touched = self.find_touching(strokes, model, size, rows).tolist()
        places = [
            self._clear_place(stroke, model, size, rows) if touches else stroke
            for stroke, touches in zip(strokes, touched, strict=True)
        ]
        kept = [place for place in places if place is not None]
        numbers = [index for index, place in enumerate(places) if place is not None]
        return Strokes.join(*kept) if kept else strokes[:0], torch.tensor(numbers, dtype=torch.long)

    def clear(self, plan: Plan, models: Mapping[str, StrokeModel], rows: int, device: torch.device) -> Plan:
        """Returns the plan with all its strokes clear of the region (`keep_clear`); models are by kind of strokes."""
        found = []
        for part in plan.filled_layers():
            model = models[part.layers[0].kind]
            strokes, kept = self.keep_clear(part.strokes.to(device), model, plan.canvas, rows)
            found.append(replace(part.part(kept.tolist()), strokes=strokes.to("cpu")))
        return plan.with_parts(found)

    def _clear_place(self, stroke: Strokes, model: StrokeModel, size: CanvasSize, rows: int) -> Strokes | None:
        """Returns the stroke at the nearest clear place, or None if there is none near it."""
        turns = torch.arange(_DIRECTIONS) * (2 * torch.pi / _DIRECTIONS)
        around = torch.stack((turns.cos(), turns.sin()), -1).to(stroke.position)  # [d, 2]
        for step in (0.0, *_STEPS):
            for shrinking in _SHRINKING:
                shorter = replace(stroke, length=stroke.length * shrinking, bend=stroke.bend * shrinking)
                middle = stroke.path(stroke.length.new_tensor([0.5])) - shorter.path(stroke.length.new_tensor([0.5]))
                offsets = middle[0] + step * (around if step else around[:1] * 0)  # [d, 2]
                candidates = Strokes.join(*(replace(shorter, position=shorter.position + by) for by in offsets))
                candidates = candidates.project(model.limits, size)
                candidates = candidates[~self._find_crossing(candidates, size, rows)]
                clear = (~self.find_touching(candidates, model, size, rows)).nonzero()
                if len(clear):
                    return candidates[int(clear[0])]
        return None

    def _find_crossing(self, strokes: Strokes, size: CanvasSize, rows: int) -> Tensor:
        """Returns True for each stroke whose path, without width, crosses the region, [n]; faster than rendering."""
        grid = PixelGrid.of_height(size, rows)
        along = torch.linspace(0, 1, 9).to(strokes.length)
        pixel = grid.to_pixels(strokes.path(along)).round().long()  # [n, 9, 2]
        column, row = pixel[..., 0].clamp(0, grid.columns - 1), pixel[..., 1].clamp(0, grid.rows - 1)
        return self.on(grid).to(row.device)[row, column].any(1)


def region_of(picture: Tensor, *, only_inside: bool) -> Region:
    """Returns the region that a person drew, light on dark [3, H, W].

    only_inside: True if only the drawn part may be painted, False if it is protected.
    Raises ConfigError if nothing was drawn, or if all of the canvas is protected.
    """
    drawn = images.fit(picture, *picture.shape[1:]).mean(0) > 0.5
    if not bool(drawn.any()):
        raise ConfigError("Nothing was drawn; draw over the part of the canvas that is meant.")
    return Region(~drawn if only_inside else drawn)


@dataclass(frozen=True)
class PlanningProblems:
    """Factory of scenes for one goal, one canvas size and the brushes, for any canvas picture and grid.

    models: stroke models by the kind of strokes.
    objectives: objective of the goal on each grid.
    brushwork: wanted marks of strokes on each grid (objectives/style_flow.py); None for any marks.
    initial_objective: objective for growing strokes, if it differs.
    device: device of models, objectives and scenes.
    region: part of the canvas that strokes keep clear of.
    darkest: sRGB of the darkest paint. None: black.
    """

    size: CanvasSize
    models: Mapping[str, StrokeModel]
    goal: Goal
    objectives: Mapping[PixelGrid, WeightedObjective]
    brushwork: Mapping[PixelGrid, Tensor | None]
    initial_objective: WeightedObjective | None
    device: torch.device
    region: Region | None = None
    darkest: tuple[float, float, float] | None = None

    def of(
        self, canvas: Tensor, grid: PixelGrid, kind: str, objective: WeightedObjective | None = None
    ) -> PlanningProblem:
        """Returns the scene of a canvas picture [3, H, W] on a grid, for strokes of a kind (`Layer.kind`).

        Raises PlanError for an unknown kind.
        """
        if kind not in self.models:
            known = ", ".join(self.models)
            raise PlanError(f"The plan is for the brush {kind!r}, and here are {known}; name it in --brushes.")
        objective, model = objective or self.objectives[grid], self.models[kind]
        matters, brushwork = self.goal.initial_terms[0].importance, self.brushwork[grid]
        is_photograph = all(term.is_pixelwise for term in self.goal.terms)
        problem = PlanningProblem(
            canvas=images.fit(canvas.to(self.device), grid.rows, grid.columns),
            size=self.size,
            model=model,
            objective=objective,
            forms=ObjectiveForms(objective.validation, objective.on_rows, objective.sparing),
            wishes=StrokeWishes(
                importance=None if matters is None else spread(matters.to(self.device), grid.rows, grid.columns),
                brushwork=None if brushwork is None else brushwork.to(self.device),
                is_held=not is_photograph,
                paint_price=PAINT_PRICE if is_photograph else 0.0,
                darkest=None if self.darkest is None else torch.tensor(self.darkest, device=self.device),
            ),
        )
        if is_photograph and (guide := self.guide(problem)) is not None:
            problem = replace(problem, wishes=replace(problem.wishes, unrest=unrest_of(problem.canvas, guide, grid)))
        return problem if self.region is None else self.region.guard(problem)

    def stack(self, plan: Plan, canvas: Tensor, grid: PixelGrid) -> tuple[list[Strokes], list[PlanningProblem]]:
        """Returns the strokes of each brush in turn, one for an empty plan, and a scene of the canvas for each."""
        runs = plan.by_kind() or [(plan.layers[0].kind, plan.strokes)]
        return [strokes.to(self.device) for _, strokes in runs], [self.of(canvas, grid, kind) for kind, _ in runs]

    def guide(self, problem: PlanningProblem) -> Tensor | None:
        """Returns the picture, at the scene's resolution, that shows where strokes are needed, or None."""
        picture = next((term.guide for term in self.goal.initial_terms if term.guide is not None), None)
        if picture is None:
            return None
        guide = images.fit(picture.to(self.device), *problem.canvas.shape[1:])
        return guide if self.region is None else self.region.keep_forbidden(guide, problem.canvas, self.size)


def unrest_of(canvas: Tensor, guide: Tensor, grid: PixelGrid) -> Tensor:
    """Returns the unrest [H, W] of a canvas [3, H, W] under light, even areas of a guide [3, H, W] that differ from it.

    People see every speck of the bare canvas there, although a speck adds little to the squared error.
    """
    light = guide.mean(0, keepdim=True)
    mean, square = images.gaussian_blur(torch.cat((light, light.square())), _SURROUNDINGS / grid.pitch[1])
    even = _EVEN / (_EVEN + (square - mean.square()).clamp(min=0))
    return _SPECKS * even * (light[0] / _LIGHT).clamp(max=1).square() * (canvas - guide).square().mean(0)


# Processors and libraries each report a lack of memory in their own words.
_SAID = ("out of memory", "not enough memory", "can't allocate memory", "cannot allocate memory")


class FailureTolerance:
    """Context that ends its block at a lack of memory, on the machine or its accelerator, and if no plan is found."""

    def __enter__(self) -> None:
        pass

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        short = isinstance(error, RuntimeError) and any(words in str(error).lower() for words in _SAID)
        return short or isinstance(error, MemoryError | PlanningDiverged)
