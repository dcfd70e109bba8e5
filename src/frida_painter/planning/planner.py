"""The planner: a goal and a canvas become a plan, and what is left of a plan is planned again from a photograph."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.errors import ConfigError, PlanningDiverged
from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.goal import Goal
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.interpretation import interpreted, prepare
from frida_painter.palette import Palette
from frida_painter.plan import WHITE, Plan
from frida_painter.planning.binding import binding_iterations, bound
from frida_painter.planning.distinct_paints import HARDLY_APART, without_twins
from frida_painter.planning.effort import Effort as Effort
from frida_painter.planning.forecast import SimilarityForecast, forecast
from frida_painter.planning.free_strokes import MOVED, PROPOSALS, free_strokes
from frida_painter.planning.layers import layer_sizes, stroke_models, usual_layers, usual_shares
from frida_painter.planning.memory import is_lack_of_memory
from frida_painter.planning.optimize import Step, optimize
from frida_painter.planning.placement import Placement, locate
from frida_painter.planning.refine import relocate
from frida_painter.planning.region import Region
from frida_painter.planning.scene import is_bare, on_device
from frida_painter.planning.scenes import Scenes
from frida_painter.planning.stack import stacked_loss, stacked_worth
from frida_painter.planning.step_count import StepCount, at_the_end, part_of, unheard
from frida_painter.planning.variables import Paints, as_palette
from frida_painter.strokes import Strokes

_POLISHING_PACE = 0.5


class Planner:
    """Plans strokes towards one goal on one canvas (paper, Algorithm 1).

    size: of the canvas, such as "14x11in"; by default in the proportions of the goal's first
    picture, within 14 x 11 inches.
    model: what the brush's marks look like, or the name of a brush that comes with the project; several, of different
    brushes or the same, paint a layer each. rows: height of the picture in which is planned; the start is planned at
    half of it. effort: how many iterations are spent, as a factor of the usual number, or one by one. Every random
    choice comes from `seed`. encoders: the networks that the goal is seen through, by default
    those that were fetched. device: where is planned; pictures and plans come and go on the CPU.
    layers: of a plan, one for each of several models; None: that many, or LAYERS of one model, towards a picture in 100
    strokes or more, else one, of the first model. shares: of the strokes that each layer gets, by default as
    planning/layers.py says. new_paints: whether each layer has a palette of its own. ground: sRGB of the bare canvas.
    Raises WeightsError where the goal needs a network that is missing, and ConfigError where layers, models and shares
    are not as many.
    """

    def __init__(
        self,
        goal: Goal,
        size: CanvasSize | str | None = None,
        model: StrokeModel | str | Sequence[StrokeModel | str] = "broad",
        *,
        rows: int = 256,
        effort: Effort | float = 1.0,
        seed: int = 0,
        encoders: EncoderRegistry | None = None,
        device: torch.device | None = None,
        layers: int | None = 1,
        shares: Sequence[float] | None = None,
        new_paints: bool = False,
    ) -> None:
        self.size = size = goal.usual_canvas if size is None else CanvasSize.of(size)
        models = stroke_models(model)
        self.models: Mapping[str, StrokeModel] = {one.brush: one for one in models}
        self.brushes = tuple(one.brush for one in models)  # of each layer, or the one of all layers
        if len(models) > 1 and layers not in (None, 1, len(models)):
            raise ConfigError(f"{layers} layers and {len(models)} brushes were given; give one brush for each layer.")
        if shares is not None and len(shares) != (len(models) if len(models) > 1 else layers or 1):
            raise ConfigError(f"{len(shares)} shares of the strokes were given; give one for each layer.")
        self.effort = effort if isinstance(effort, Effort) else Effort().scaled(effort)
        self.fine = PixelGrid.of_height(size, rows)
        self.coarse = PixelGrid.of_height(size, max(rows // 2, 32))
        self.seed = seed
        self.ground = WHITE
        self.layers = len(models) if len(models) > 1 and layers == 1 else layers
        self.shares, self.new_paints = shares, new_paints
        self.encoders = encoders or EncoderRegistry()
        self.device = device or torch.device("cpu")
        self.goal = goal = interpreted(goal, self.fine, self.encoders, seed)
        near, grids = goal.to(self.device), (self.fine, self.coarse)
        initial = (
            prepare(Goal(near.initial_terms), self.coarse, self.encoders, seed)
            if goal.initial_terms is not goal.terms
            else None
        )
        self.scenes = Scenes(
            size=size,
            models={name: on_device(one, self.device) for name, one in self.models.items()},
            goal=goal,
            objectives={grid: prepare(near, grid, self.encoders, seed) for grid in grids},
            initial_objective=initial,
            device=self.device,
        )

    @property
    def region(self) -> Region | None:
        """What strokes keep clear of, from the next plan on."""
        return self.scenes.region

    @region.setter
    def region(self, region: Region | None) -> None:
        self.scenes.region = region

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
        steps = StepCount(notify or unheard, self.iterations(strokes))
        plan: Plan | None = None
        parts: list[Plan] = []
        for count, brush in zip(self.layer_sizes(strokes), self.layer_brushes(strokes), strict=True):
            if plan is None:
                plan = part = self._layer(
                    count, brush, canvas, min(colors, count), self.effort.polishing, generator, steps
                )
            else:
                paints = min(colors, count) if self.new_paints else plan.wells(plan.layers[0])
                below, last = self.expected(plan, canvas), self.effort.replanning
                part = self._layer(count, brush, below, paints, last, generator, steps, tuple(parts))
                plan = plan.under(part)
            parts.append(part)
        assert plan is not None
        return plan

    def _layer(
        self,
        count: int,
        brush: str,
        canvas: Tensor,
        wells: Palette | int,
        polishing: int,
        generator: torch.Generator,
        steps: StepCount,
        below: Sequence[Plan] = (),
    ) -> Plan:
        """A layer of `count` strokes, light to dark, for a canvas picture [3, H, W].

        wells: the paints that are there, or how many are to be mixed for it; polishing: last steps at full resolution.
        """
        effort, mixes = self.effort, isinstance(wells, int)

        def begin(iterations: int) -> Callable[[Step], None]:
            return steps.begin(iterations, brush, below)

        scene = self.scenes.initial(canvas, self.coarse, brush)
        found = free_strokes(count, scene, self.scenes.guide(scene), effort, generator, begin)
        paints: Paints | None
        if isinstance(wells, int):
            times = {"drawing": effort.drawing, "binding": effort.binding}
            found, paints = bound(
                found, self.scenes.of(canvas, self.coarse, brush), wells, **times, seed=self.seed, begin=begin
            )
        else:
            paint = wells.nearest(found.color.cpu())
            order = torch.argsort(paint, stable=True)
            found, paint = found[order.to(self.device)], paint[order]
            found, paints = optimize(
                found,
                self.scenes.of(canvas, self.coarse, brush),
                iterations=effort.binding,
                paints=Paints(wells.color.to(self.device), paint.to(self.device)),
                vary_colors=False,
                notify=begin(effort.binding),
            )
        found, paints = optimize(
            found,
            self.scenes.of(canvas, self.fine, brush),
            iterations=polishing,
            paints=paints,
            vary_colors=mixes,
            pace=_POLISHING_PACE if mixes else 1.0,
            notify=begin(polishing),
        )
        assert paints is not None
        if isinstance(wells, Palette):
            return self._as_plan(found, wells, paints.paint, brush)
        return self._as_plan(*as_palette(found, without_twins(paints, HARDLY_APART)), brush)

    def without_weakest(self, plan: Plan, canvas: Tensor, count: int) -> Plan:
        """The plan without the `count` strokes that would be missed least on a picture [3, H, W] of the canvas."""
        strokes, scenes = self.scenes.stack(plan, canvas, self.coarse)
        missed = stacked_worth(strokes, scenes, self.scenes.guide(scenes[0]), self.seed)
        kept = torch.argsort(missed.cpu(), descending=True)[: len(plan) - count]
        return plan.part(kept.sort().values.tolist())

    def bind_to_palette(
        self, plan: Plan, canvas: Tensor, palette: Palette, notify: Callable[[Step], None] | None = None
    ) -> Plan:
        """The plan in the paints of another palette, those that were really mixed.

        They are in the wells for the next stroke's layer, and stay there for those that follow without new paints.
        Each stroke gets the paint that is nearest to what it was to have, and all of them are polished
        on the picture [3, H, W] of the canvas. The palette keeps its order, which is that of the wells.
        """
        parts = plan.filled_layers()
        if not parts:
            return plan
        steps = StepCount(notify or unheard, self.effort.polishing * len(parts))
        wells = parts[0].palette
        done: list[Plan] = []
        below = canvas
        for part in parts:
            if torch.equal(part.palette.color, wells.color):
                brush = part.layers[0].brush
                paint = palette.nearest(part.strokes.color).to(self.device)
                found, chosen = optimize(
                    part.strokes.to(self.device),
                    self.scenes.of(below, self.fine, brush),
                    iterations=self.effort.polishing,
                    paints=Paints(palette.color.to(self.device), paint),
                    vary_colors=False,
                    pace=_POLISHING_PACE,
                    notify=steps.begin(self.effort.polishing, brush, done),
                )
                assert chosen is not None
                part = self._as_plan(found, palette, chosen.paint, brush)
            done.append(part)
            below = self.expected(part, below)
        return plan.with_parts(done)

    def replan(
        self,
        rest: Plan,
        canvas: Tensor,
        notify: Callable[[Step], None] | None = None,
        rounds: int = 1,
        *,
        fresh: bool = False,
    ) -> Plan:
        """The strokes of `rest` planned again on a photograph [3, H, W] of the canvas; their brushes and paints stay.

        Later layers than that of the next stroke stay as they are until their turn comes, unless the goal has changed.
        fresh: whether a layer begins now, of which nothing was painted: its strokes are grown anew, and so are its
        paints where it has new ones.
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
                cost = self.expected_loss(now, canvas, priced=True)
                for moving in (True, False):
                    again = now
                    for number in range(rounds):
                        told = part_of(hear, number, rounds) if moving else at_the_end(hear)
                        starts = fresh and number == 0
                        again = self._again(again, canvas, told, moving=moving, sparing=sparing, fresh=starts)
                    if self.expected_loss(again, canvas, priced=True) < cost:
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
        parts = rest.filled_layers()
        anew = fresh and moving and not sparing
        mixes = anew and self._mixes(rest)
        begun = self._layer_iterations(len(parts[0]), mixes=mixes) if anew else settling
        steps = StepCount(notify, begun + settling * (len(parts) - 1))
        # Never back to a lighter paint inside a layer: it would pick up the dark paint that is still wet.
        lightest = 0 if fresh else int(parts[0].paint.min())
        done: list[Plan] = []
        below = canvas
        for number, part in enumerate(parts):
            if anew and number == 0:
                wells = len(part.palette) if mixes else part.palette
                part = self._layer(
                    len(part), part.layers[0].brush, below, wells, self.effort.replanning, generator, steps
                )
            else:
                notice = steps.begin(settling, part.layers[0].brush, done)
                first = lightest if number == 0 else 0
                part = self._settled(part, below, first, generator, notice, moving=moving, sparing=sparing)
            below = self.expected(part, below)
            done.append(part)
        return rest.with_parts(done)

    def _mixes(self, rest: Plan) -> bool:
        """Whether new paints are mixed for the layer of the next stroke."""
        number = int(rest.layer[0])
        return self.new_paints and number > 0 and rest.layers[number].paints != rest.layers[number - 1].paints

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
        brush = layer.layers[0].brush
        coarse, fine = (self.scenes.of(canvas, grid, brush) for grid in (self.coarse, self.fine))
        steps = StepCount(notify, self.effort.refining + self.effort.replanning)
        paints: Paints | None = Paints(layer.palette.color.to(self.device), layer.paint.to(self.device), first)
        found = layer.strokes.to(self.device)
        # Elsewhere than with pictures and what they mean, the guide is only what the plan began with.
        guided = self.goal.initial_terms is self.goal.terms or coarse.importance is not None
        guide = self.scenes.guide(coarse) if guided and moving and not sparing else None
        if guide is not None:
            found, paints = relocate(
                found, paints, coarse, guide, share=MOVED, proposals=PROPOSALS, generator=generator
            )
        last = coarse if sparing else fine
        for scene, iterations in ((coarse, self.effort.refining), (last, self.effort.replanning)):
            told = steps.begin(iterations, brush)
            found, paints = optimize(found, scene, iterations=iterations, paints=paints, vary_colors=False, notify=told)
        assert paints is not None
        return self._as_plan(found, layer.palette, paints.paint, brush)

    def towards(self, goal: Goal) -> "Planner":
        """A planner for another goal, everything else being the same."""
        planner = Planner(
            goal,
            self.size,
            [self.models[brush] for brush in self.brushes],
            rows=self.fine.rows,
            effort=self.effort,
            seed=self.seed,
            encoders=self.encoders,
            device=self.device,
            layers=self.layers,
            shares=self.shares,
            new_paints=self.new_paints,
        )
        planner.region, planner.ground = self.region, self.ground
        return planner

    def locate(self, painted: Plan, known: Placement, before: Tensor, seen: Tensor) -> Placement:
        """Where strokes really land, from those just painted and the canvas [3, H, W] before and after them.

        Of several layers that were painted without a look, the last one tells.
        """
        *lower, last = painted.filled_layers()
        for part in lower:
            before = self.expected(part, before)
        scene = self.scenes.of(before, self.coarse, last.layers[0].brush)
        fitted = images.fit(seen.to(self.device), *scene.canvas.shape[1:])
        return locate(last.strokes.to(self.device), known, scene, fitted)

    def expected(self, plan: Plan, canvas: Tensor | None = None) -> Tensor:
        """The canvas [3, H, W], by default a bare one, as it would look after the plan."""
        picture = self.bare if canvas is None else canvas
        with torch.no_grad():
            for brush, strokes in plan.by_brush():
                picture = self.scenes.of(picture, self.fine, brush).render(strokes.to(self.device))
        return images.fit(picture, self.fine.rows, self.fine.columns).cpu()

    def expected_loss(self, plan: Plan, canvas: Tensor, *, priced: bool = False) -> float:
        """The distance to the goal that paintings of the plan on a canvas [3, H, W] have on average, or their cost."""
        with torch.no_grad():
            return float(stacked_loss(*self.scenes.stack(plan, canvas, self.fine), priced=priced))

    def forecast(
        self, plan: Plan, canvas: Tensor, placement: Placement | None = None, unseen: int = 0
    ) -> SimilarityForecast | None:
        """How near the plan's painting on a canvas [3, H, W] will come to its photograph; as forecast.py says."""
        return forecast(self.goal, *self.scenes.stack(plan, canvas, self.fine), placement, unseen)

    def validation_loss(self, picture: Tensor) -> float:
        """The distance of a picture [3, H, W] of the canvas to the goal, by the validation objective if any."""
        with torch.no_grad():
            objective = self.scenes.objectives[self.fine]
            seen = images.fit(picture.to(self.device), self.fine.rows, self.fine.columns)
            return float((objective.validation or objective)(seen))

    def _as_plan(self, strokes: Strokes, palette: Palette, paint: Tensor, brush: str) -> Plan:
        limits = self.models[brush].limits.within(self.size)
        strokes, palette = strokes.project(limits, self.size).to("cpu"), Palette(palette.color.cpu())
        facts: dict[str, Any] = {"canvas": self.size, "brush": brush, "limits": limits, "ground": self.ground}
        return self._clear(Plan.of(strokes, palette, paint.cpu(), **facts))

    def _clear(self, plan: Plan) -> Plan:
        """The plan without a stroke that touches the region; each is moved out of it where it can be."""
        if self.region is None or len(plan) == 0:
            return plan
        return self.region.cleared(plan, self.scenes.models, self.fine.rows, self.device)

    def layer_sizes(self, strokes: int) -> tuple[int, ...]:
        """How many of so many strokes each layer of a plan gets. Raises ConfigError where there are too few."""
        layers = self.layers
        if layers is None:
            pictures = any(term.guide is not None for term in self.goal.initial_terms)
            layers = usual_layers(strokes, len(self.brushes)) if pictures else 1
        shares = self.shares if self.shares is not None and len(self.shares) == layers else usual_shares(layers)
        return layer_sizes(strokes, shares)

    def layer_brushes(self, strokes: int) -> tuple[str, ...]:
        """The brush of each layer of a plan of so many strokes."""
        layers = len(self.layer_sizes(strokes))
        return self.brushes[:layers] if len(self.brushes) > 1 else self.brushes * layers

    def iterations(self, strokes: int) -> int:
        """How many iterations a plan of so many strokes takes."""
        first, *later = self.layer_sizes(strokes)
        begun = self._layer_iterations(first, mixes=True) - self.effort.replanning + self.effort.polishing
        return begun + sum(self._layer_iterations(count, mixes=self.new_paints) for count in later)

    def _layer_iterations(self, strokes: int, *, mixes: bool) -> int:
        """How many iterations a later layer of so many strokes takes, in new paints or in those that are there."""
        effort = self.effort
        settled = binding_iterations(effort.drawing, effort.binding) if mixes else effort.binding
        return effort.free_iterations(strokes) + settled + effort.replanning
