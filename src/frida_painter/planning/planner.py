"""The planner: a goal and a canvas become a plan, and what is left of a plan is planned again from a photograph."""

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor, nn

from frida_painter import images
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.brush.table_cache import cached_table
from frida_painter.brush.weights import load_stroke_model
from frida_painter.errors import ConfigError, PlanningDiverged
from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.goal import Goal
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.interpretation import WeightedObjective, interpreted, prepare
from frida_painter.objectives.replication import spread
from frida_painter.palette import Palette
from frida_painter.plan import Plan
from frida_painter.planning.initialize import Growth, descended, progressive
from frida_painter.planning.memory import is_lack_of_memory
from frida_painter.planning.optimize import Step, optimize
from frida_painter.planning.placement import Placement, locate
from frida_painter.planning.refine import anneal_to_palette, discretize, relocate
from frida_painter.planning.region import Region
from frida_painter.planning.scene import Scene
from frida_painter.planning.variables import Paints, as_palette
from frida_painter.strokes import Strokes

_MOVED = 0.15  # share of the strokes that may move at a time
_POLISHING_PACE = 0.5
_KEEPING = (0.7, 0.45, 0.2, 0.1)  # of the way from a stroke's colour to its paint, round after round
_PROPOSALS = 24  # weighed for each stroke that moves


@dataclass(frozen=True)
class Effort:
    """How many iterations are spent on what.

    growth: on the start; refining: joint steps after each of `relocations` rounds in which weak
    strokes move; drawing: steps after each round in which colours are drawn towards the paints;
    binding: steps once they are paints; polishing: last steps at full resolution; replanning:
    steps after each look.
    """

    growth: Growth = field(default_factory=Growth)
    relocations: int = 3
    refining: int = 25
    drawing: int = 20
    binding: int = 40
    polishing: int = 80
    replanning: int = 40

    def scaled(self, factor: float) -> "Effort":
        """The same effort with `factor` times as many iterations."""
        growth = Growth(self.growth.rounds, math.ceil(self.growth.settling * factor), self.growth.proposals)
        return Effort(
            growth,
            self.relocations,
            math.ceil(self.refining * factor),
            math.ceil(self.drawing * factor),
            math.ceil(self.binding * factor),
            math.ceil(self.polishing * factor),
            math.ceil(self.replanning * factor),
        )


