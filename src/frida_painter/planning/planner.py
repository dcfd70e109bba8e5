"""Planner: makes a plan for a goal and a canvas, and replans the rest of a plan from a photograph."""

import copy
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import torch
from torch import Tensor

from frida_painter import registry
from frida_painter.brush.kinds import StrokeModel, kind_of, mark_width
from frida_painter.brush.weights import weights_of
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, FridaError, PluginError
from frida_painter.frames import PixelGrid
from frida_painter.objectives.attention import weight_by_focus
from frida_painter.objectives.drawing import draws, with_bold_lines
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.interpretation import interpret_goal, prepare
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.style_flow import brushwork_of
from frida_painter.planning.effort import Effort
from frida_painter.planning.fields import FACES, focus_places
from frida_painter.planning.forecast import Fading, SimilarityForecast, fading_of, forecast
from frida_painter.planning.initialize import optimize_target, progressive
from frida_painter.planning.layers import LayerAtWork, Moves, StepCount, at_the_end, find_later_mixing, relocate_strokes
from frida_painter.planning.materials import Materials
from frida_painter.planning.mixable import MIXED_PAINTS, MixablePalette, make_mixable
from frida_painter.planning.optimize import (
    PictureChange,
    Step,
    StrokesInScene,
    optimize,
    optimize_together,
    shift_objective,
    stacked_cost,
    stacked_loss,
)
from frida_painter.planning.placement import Placement, learn
from frida_painter.planning.problem import FailureTolerance, PlanningProblems, Region, is_bare, on_device
from frida_painter.planning.refine import HARDLY_APART, MOVED, MOVED_WHERE_A_LAYER_BEGINS, bind_to_palette, relocate
from frida_painter.planning.settings import PlannerSettings, layer_sizes, usual_layers, usual_shares
from frida_painter.planning.variables import Paints, as_palette
from frida_painter.planning.wet_paint import Wetness
from frida_painter.strokes.palette import MAX_COLORS, AnyColor, Palette, as_color, to_lab
from frida_painter.strokes.plan import Plan
from frida_painter.system import images
from frida_painter.system.images import AnyPicture, as_picture
from frida_painter.system.provenance import describe_here, hash_code, identify

_NO_MOVES = Moves()
_POLISHING_PACE = 0.5
_FINE, _LINE = 0.0105, 0.3  # metres, widest mark of a brush that draws; least width of a drawn line, as a share of it
_DRAWN = (
    "The picture is a drawing, so its lines are painted with the fine brush; --brushes broad,medium,fine changes that."
)
_NOT_DRAWN = "The picture is a drawing; --brushes fine paints its lines in full colour."
_ROUNDS_WHERE_A_LAYER_BEGINS = 3  # at least, unless the effort has fewer


