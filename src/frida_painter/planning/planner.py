"""The planner: a goal and a canvas become a plan, and what is left of a plan is planned again from a photograph."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.brush.table_cache import cached_table
from frida_painter.brush.weights import load_stroke_model
from frida_painter.errors import ConfigError, PlanningDiverged
from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.goal import Goal
from frida_painter.objectives.brushwork import flow_of
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.interpretation import WeightedObjective, interpreted, prepare
from frida_painter.objectives.replication import spread
from frida_painter.palette import Palette
from frida_painter.plan import WHITE, Plan
from frida_painter.planning.binding import binding_iterations, bound
from frida_painter.planning.distinct_paints import without_twins
from frida_painter.planning.effort import Effort as Effort
from frida_painter.planning.forecast import SimilarityForecast, forecast
from frida_painter.planning.initialize import descended, progressive
from frida_painter.planning.layers import layer_sizes, with_layers
from frida_painter.planning.memory import is_lack_of_memory
from frida_painter.planning.optimize import Step, optimize
from frida_painter.planning.placement import Placement, locate
from frida_painter.planning.refine import relocate
from frida_painter.planning.region import Region
from frida_painter.planning.scene import Scene, is_bare, on_device
from frida_painter.planning.step_count import StepCount, at_the_end, part_of, unheard
from frida_painter.planning.variables import Paints, as_palette
from frida_painter.strokes import Strokes

_MOVED = 0.15  # share of the strokes that may move at a time
_POLISHING_PACE = 0.5
_PROPOSALS = 24  # weighed for each stroke that moves
LAYERS = 2
"""Of a plan towards a picture, where nothing else is said."""
_FEWEST_FOR_LAYERS = 100  # strokes


class Planner:
    """Plans strokes of one brush towards one goal on one canvas (paper, Algorithm 1).

    size: of the canvas, such as "14x11in"; by default in the proportions of the goal's first
    picture, within 14 x 11 inches.
    model: what the brush's marks look like, or the name of a brush that comes with the project. rows:
    height of the picture in which is planned; the start is planned at half of it. effort: how
    many iterations are spent, as a factor of the usual number, or one by one. Every random choice comes
    from `seed`. encoders: the networks that the goal is seen through, by default
    those that were fetched. device: where is planned; pictures and plans come and go on the CPU.
    layers: of a plan; None: LAYERS towards a picture in 100 strokes or more, else one.
    region: what strokes keep clear of, from the next plan on; ground: sRGB of the bare canvas.
    Raises WeightsError where the goal needs a network that is missing.
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
        layers: int | None = 1,
    ) -> None:
        self.size = size = goal.usual_canvas if size is None else CanvasSize.of(size)
        self.model = model = cached_table(load_stroke_model(model)) if isinstance(model, str) else model
        self.effort = effort if isinstance(effort, Effort) else Effort().scaled(effort)
        self.fine = PixelGrid.of_height(size, rows)
        self.coarse = PixelGrid.of_height(size, max(rows // 2, 32))
        self.seed = seed
        self.layers = layers
        self.region: Region | None = None
        self.ground = WHITE
        self.encoders = encoders or EncoderRegistry()
        self.device = device or torch.device("cpu")
        self._model = on_device(model, self.device)
        self.goal = goal = interpreted(goal, self.fine, self.encoders, seed)
        near = goal.to(self.device)
        self._objectives = {grid: prepare(near, grid, self.encoders, seed) for grid in (self.fine, self.coarse)}
        self._initial_objective = self._objectives[self.coarse]
        if goal.initial_terms is not goal.terms:
            self._initial_objective = prepare(Goal(near.initial_terms), self.coarse, self.encoders, seed)

    @property
    def bare(self) -> Tensor:
        """A canvas without a stroke on its ground, [3, H, W] of the fine grid."""
        return torch.tensor(self.ground)[:, None, None].repeat(1, self.fine.rows, self.fine.columns)

    def plan(
        self,
        canvas: Tensor | None = None,
        strokes: int = 300,
        colors: int = 12,
        notify: Callable[[Step], None] | None = None,
    ) -> Plan:
        """A plan of `strokes` strokes in at most `colors` paints for a canvas picture [3, H, W], by default a bare one.

        There are fewer paints where more would hardly be told apart. A photograph of a bare canvas is planned on as
        bare: its noise would make another plan. notify: hears of every step. Raises ConfigError where not a stroke or
        not a paint was asked for, and PlanningDiverged where no plan is found.
        """
        if not (strokes >= 1 and colors >= 1):
            raise ConfigError(f"{strokes} strokes in {colors} paints were asked for; give at least 1 of each.")
        if canvas is None or is_bare(images.fit(canvas, self.coarse.rows, self.coarse.columns), self.ground):
            canvas = self.bare
        generator = torch.Generator().manual_seed(self.seed)
        sizes = self.layer_sizes(strokes)
        first, colors = sizes[0], min(colors, sizes[0])
        fine = self._scene(canvas, self.fine)
        steps = StepCount(notify or unheard, self.iterations(strokes))
        found = self._freely(first, canvas, generator, steps)
        found, chosen = bound(
            found,
            self._ways(canvas),
            colors,
            drawing=self.effort.drawing,
            binding=self.effort.binding,
            seed=self.seed,
            steps=steps,
        )
        found, paints = optimize(
            found,
            fine,
            iterations=self.effort.polishing,
            paints=chosen,
            pace=_POLISHING_PACE,
            notify=steps.begin(self.effort.polishing),
        )
        assert paints is not None
        ordered, palette, paint = as_palette(found, without_twins(paints))
        plan = self._as_plan(ordered, palette, paint)
        for count in sizes[1:]:
            plan = plan.under(self._layer(count, self.expected(plan, canvas), palette, generator, steps, [plan]))
        return plan

    def _ways(self, canvas: Tensor) -> list[Scene]:
        """The coarse scene, and others in which what is to be recognised weighs more or less against the rest."""
        return [self._scene(canvas, self.coarse, leaning) for leaning in self._objectives[self.coarse].leanings]

    def _freely(
        self, count: int, canvas: Tensor, generator: torch.Generator, steps: StepCount, below: Sequence[Plan] = ()
    ) -> Strokes:
        """Strokes in colours of their own for a canvas picture [3, H, W], grown and moved to where they gain most.

        below: the plans whose strokes are on the canvas by then.
        """
        scene = self._scene(canvas, self.coarse, self._initial_objective)
        guide = self._guide(scene)
        found, _ = progressive(
            count,
            scene,
            descended(scene) if guide is None else guide,
            paints=None,
            light_to_dark=True,
            growth=self.effort.growth,
            generator=generator,
            notify=steps.begin(self._growing(count), below),
        )
        refining = self.effort.refining
        for _ in range(self.effort.relocations):
            if guide is not None:  # a picture that is only one of many good ones must not pull strokes back to it
                found, _ = relocate(found, None, scene, guide, share=_MOVED, proposals=_PROPOSALS, generator=generator)
            found, _ = optimize(found, scene, iterations=refining, notify=steps.begin(refining, below))
        return found

    def _layer(
        self,
        count: int,
        canvas: Tensor,
        palette: Palette,
        generator: torch.Generator,
        steps: StepCount,
        below: Sequence[Plan] = (),
    ) -> Plan:
        """A layer of `count` strokes, light to dark, in paints that are there, for a canvas picture [3, H, W]."""
        found = self._freely(count, canvas, generator, steps, below)
        paint = palette.nearest(found.color.cpu())
        order = torch.argsort(paint, stable=True)
        found, paint = found[order.to(self.device)], paint[order]
        paints: Paints | None = Paints(palette.color.to(self.device), paint.to(self.device))
        for grid, iterations in ((self.coarse, self.effort.binding), (self.fine, self.effort.replanning)):
            found, paints = optimize(
                found,
                self._scene(canvas, grid),
                iterations=iterations,
                paints=paints,
                vary_colors=False,
                notify=steps.begin(iterations, below),
            )
        assert paints is not None
        return self._as_plan(found, palette, paints.paint)

    def bind_to_palette(
        self, plan: Plan, canvas: Tensor, palette: Palette, notify: Callable[[Step], None] | None = None
    ) -> Plan:
        """The plan in the paints of another palette, those that were really mixed.

        Each stroke gets the paint that is nearest to what it was to have, and all of them are polished
        on the picture [3, H, W] of the canvas. The palette keeps its order, which is that of the wells.
        """
        parts = [part for part in plan.by_layer() if len(part)]
        steps = StepCount(notify or unheard, self.effort.polishing * len(parts))
        done: list[Plan] = []
        below = canvas
        for part in parts:
            paint = palette.nearest(part.strokes.color).to(self.device)
            found, chosen = optimize(
                part.strokes.to(self.device),
                self._scene(below, self.fine),
                iterations=self.effort.polishing,
                paints=Paints(palette.color.to(self.device), paint),
                vary_colors=False,
                pace=_POLISHING_PACE,
                notify=steps.begin(self.effort.polishing, done),
            )
            assert chosen is not None
            done.append(self._as_plan(found, palette, chosen.paint))
            below = self.expected(done[-1], below)
        return with_layers(plan, done) if done else plan

    def replan(
        self,
        rest: Plan,
        canvas: Tensor,
        notify: Callable[[Step], None] | None = None,
        rounds: int = 1,
        *,
        fresh: bool = False,
    ) -> Plan:
        """The strokes of `rest` planned again on a photograph [3, H, W] of the canvas; their palette stays.

        Later layers than that of the next stroke stay as they are until their turn comes, unless the goal has changed.
        fresh: whether a layer begins now, of which nothing was painted: its strokes are grown anew.
        The work is in proportion to the number of strokes that are left, and to `rounds`, of which more
        than one are worth it where the goal has changed; where there is not memory enough for it, it is
        tried once more at half the resolution, without moving strokes far. Where nothing better is found, it is
        tried once more with every stroke about where it was. Where that fails as well, or the optimiser diverges,
        `rest` stays as it is, but for strokes that would touch the region.
        """
        rest = self._clear(rest)
        if len(rest) == 0:
            return rest
        hear, end = notify or unheard, rest.layer_end(0) if rounds == 1 else len(rest)
        now, later = rest.part(slice(end)), rest.part(slice(end, None))
        for sparing in (False, True):
            try:
                loss = self.expected_loss(now, canvas)
                for moving in (True, False):
                    again = now
                    for number in range(rounds):
                        told = part_of(hear, number, rounds) if moving else at_the_end(hear)
                        starts = fresh and number == 0
                        again = self._again(again, canvas, told, moving=moving, sparing=sparing, fresh=starts)
                    if self.expected_loss(again, canvas) < loss:
                        return again.followed_by(later)
                return rest
            except PlanningDiverged:
                return rest
            except (MemoryError, RuntimeError) as failure:
                if not is_lack_of_memory(failure):
                    raise
        return rest

    def _again(
        self, rest: Plan, canvas: Tensor, notify: Callable[[Step], None], *, moving: bool, sparing: bool, fresh: bool
    ) -> Plan:
        """All layers of the rest, each on the picture of what will lie below it."""
        generator = torch.Generator().manual_seed(self.seed + len(rest))
        settling = self.effort.refining + self.effort.replanning
        parts = [part for part in rest.by_layer() if len(part)]
        anew = fresh and moving and not sparing
        begun = self._layer_iterations(len(parts[0])) if anew else settling
        steps = StepCount(notify, begun + settling * (len(parts) - 1))
        # Never back to a lighter paint inside a layer: it would pick up the dark paint that is still wet.
        lightest = 0 if fresh else int(parts[0].paint.min())
        done: list[Plan] = []
        below = canvas
        for number, part in enumerate(parts):
            if anew and number == 0:
                part = self._layer(len(part), below, part.palette, generator, steps)
            else:
                notice = steps.begin(settling, done)
                first = lightest if number == 0 else 0
                part = self._settled(part, below, first, generator, notice, moving=moving, sparing=sparing)
            below = self.expected(part, below)
            done.append(part)
        return with_layers(rest, done)

    def _settled(
        self,
        layer: Plan,
        canvas: Tensor,
        first: int,
        generator: torch.Generator,
        notify: Callable[[Step], None],
        *,
        moving: bool,
        sparing: bool,
    ) -> Plan:
        """One layer planned again, in paints from number `first` on."""
        coarse, fine = self._scene(canvas, self.coarse), self._scene(canvas, self.fine)
        steps = StepCount(notify, self.effort.refining + self.effort.replanning)
        paints: Paints | None = Paints(layer.palette.color.to(self.device), layer.paint.to(self.device), first)
        found = layer.strokes.to(self.device)
        # Elsewhere than with pictures and what they mean, the guide is only what the plan began with.
        guided = self.goal.initial_terms is self.goal.terms or coarse.importance is not None
        guide = self._guide(coarse) if guided and moving and not sparing else None
        if guide is not None:
            found, paints = relocate(
                found, paints, coarse, guide, share=_MOVED, proposals=_PROPOSALS, generator=generator
            )
        last = coarse if sparing else fine
        for scene, iterations in ((coarse, self.effort.refining), (last, self.effort.replanning)):
            found, paints = optimize(
                found, scene, iterations=iterations, paints=paints, vary_colors=False, notify=steps.begin(iterations)
            )
        assert paints is not None
        return self._as_plan(found, layer.palette, paints.paint)

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
            layers=self.layers,
        )
        planner.region, planner.ground = self.region, self.ground
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

    def expected_loss(self, plan: Plan, canvas: Tensor) -> float:
        """The distance to the goal that paintings of the plan on a canvas [3, H, W] have on average."""
        scene = self._scene(canvas, self.fine)
        with torch.no_grad():
            return float(scene.expected_loss(plan.strokes.to(self.device), scene.validation))

    def forecast(
        self, plan: Plan, canvas: Tensor, placement: Placement | None = None, unseen: int = 0
    ) -> SimilarityForecast | None:
        """How near the plan's painting on a canvas [3, H, W] will come to its photograph; as forecast.py says."""
        return forecast(self.goal, plan.strokes.to(self.device), self._scene(canvas, self.fine), placement, unseen)

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
            Plan.of(
                strokes,
                palette,
                paint.cpu(),
                canvas=self.size,
                brush=self.model.brush,
                limits=limits,
                ground=self.ground,
            )
        )

    def _clear(self, plan: Plan) -> Plan:
        """The plan without a stroke that touches the region; each is moved out of it where it can be."""
        if self.region is None or len(plan) == 0:
            return plan
        near = plan.strokes.to(self.device)
        strokes, kept = self.region.keep_clear(near, self._model, self.size, self.fine.rows)
        layers = torch.bincount(plan.layer[kept], minlength=len(plan.layers))
        return replace(plan, strokes=strokes.to("cpu"), paint=plan.paint[kept], layers=tuple(layers.tolist()))

    def _scene(self, canvas: Tensor, grid: PixelGrid, objective: WeightedObjective | None = None) -> Scene:
        objective = objective or self._objectives[grid]
        bare = images.fit(canvas.to(self.device), grid.rows, grid.columns)
        matters, way = self._importance(grid), flow_of(self.goal, grid)
        scene = Scene(bare, self.size, self._model, objective, objective.validation, matters, way)
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

    def layer_sizes(self, strokes: int) -> tuple[int, ...]:
        """How many of so many strokes each layer of a plan gets. Raises ConfigError where there are too few."""
        pictures = any(term.guide is not None for term in self.goal.initial_terms)
        usual = LAYERS if pictures and strokes >= _FEWEST_FOR_LAYERS else 1
        return layer_sizes(strokes, usual if self.layers is None else self.layers)

    def iterations(self, strokes: int) -> int:
        """How many iterations a plan of so many strokes takes."""
        first, *later = self.layer_sizes(strokes)
        return (
            self._free_iterations(first)
            + binding_iterations(self.effort.drawing, self.effort.binding, len(self._objectives[self.coarse].leanings))
            + self.effort.polishing
            + sum(map(self._layer_iterations, later))
        )

    def _free_iterations(self, strokes: int) -> int:
        return self._growing(strokes) + self.effort.relocations * self.effort.refining

    def _layer_iterations(self, strokes: int) -> int:
        """How many iterations a layer of so many strokes takes in paints that are there."""
        return self._free_iterations(strokes) + self.effort.binding + self.effort.replanning