class Planner:
    """Plans strokes of one brush towards one goal on one canvas (paper, Algorithm 1).

    size: of the canvas, such as "14x11in"; by default in the proportions of the goal's first
    picture, within 14 x 11 inches.
    model: what the brush's marks look like, or the name of a brush that comes with the project. rows:
    height of the picture in which is planned; the start is planned at half of it. effort: how
    many iterations are spent, as a factor of the usual number, or one by one. Every random choice comes
    from `seed`. encoders: the networks that the goal is seen through, by default
    those that were fetched. device: where is planned; pictures and plans come and go on the CPU.
    region: what strokes keep clear of, from the next plan on. Raises WeightsError where the goal needs
    a network that is missing.
    """

    def __init__(
        self,
        goal: Goal,
        size: CanvasSize | str | None = None,
        model: StrokeModel | str = "broad",
        *,
        rows: int = 256,
        effort: Effort | float = 1.0,
        seed: int = 0,
        encoders: EncoderRegistry | None = None,
        device: torch.device | None = None,
    ) -> None:
        self.size = size = _usual_size(goal) if size is None else CanvasSize.of(size)
        self.model = model = cached_table(load_stroke_model(model)) if isinstance(model, str) else model
        self.effort = effort if isinstance(effort, Effort) else Effort().scaled(effort)
        self.fine = PixelGrid.of_height(size, rows)
        self.coarse = PixelGrid.of_height(size, max(rows // 2, 32))
        self.seed = seed
        self.region: Region | None = None
        self.encoders = encoders or EncoderRegistry()
        self.device = device or torch.device("cpu")
        self._model = _on(model, self.device)
        self.goal = goal = interpreted(goal, self.fine, self.encoders, seed)
        near = goal.to(self.device)
        self._objectives = {grid: prepare(near, grid, self.encoders, seed) for grid in (self.fine, self.coarse)}
        self._initial_objective = self._objectives[self.coarse]
        if goal.initial_terms is not goal.terms:
            self._initial_objective = prepare(Goal(near.initial_terms), self.coarse, self.encoders, seed)

    @property
    def bare(self) -> Tensor:
        """A bare white canvas, [3, H, W] of the fine grid."""
        return torch.ones(3, self.fine.rows, self.fine.columns)

    def plan(
        self,
        canvas: Tensor | None = None,
        strokes: int = 300,
        colors: int = 12,
        notify: Callable[[Step], None] | None = None,
    ) -> Plan:
        """A plan of `strokes` strokes in `colors` paints for a canvas picture [3, H, W], by default a bare one.

        notify: hears of every step. Raises ConfigError where not a stroke or not a paint was asked for, and
        PlanningDiverged where no plan is found.
        """
        if not (strokes >= 1 and colors >= 1):
            raise ConfigError(f"{strokes} strokes in {colors} paints were asked for; give at least 1 of each.")
        canvas = self.bare if canvas is None else canvas
        generator = torch.Generator().manual_seed(self.seed)
        colors = min(colors, strokes)
        coarse, fine = self._scene(canvas, self.coarse), self._scene(canvas, self.fine)
        initial_scene = self._scene(canvas, self.coarse, self._initial_objective)
        guide = self._guide(coarse)
        target = descended(initial_scene) if guide is None else guide
        steps = _Progress(notify or _unheard, self.iterations(strokes))
        found, _ = progressive(
            strokes,
            initial_scene,
            target,
            paints=None,
            light_to_dark=True,
            growth=self.effort.growth,
            generator=generator,
            notify=steps.begin(self._growing(strokes)),
        )
        for _ in range(self.effort.relocations):
            if guide is not None:  # a picture that is only one of many good ones must not pull strokes back to it
                found, _ = relocate(
                    found, None, initial_scene, guide, share=_MOVED, proposals=_PROPOSALS, generator=generator
                )
            found, _ = optimize(
                found, initial_scene, iterations=self.effort.refining, notify=steps.begin(self.effort.refining)
            )
        for keeping in _KEEPING:
            found = anneal_to_palette(found, coarse, colors, keeping, self.seed)
            found, _ = optimize(found, coarse, iterations=self.effort.drawing, notify=steps.begin(self.effort.drawing))
        found, chosen = discretize(found, coarse, colors, self.seed)
        found, paints = optimize(
            found, coarse, iterations=self.effort.binding, paints=chosen, notify=steps.begin(self.effort.binding)
        )
        found, paints = optimize(
            found,
            fine,
            iterations=self.effort.polishing,
            paints=paints,
            pace=_POLISHING_PACE,
            notify=steps.begin(self.effort.polishing),
        )
        assert paints is not None
        ordered, palette, paint = as_palette(found, paints)
        return self._as_plan(ordered, palette, paint)

    def bind_to_palette(
        self, plan: Plan, canvas: Tensor, palette: Palette, notify: Callable[[Step], None] | None = None
    ) -> Plan:
        """The plan in the paints of another palette, those that were really mixed.

        Each stroke gets the paint that is nearest to what it was to have, and all of them are polished
        on the picture [3, H, W] of the canvas. The palette keeps its order, which is that of the wells.
        """
        paints = Paints(palette.color.to(self.device), palette.nearest(plan.strokes.color).to(self.device))
        steps = _Progress(notify or _unheard, self.effort.polishing)
        found, chosen = optimize(
            plan.strokes.to(self.device),
            self._scene(canvas, self.fine),
            iterations=self.effort.polishing,
            paints=paints,
            vary_colors=False,
            pace=_POLISHING_PACE,
            notify=steps.begin(self.effort.polishing),
        )
        assert chosen is not None
        return self._as_plan(found, palette, chosen.paint)

    def replan(self, rest: Plan, canvas: Tensor, notify: Callable[[Step], None] | None = None, rounds: int = 1) -> Plan:
        """The strokes of `rest` planned again on a photograph [3, H, W] of the canvas; their palette stays.

        The work is in proportion to the number of strokes that are left, and to `rounds`, of which more
        than one are worth it where the goal has changed; where there is not memory enough for it, it is
        tried once more at half the resolution, without moving strokes far. Where that fails as well, the
        optimiser diverges, or finds nothing better, `rest` stays as it is, but for strokes that would
        touch the region.
        """
        rest = self._clear(rest)
        if len(rest) == 0:
            return rest
        for sparing in (False, True):
            try:
                again = rest
                for number in range(rounds):
                    told = _part(notify or _unheard, number, rounds)
                    again = self._again(again, canvas, told, sparing=sparing) if len(again) else again
                return min((rest, again), key=lambda plan: self.validation_loss(self.expected(plan, canvas)))
            except PlanningDiverged:
                return rest
            except (MemoryError, RuntimeError) as failure:
                if not is_lack_of_memory(failure):
                    raise
        return rest

    def _again(self, rest: Plan, canvas: Tensor, notify: Callable[[Step], None], *, sparing: bool) -> Plan:
        generator = torch.Generator().manual_seed(self.seed + len(rest))
        coarse, fine = self._scene(canvas, self.coarse), self._scene(canvas, self.fine)
        steps = _Progress(notify, self.effort.refining + self.effort.replanning)
        # Never back to a lighter paint: it would pick up the dark paint that is still wet.
        first = int(rest.paint.min())
        paints: Paints | None = Paints(rest.palette.color.to(self.device), rest.paint.to(self.device), first)
        found = rest.strokes.to(self.device)
        # Elsewhere than with pictures and what they mean, the guide is only what the plan began with.
        guided = self.goal.initial_terms is self.goal.terms or coarse.importance is not None
        guide = self._guide(coarse) if guided and not sparing else None
        if guide is not None:
            found, paints = relocate(
                found,
                paints,
                coarse,
                guide,
                share=_MOVED,
                proposals=_PROPOSALS,
                generator=generator,
            )
        last = coarse if sparing else fine
        for scene, iterations in ((coarse, self.effort.refining), (last, self.effort.replanning)):
            found, paints = optimize(
                found, scene, iterations=iterations, paints=paints, vary_colors=False, notify=steps.begin(iterations)
            )
        assert paints is not None
        return self._as_plan(found, rest.palette, paints.paint)

    def towards(self, goal: Goal) -> "Planner":
        """A planner for another goal, everything else being the same."""
        planner = Planner(
            goal,
            self.size,
            self.model,
            rows=self.fine.rows,
            effort=self.effort,
            seed=self.seed,
            encoders=self.encoders,
            device=self.device,
        )
        planner.region = self.region
        return planner

    def locate(self, painted: Plan, known: Placement, before: Tensor, seen: Tensor) -> Placement:
        """Where strokes really land, from those just painted and the canvas [3, H, W] before and after them."""
        scene = self._scene(before, self.coarse)
        fitted = images.fit(seen.to(self.device), *scene.canvas.shape[1:])
        return locate(painted.strokes.to(self.device), known, scene, fitted)

    def expected(self, plan: Plan, canvas: Tensor | None = None) -> Tensor:
        """The canvas [3, H, W], by default a bare one, as it would look after the plan."""
        canvas = self.bare if canvas is None else canvas
        with torch.no_grad():
            return self._scene(canvas, self.fine).render(plan.strokes.to(self.device)).cpu()

    def validation_loss(self, picture: Tensor) -> float:
        """The distance of a picture [3, H, W] of the canvas to the goal, by the validation objective if any."""
        with torch.no_grad():
            objective = self._objectives[self.fine]
            seen = images.fit(picture.to(self.device), self.fine.rows, self.fine.columns)
            return float((objective.validation or objective)(seen))

    def _as_plan(self, strokes: Strokes, palette: Palette, paint: Tensor) -> Plan:
        limits = self.model.limits.within(self.size)
        strokes, palette = strokes.project(limits, self.size).to("cpu"), Palette(palette.color.cpu())
        return self._clear(
            Plan.of(strokes, palette, paint.cpu(), canvas=self.size, brush=self.model.brush, limits=limits)
        )

    def _clear(self, plan: Plan) -> Plan:
        """The plan without a stroke that touches the region; each is moved out of it where it can be."""
        if self.region is None or len(plan) == 0:
            return plan
        near = plan.strokes.to(self.device)
        strokes, kept = self.region.keep_clear(near, self._model, self.size, self.fine.rows)
        return replace(plan, strokes=strokes.to("cpu"), paint=plan.paint[kept])

    def _scene(self, canvas: Tensor, grid: PixelGrid, objective: WeightedObjective | None = None) -> Scene:
        objective = objective or self._objectives[grid]
        bare = images.fit(canvas.to(self.device), grid.rows, grid.columns)
        scene = Scene(bare, self.size, self._model, objective, objective.validation, self._importance(grid))
        return scene if self.region is None else self.region.guarded(scene)

    def _guide(self, scene: Scene) -> Tensor | None:
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

    def _growing(self, strokes: int) -> int:
        return min(self.effort.growth.rounds, strokes) * self.effort.growth.settling

    def iterations(self, strokes: int) -> int:
        """How many iterations a plan of so many strokes takes."""
        return (
            self._growing(strokes)
            + self.effort.relocations * self.effort.refining
            + len(_KEEPING) * self.effort.drawing
            + self.effort.binding
            + self.effort.polishing
        )


def _usual_size(goal: Goal) -> CanvasSize:
    """The largest canvas in the proportions of the goal's first picture within 14 x 11 inches, or within 11 x 14."""
    size = CanvasSize.parse("14x11in")
    pictures = [term.guide for term in goal.initial_terms if term.guide is not None]
    if not pictures:
        return size
    shape = pictures[0].shape[1:]
    return size.turned_like(*shape).shaped_like(*shape)


def _unheard(step: Step) -> None:
    """Where nobody listens."""


def _part(notify: Callable[[Step], None], number: int, of: int) -> Callable[[Step], None]:
    """Where the steps of the round of that number, of so many, are to be reported."""
    return lambda step: notify(replace(step, iteration=number * step.of + step.iteration, of=of * step.of))


def _on(model: StrokeModel, device: torch.device) -> StrokeModel:
    """The model on a device: a copy of it where that is another than the CPU, on which others draw with it."""
    return copy.deepcopy(model).to(device) if device.type != "cpu" and isinstance(model, nn.Module) else model


class _Progress:
    """Adds the iterations of several optimisations up to one count."""

    def __init__(self, notify: Callable[[Step], None], total: int) -> None:
        self._notify = notify
        self._total = total
        self._done = 0

    def begin(self, iterations: int) -> Callable[[Step], None]:
        """Where the next `iterations` steps are to be reported."""
        before = self._done
        self._done += iterations

        def tell(step: Step) -> None:
            strokes = None if step.strokes is None else step.strokes.to("cpu")
            self._notify(replace(step, iteration=before + step.iteration, of=self._total, strokes=strokes))

        return tell