class Planner:
    """Plans strokes towards one goal on one canvas (paper, Algorithm 1); a planner does not change.

    settings: what a person set; a RunSpec as well.
    materials: brushes, paints, ground and layers. None: those that the settings name.
    effort: numbers of iterations. None: the usual ones, times the effort of the settings.
    encoders: networks that judge the goal. None: the fetched ones.
    device: device for planning. Arguments and results are on the CPU.
    In its methods `canvas` is a picture [3, H, W] of the canvas, and `notify` is called after every step.
    Raises WeightsError if a network for the goal is missing, and the errors of `Materials.of`.

        >>> import frida_painter as fp
        >>> small = {"canvas": "12x9cm", "brushes": "fine", "render_height": 64, "focus": "none", "effort": 0.1}
        >>> settings = fp.PlannerSettings.of(strokes=10, colors=3, **small)
        >>> planner = fp.Planner(fp.make_goal("photo.jpg").fit_to(64, 85), settings)
        >>> plan = planner.plan()
        >>> picture = planner.expected(plan)
        >>> len(plan), picture.shape
        (10, torch.Size([3, 64, 85]))
    """

    def __init__(
        self,
        goal: Goal,
        settings: PlannerSettings,
        materials: Materials | None = None,
        effort: Effort | None = None,
        *,
        encoders: EncoderRegistry | None = None,
        device: torch.device | None = None,
    ) -> None:
        self.settings: Final = settings
        self.materials: Final = materials or Materials.of(settings)
        self.size: Final = settings.canvas
        self.models: Final[Mapping[str, StrokeModel]] = {kind_of(one): one for one in self.materials.models}
        self.kinds: Final = tuple(map(kind_of, self.materials.models))  # of each layer, or one for all layers
        spent = effort or Effort().scale(settings.effort)
        self.effort: Final = spent if all(term.is_pixelwise for term in goal.terms) else spent.for_network_objectives()
        find_planner(settings.planner)  # before anything is prepared for it
        self.fine: Final = PixelGrid.of_height(self.size, settings.render_height)
        self.coarse: Final = PixelGrid.of_height(self.size, max(settings.render_height // 2, 32))
        self.encoders: Final = encoders or EncoderRegistry()
        self.device: Final = device or torch.device("cpu")
        seen = weight_by_focus(goal, FACES in settings.focus, focus_places(settings.focus), self.encoders)
        widest = max(map(mark_width, self.models.values()))
        is_drawing = draws(goal)
        self.draws: Final = is_drawing and widest <= _FINE
        if self.draws:
            seen = with_bold_lines(seen, _LINE * widest / min(self.size.width, self.size.height))
        if is_drawing and (self.draws or settings.brushes is None):
            self.encoders.remark(_DRAWN if self.draws else _NOT_DRAWN)
        self.goal: Final = interpret_goal(seen, self.fine, self.encoders, settings.seed)
        near, begins = self.goal.to(self.device), self.goal.initial_terms is not self.goal.terms
        prepared = partial(prepare, encoders=self.encoders, seed=settings.seed, shared={})
        self.problems = PlanningProblems(
            initial_objective=prepared(Goal(near.initial_terms), self.coarse) if begins else None,
            objectives={grid: prepared(near, grid) for grid in (self.fine, self.coarse)},
            brushwork={grid: brushwork_of(self.goal, grid, settings.form) for grid in (self.fine, self.coarse)},
            models={name: on_device(one, self.device) for name, one in self.models.items()},
            goal=self.goal,
            size=self.size,
            device=self.device,
            region=self.materials.region,
            darkest=self.materials.darkest,
        )

    @property
    def seed(self) -> int:
        """Seed of every random choice."""
        return self.settings.seed

    @property
    def ground(self) -> tuple[float, float, float]:
        """sRGB of the bare canvas."""
        return self.materials.ground

    @property
    def region(self) -> Region | None:
        """Part of the canvas that strokes keep clear of."""
        return self.materials.region

    def on_ground(self, ground: AnyColor) -> "Planner":
        """Returns the same planner for a bare canvas of this colour."""
        return self._with(materials=replace(self.materials, ground=as_color(ground)))

    def keeping_clear(self, region: Region | None) -> "Planner":
        """Returns the same planner with this protected region."""
        return self._with(
            materials=replace(self.materials, region=region), problems=replace(self.problems, region=region)
        )

    def _with(self, **changed: Any) -> "Planner":
        """Returns a copy that shares the prepared goal, with other attributes."""
        other = copy.copy(self)
        vars(other).update(changed)
        return other

    @property
    def bare(self) -> Tensor:
        """Picture of the bare canvas, [3, H, W] on the fine grid."""
        return torch.tensor(self.ground)[:, None, None].repeat(1, self.fine.rows, self.fine.columns)

    def plan(
        self,
        canvas: AnyPicture | None = None,
        strokes: int | None = None,
        colors: int | None = None,
        notify: Callable[[Step], None] = lambda step: None,
    ) -> Plan:
        """Plans strokes for a canvas, by the planner of the settings.

        canvas: None: a bare canvas. A photograph of a bare canvas counts as exactly bare; otherwise its noise would
        change the plan.
        strokes: number of strokes. None: that of the settings.
        colors: largest number of paints of a palette. None: that of the settings, or the number of strokes if that
        is smaller.

        The plan has fewer paints if more would hardly be told apart.
        Raises ConfigError if strokes or colors is below 1, if a layer would get no stroke, or if the plan would
        have too many paints. Raises PlanningDiverged if the optimiser finds no plan.
        """
        strokes = self.settings.strokes if strokes is None else strokes
        colors = min(self.settings.colors, max(strokes, 1)) if colors is None else colors
        if not (strokes >= 1 and colors >= 1):
            raise ConfigError(f"{strokes} strokes in {colors} paints were asked for; give at least 1 of each.")
        canvas = self.bare if canvas is None else as_picture(canvas)
        if is_bare(images.fit(canvas, self.coarse.rows, self.coarse.columns), self.ground):
            canvas = self.bare
        made = find_planner(self.settings.planner).make(PlanningTask(self, canvas, strokes, colors, notify))
        # A plan only names its brushes, so their weights are told.
        facts = [("made with", identify(describe_here(self.device.type)))]
        for kind in self.models:
            with suppress(FridaError):  # a model of somebody's own
                hashes = " ".join(hash_code(file) for file in weights_of(kind))
                facts += [(f"weights of {kind}", hashes)] if hashes else []
        return replace(made, about=(*facts, *made.about))

    def _plan_in_layers(self, task: "PlanningTask") -> Plan:
        canvas, strokes, colors, notify = task.canvas, task.strokes, task.colors, task.notify
        sizes = self.layer_sizes(strokes)
        palettes = len(sizes) if self.settings.mixes_anew else 1
        if palettes * colors > MAX_COLORS:
            raise ConfigError(
                f"{colors} paints for each of {palettes} layers were asked for; a plan has at most {MAX_COLORS}: give "
                f"--colors {MAX_COLORS // palettes} or fewer, or --no-new-paints."
            )
        generator = torch.Generator().manual_seed(self.seed)
        steps = StepCount(notify, self.iterations(strokes))
        effort = self.effort.growing_of(len(sizes))
        layers: list[LayerAtWork] = []
        below = canvas
        kinds = self.kinds[: len(sizes)] if len(self.kinds) > 1 else self.kinds * len(sizes)
        for count, brush in zip(sizes, kinds, strict=True):
            wells = layers[0].paints if layers and not self.settings.mixes_anew else min(colors, count)
            if layers:
                with torch.no_grad():
                    below = self.problems.of(below, self.fine, layers[-1].kind).render(layers[-1].strokes).cpu()
            layers.append(self._grow(count, brush, below, wells, effort, generator, steps, layers))
        if len(layers) > 1 and not self.settings.mixes_anew:
            layers = [replace(layer, mixes=False) for layer in layers]
        rounds, last = self.effort.rounds_of(len(layers)), self.effort.polishing
        moves = Moves(rounds, generator)
        parts = self._settle(layers, canvas, steps.begin, last, moves, pace=_POLISHING_PACE)
        mixes = [self.settings.mixes_anew or number == 0 for number in range(len(parts))]
        (first, *later), told = self._make_mixable(parts, range(1, len(parts) + 1), mixes, canvas, notify)
        for part in later:
            first = first.under(part)
        return replace(first, about=told) if told else first

    def _make_mixable(
        self,
        parts: Sequence[Plan],
        numbers: Sequence[int],
        mixes: Sequence[bool],
        canvas: Tensor,
        notify: Callable[[Step], None],
        change: PictureChange | None = None,
    ) -> tuple[list[Plan], tuple[tuple[str, str], ...]]:
        """Returns the layers in paints that can be mixed, and what changed: (filling of the wells, words).

        numbers: number of each layer, from 1.
        mixes: True for each layer whose paints may change; a layer in the paints of the first one follows it.

        A palette that can be mixed stays as it is. If one changes, all layers are settled together once more.
        """
        if self.materials.paints is None:
            return list(parts), ()
        found: dict[tuple[float, ...], MixablePalette] = {}
        told: list[tuple[str, str]] = []
        for part, number, own in zip(parts, numbers, mixes, strict=True):
            color = part.palette.color
            key = tuple(color.flatten().tolist())
            if key in found or not own:
                continue
            users = [other for other in parts if torch.equal(other.palette.color, color)]
            weight = torch.cat([other.paint for other in users]).bincount(minlength=len(color))
            found[key] = make_mixable(color, weight, self.materials.paints, HARDLY_APART)
            if found[key].changes:
                told.append((f"{MIXED_PAINTS}, layer {number}", "; ".join(map(str, found[key].changes))))
        if not told:
            return list(parts), ()
        layers = []
        for part in parts:
            layer = self._layer_of(part)
            made = found.get(tuple(part.palette.color.flatten().tolist()))
            if made is not None and made.changes:
                strokes, palette, paint = as_palette(part.strokes, Paints(made.color, made.number[part.paint]))
                paints = Paints(palette.color.to(self.device), paint.to(self.device))
                layer = replace(layer, strokes=strokes.to(self.device), paints=paints)
            layers.append(layer)
        last, pace = self.effort.replanning, _POLISHING_PACE
        begin = StepCount(at_the_end(notify), last).begin
        return self._settle(layers, canvas, begin, last, pace=pace, change=change), tuple(told)

    def _layer_of(self, part: Plan, first: int = 0, *, mixes: bool = False) -> LayerAtWork:
        """Returns the layer of a plan of one layer, on the device; `first` is the first paint for other places."""
        paints = Paints(part.palette.color.to(self.device), part.paint.to(self.device), first)
        return LayerAtWork(part.layers[0].kind, part.strokes.to(self.device), paints, mixes)

    def _grow(
        self,
        count: int,
        brush: str,
        canvas: Tensor,
        wells: Paints | int,
        effort: Effort,
        generator: torch.Generator,
        steps: StepCount,
        below: Sequence[LayerAtWork],
    ) -> LayerAtWork:
        """Returns a layer of `count` strokes, grown as if it were the last one, in `wells` or so many new paints."""
        begin = partial(steps.begin, below=[(layer.kind, layer.strokes) for layer in below])
        problem = self.problems.of(canvas, self.coarse, brush, self.problems.initial_objective)
        guide, told = self.problems.guide(problem), begin(min(effort.growing, count) * effort.growing_together)
        target = optimize_target(problem) if guide is None else guide
        found = progressive(count, problem, target, effort, generator, told)
        found = found.to(self.device).project(problem.limits, problem.size)
        found = found[torch.argsort(to_lab(found.color)[:, 0], descending=True, stable=True)]
        for _ in range(effort.relocations):
            if (
                guide is not None
            ):  # a picture from the objective is only one of many, to which strokes are not pulled back
                found, _ = relocate(found, None, problem, guide, MOVED, generator)
            found, _ = optimize(found, problem, iterations=effort.refining, notify=begin(effort.refining))
        wanted = self.problems.of(canvas, self.coarse, brush)
        if isinstance(wells, int):
            found, mixed = bind_to_palette(found, wanted, wells, effort, self.seed, begin)
            return LayerAtWork(brush, found, mixed, mixes=True).with_paints_in_order()
        paint = Palette(wells.color).nearest(found.color)
        order, count = torch.argsort(paint, stable=True), effort.binding
        existing, notify = Paints(wells.color, paint[order]), begin(count)
        found, paints = optimize(
            found[order], wanted, iterations=count, paints=existing, vary_colors=False, notify=notify
        )
        assert paints is not None
        return LayerAtWork(brush, found, paints, mixes=False)

    def _settle(
        self,
        layers: Sequence[LayerAtWork],
        canvas: Tensor,
        begin: Callable[[int], Callable[[Step], None]],
        polishing: int,
        moves: Moves = _NO_MOVES,
        *,
        pace: float = 1.0,
        change: PictureChange | None = None,
    ) -> list[Plan]:
        """Settles layers, each painted over the one before on a canvas picture, together, and returns their plans.

        begin: returns the callback that reports the next iterations.
        polishing: last iterations, on the fine grid, with steps of `pace` and a `change` as for `optimize_together`.
        moves: rounds before them, in which strokes move and all descend.
        """
        # For other goals than pictures and their meaning, the guide only served to start the plan.
        guided = self.goal.initial_terms is self.goal.terms or self.goal.initial_terms[0].importance is not None
        found = list(layers)
        for number in range(moves.rounds + 1):
            last = number == moves.rounds
            grid, iterations = (self.fine, polishing) if last else (self.coarse, self.effort.settling)
            if moves.generator is not None and guided and not last:
                found = relocate_strokes(found, canvas, self.problems, grid, moves.share, moves.generator)
            parts = [
                StrokesInScene(layer.strokes, self.problems.of(canvas, grid, layer.kind), layer.paints, layer.mixes)
                for layer in found
            ]
            how: dict[str, Any] = {"pace": pace, "change": change} if last else {}
            better = optimize_together(parts, iterations=iterations, notify=begin(iterations), **how)
            found = [layer.after(part) for layer, part in zip(found, better, strict=True)]
        return [self._as_plan(layer) for layer in found]

    def fading(self, plan: Plan, canvas: AnyPicture) -> Fading:
        """Returns the cost of strokes of the plan that lack paint."""
        return fading_of(plan, as_picture(canvas), self.problems, self.coarse, self.seed)

    def without_weakest(self, plan: Plan, canvas: AnyPicture, count: int) -> Plan:
        """Returns the plan without the `count` strokes that matter least."""
        kept = torch.argsort(self.fading(plan, canvas).without_paint, descending=True)[: len(plan) - count]
        return plan.part(kept.sort().values.tolist())

    def bind_to_palette(
        self, plan: Plan, canvas: AnyPicture, palette: Palette, notify: Callable[[Step], None] = lambda step: None
    ) -> Plan:
        """Returns the plan in the really mixed paints.

        palette: mixed paints for the layer of the next stroke, in the order of the wells. Later layers without new
        paints use them too.
        Each stroke of these layers gets the nearest paint. Each of these layers is then polished on the expected
        canvas below it.
        """
        parts = plan.filled_layers()
        if not parts:
            return plan
        steps = StepCount(notify, self.effort.polishing * len(parts))
        wells = parts[0].palette
        done: list[Plan] = []
        below = as_picture(canvas)
        for part in parts:
            if torch.equal(part.palette.color, wells.color):
                paint = palette.nearest(part.strokes.color).to(self.device)
                layer = replace(self._layer_of(part), paints=Paints(palette.color.to(self.device), paint))
                begin = partial(steps.begin, below=[(plan.layers[0].kind, plan.strokes) for plan in done])
                (part,) = self._settle([layer], below, begin, self.effort.polishing, pace=_POLISHING_PACE)
            done.append(part)
            below = self.expected(part, below)
        return plan.with_parts(done)

    def replan(
        self,
        rest: Plan,
        canvas: AnyPicture,
        notify: Callable[[Step], None] = lambda step: None,
        rounds: int = 1,
        *,
        fresh: bool = False,
        wetness: Wetness | None = None,
    ) -> Plan:
        """Replans the strokes of `rest` on a photograph of the canvas; their brushes stay the same.

        The paints of the next stroke's layer stay, unless that layer begins now with new paints. The paints of
        later layers may change.
        rounds: number of rounds; more than one is useful if the goal has changed.
        fresh: True if a layer begins now, and none of its strokes is painted.
        wetness: as for `expected`. A region that takes strokes away takes their times too; then all paint is dry.

        If no better plan is found, the planner tries again without moving strokes far. If memory is short or the
        optimiser diverges, it tries once more at half the resolution, also without moving strokes far. If that fails,
        the function returns `rest`, except for strokes that would touch the region.
        """
        rest, canvas = self._clear(rest), as_picture(canvas)
        if len(rest) == 0:
            return rest
        wetness = None if self.region is not None else wetness
        task = PlanningTask(self, canvas, len(rest), self.settings.colors, notify, rounds, fresh, wetness)
        return self._clear(find_planner(self.settings.planner).make_rest(task, rest))

    def _replan_in_layers(self, task: "PlanningTask", rest: Plan) -> Plan:
        with FailureTolerance():
            return self._replan_better(task, rest, moves=(True, False))
        with FailureTolerance():
            return self._with(fine=self.coarse)._replan_better(task, rest, moves=(False,))
        return rest

    def _replan_better(self, task: "PlanningTask", rest: Plan, moves: Sequence[bool]) -> Plan:
        """Returns the first new plan that is better than the rest, whose strokes may move far or not; else the rest."""
        canvas, effort, change = task.canvas, self.effort, self._wet_change(task.wetness)
        cost, rounds, share = self.cost(rest, canvas, task.wetness), task.rounds, MOVED
        if task.fresh:
            rounds, share = max(rounds, min(_ROUNDS_WHERE_A_LAYER_BEGINS, effort.rounds)), MOVED_WHERE_A_LAYER_BEGINS
        for moving in moves:
            notify = task.notify if moving else at_the_end(task.notify)
            layers = self._at_work(rest, fresh=task.fresh)
            chance = torch.Generator().manual_seed(self.seed + len(rest)) if moving else None
            begin, last = StepCount(notify, rounds * effort.settling + effort.replanning).begin, effort.replanning
            found = self._settle(layers, canvas, begin, last, Moves(rounds, chance, share), change=change)
            again = self._join(rest, found, [layer.mixes for layer in layers], canvas, notify, change)
            if self.cost(again, canvas, task.wetness) < cost:
                return again
        return rest

    def _at_work(self, rest: Plan, *, fresh: bool) -> list[LayerAtWork]:
        """Returns the layers of the rest, to be settled once more."""
        # A layer never goes back to a lighter paint, which would pick up dark paint that is still wet.
        parts, mixed = rest.filled_layers(), find_later_mixing(rest, self.settings.mixes_anew, fresh=fresh)
        lightest = [0 if fresh or number else int(part.paint.min()) for number, part in enumerate(parts)]
        each = zip(parts, lightest, mixed, strict=True)
        return [self._layer_of(part, first, mixes=mixes) for part, first, mixes in each]

    def _join(
        self,
        rest: Plan,
        settled: Sequence[Plan],
        mixes: Sequence[bool],
        canvas: Tensor,
        notify: Callable[[Step], None],
        change: PictureChange | None = None,
    ) -> Plan:
        """Returns the rest with its layers settled once more, in paints that can be mixed."""
        numbers = [number for number, layer in enumerate(rest.layers, 1) if layer.strokes]
        parts, told = self._make_mixable(settled, numbers, mixes, canvas, notify, change)
        again = rest.with_parts(parts)
        return replace(again, about=tuple((dict(rest.about) | dict(told)).items())) if told else again

    def settle_wet(
        self,
        rest: Plan,
        canvas: AnyPicture,
        wetness: Wetness,
        notify: Callable[[Step], None] = lambda step: None,
        *,
        mixed: bool = True,
    ) -> Plan:
        """Returns the rest settled for the effect of wet paint on its picture.

        mixed: False if the paints of the next stroke's layer may still change.
        If the expected painting is not better, or the goal or planner is of another kind, this is `rest`.
        """
        ours = all(term.is_pixelwise for term in self.goal.terms) and self.settings.planner == LAYERS_KIND.name
        if len(rest) == 0 or not ours:
            return rest
        canvas, hear, count = as_picture(canvas), at_the_end(notify), self.effort.replanning
        layers, begin = self._at_work(rest, fresh=not mixed), StepCount(hear, count).begin
        if not mixed and int(rest.layer[0]) == 0:
            layers[0] = replace(layers[0], mixes=self.settings.mixes_anew or len(layers) == 1)
        change = self._wet_change(wetness)
        with FailureTolerance():
            settled = self._settle(layers, canvas, begin, count, pace=_POLISHING_PACE, change=change)
            again = self._join(rest, settled, [layer.mixes for layer in layers], canvas, hear, change)
            timed = len(again) == len(rest)  # else the region took a stroke, and the times are those of other strokes
            if timed and self.cost(again, canvas, wetness) < self.cost(rest, canvas, wetness):
                return again
        return rest

    def towards(self, goal: Goal) -> "Planner":
        """Returns a planner with the same settings for another goal."""
        return Planner(goal, self.settings, self.materials, self.effort, encoders=self.encoders, device=self.device)

    def locate(self, painted: Plan, known: Placement, before: AnyPicture, seen: AnyPicture) -> Placement:
        """Returns the placement learned from the strokes just painted and pictures of the canvas before and after them.

        If several layers were painted without a look, only the last layer counts.
        """
        before, seen = as_picture(before), as_picture(seen)
        *lower, last = painted.filled_layers()
        for part in lower:
            before = self.expected(part, before)
        coarse, fine = (self.problems.of(before, grid, last.layers[0].kind) for grid in (self.coarse, self.fine))
        return learn(last.strokes.to(self.device), known, coarse, fine, seen.to(self.device))

    def expected(self, plan: Plan, canvas: AnyPicture | None = None, wetness: Wetness | None = None) -> Tensor:
        """Returns the expected canvas [3, H, W] after the plan; the canvas before it is bare by default.

        wetness: how paint mixes while it is wet. None: all paint is dry.
        """
        picture = self.bare if canvas is None else as_picture(canvas)
        with torch.no_grad():
            for brush, strokes in plan.by_kind():
                picture = self.problems.of(picture, self.fine, brush).render(strokes.to(self.device))
        picture = images.fit(picture, self.fine.rows, self.fine.columns)
        change = self._change_by(wetness, plan)
        return picture.cpu() if change is None else (picture + change).clamp(0, 1).cpu()

    @torch.no_grad()
    def _change_by(self, wetness: Wetness | None, plan: Plan) -> Tensor | None:
        """Returns the change [3, H, W] of the expected canvas by wet paint; None if nothing is known of it."""
        change = self._wet_change(wetness)
        return None if change is None or len(plan) == 0 else change(*self.problems.stack(plan, self.bare, self.fine))

    def _wet_change(self, wetness: Wetness | None) -> PictureChange | None:
        return None if wetness is None else wetness.change_on(self.problems, self.fine)

    def expected_loss(self, plan: Plan, canvas: AnyPicture, wetness: Wetness | None = None) -> float:
        """Returns the mean distance to the goal over paintings of the plan; `wetness` is as for `expected`."""
        return self._judge(stacked_loss, plan, canvas, wetness)

    def cost(self, plan: Plan, canvas: AnyPicture, wetness: Wetness | None = None) -> float:
        """Returns the expected loss plus the price of the paint; `wetness` is as for `expected`."""
        return self._judge(stacked_cost, plan, canvas, wetness)

    def _judge(
        self, by: Callable[..., Tensor], plan: Plan, canvas: AnyPicture, wetness: Wetness | None = None
    ) -> float:
        strokes, problems = self.problems.stack(plan, as_picture(canvas), self.fine)
        objective, change = problems[0].forms.validation, self._change_by(wetness, plan)
        if change is not None:
            objective = shift_objective(objective or problems[0].objective, change)
        with torch.no_grad():
            return float(by(strokes, problems, objective))

    def forecast(
        self,
        plan: Plan,
        canvas: AnyPicture,
        placement: Placement | None = None,
        unseen: int = 0,
        wetness: Wetness | None = None,
        painted: int = 0,
    ) -> SimilarityForecast | None:
        """Forecasts the similarity of the plan's painting to its photograph; see forecast.py."""
        seen = images.resize_by_area(as_picture(canvas), self.fine.rows, self.fine.columns)
        stacked, change = self.problems.stack(plan, seen, self.fine), self._change_by(wetness, plan)
        return forecast(self.goal, *stacked, placement, unseen, change, painted)

    def validation_loss(self, picture: AnyPicture) -> float:
        """Returns the distance of a picture [3, H, W] of the canvas to the goal, by its validation if it has one."""
        with torch.no_grad():
            objective = self.problems.objectives[self.fine]
            seen = images.fit(as_picture(picture).to(self.device), self.fine.rows, self.fine.columns)
            return float((objective.validation or objective)(seen))

    def measure_plan(self, strokes: int) -> float | None:
        """Returns the seconds of a plan of so many strokes if nothing else runs here; None if no CLIP reads words."""
        bare = images.fit(self.bare.to(self.device), self.fine.rows, self.fine.columns)
        step = self.problems.objectives[self.fine].measure_step(bare)
        return None if step is None else step * self.iterations(strokes)

    def _as_plan(self, layer: LayerAtWork) -> Plan:
        if layer.mixes:
            layer = layer.with_paints_in_order()
        model = self.models[layer.kind]
        limits = model.limits.within(self.size)
        strokes = layer.strokes.project(limits, self.size).to("cpu")
        facts: dict[str, Any] = {"canvas": self.size, "brush": model.brush, "limits": limits, "ground": self.ground}
        return self._clear(Plan.of(strokes, Palette(layer.paints.color.cpu()), layer.paints.paint.cpu(), **facts))

    def _clear(self, plan: Plan) -> Plan:
        """Returns the plan with strokes moved out of the region, or else left out."""
        if self.region is None or len(plan) == 0:
            return plan
        return self.region.clear(plan, self.problems.models, self.fine.rows, self.device)

    def layer_sizes(self, strokes: int) -> tuple[int, ...]:
        """Returns the number of strokes of each layer. Raises ConfigError if a layer gets no stroke."""
        layers, shares = self.materials.layers, self.materials.shares
        if layers is None:
            pictures = any(term.guide is not None for term in self.goal.initial_terms)
            layers = usual_layers(strokes, len(self.kinds)) if pictures else 1
        return layer_sizes(strokes, shares if shares is not None and len(shares) == layers else usual_shares(layers))

    @property
    def brushes(self) -> tuple[str, ...]:
        """Brushes of the layers, each once, in the order of use."""
        return tuple(dict.fromkeys(model.brush for model in self.models.values()))

    def iterations(self, strokes: int) -> int:
        """Number of iterations of a plan with this many strokes."""
        return self.effort.planning(self.layer_sizes(strokes), new_paints=self.settings.mixes_anew)


@dataclass(frozen=True)
class PlanningTask:
    """Task of a planner.

    planner: settings, goal, problems and measures; `expected` and `expected_loss` judge a plan
    canvas [3, H, W]: picture of the canvas
    strokes, colors: number of strokes, and largest number of paints of a palette
    notify: called after each step; may raise to end the planning
    rounds: number of rounds of replanning; more than one if the goal has changed
    fresh: True if a layer begins now, and none of its strokes is painted
    wetness: how paint mixes while it is wet; None if nothing is known of it
    """

    planner: Planner
    canvas: Tensor
    strokes: int
    colors: int
    notify: Callable[[Step], None]
    rounds: int = 1
    fresh: bool = False
    wetness: Wetness | None = None

    @property
    def goal(self) -> Goal:
        """Goal, with its pictures fitted to the canvas."""
        return self.planner.goal

    @property
    def size(self) -> CanvasSize:
        """Size of the canvas."""
        return self.planner.size

    @property
    def seed(self) -> int:
        """Seed of every random choice."""
        return self.planner.seed


@dataclass(frozen=True)
class PlannerKind:
    """Way to make a plan, of this or another package.

    name: as in `--planner NAME`
    help: one sentence
    plan: returns a plan for the canvas
    replan: returns the rest of a plan, planned again for the canvas as it was seen; None keeps the rest as it is
    """

    name: str
    help: str
    plan: Callable[[PlanningTask], Plan]
    replan: Callable[[PlanningTask, Plan], Plan] | None = None

    def make(self, task: PlanningTask) -> Plan:
        """Returns the plan. Raises PluginError if it is not what was asked for."""
        return self._checked(self.plan(task), task, task.strokes)

    def make_rest(self, task: PlanningTask, rest: Plan) -> Plan:
        """Returns the rest of a plan, planned again. Raises PluginError if it is not what was asked for."""
        if self.replan is None:
            return rest
        again = self._checked(self.replan(task, rest), task, len(rest))
        if again.layer_sizes != rest.layer_sizes:
            raise PluginError(f"The planner {self.name!r} returned other layers for the rest of a plan; mend it.")
        return again

    def _checked(self, made: Plan, task: PlanningTask, strokes: int) -> Plan:
        """Returns the plan if it is one. A plan checks its own limits when it is made."""
        if not isinstance(made, Plan):
            raise PluginError(f"The planner {self.name!r} returned a {type(made).__name__}, not a plan; mend it.")
        if len(made) != strokes or made.canvas != task.size:
            raise PluginError(
                f"The planner {self.name!r} returned {len(made)} strokes on a canvas of {made.canvas} for {strokes} "
                f"on {task.size}; mend it."
            )
        unknown = [kind for kind in made.kinds if kind not in task.planner.models]
        if unknown:
            raise PluginError(f"The planner {self.name!r} used the brush {unknown[0]!r}, which was not given; mend it.")
        ground = task.planner.ground
        return made if made.ground == ground else replace(made, ground=ground)


def find_planner(name: str) -> PlannerKind:
    """Returns the planner of that name. Raises ConfigError if there is none, PluginError if it is broken."""
    return registry.load_part(registry.PLANNERS, name, PlannerKind, "planner")


LAYERS_KIND = PlannerKind(
    "layers",
    "Layers of strokes that are grown, optimised together and replanned by gradients.",
    lambda task: task.planner._plan_in_layers(task),
    lambda task, rest: task.planner._replan_in_layers(task, rest),
)
