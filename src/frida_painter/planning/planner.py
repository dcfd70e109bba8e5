"""The planner: a goal and a canvas become a plan, and what is left of a plan is planned again from a photograph."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.goal import Goal
from frida_painter.objectives.base import Objective, prepare
from frida_painter.palette import Palette
from frida_painter.plan import Plan
from frida_painter.planning.initialize import Growth, progressive
from frida_painter.planning.optimize import Step, optimize
from frida_painter.planning.refine import relocate
from frida_painter.planning.scene import Scene
from frida_painter.planning.variables import Paints, as_palette
from frida_painter.strokes import Strokes

_PALETTE_SAMPLES = 64  # rows of the picture from which the first palette is clustered
_WHITE = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Effort:
    """How many iterations are spent on what.

    growth: on the start; refining: joint steps after each of `relocations` rounds in which weak
    strokes move; polishing: last steps at full resolution; replanning: steps after each look.
    """

    growth: Growth = field(default_factory=Growth)
    relocations: int = 3
    refining: int = 40
    polishing: int = 100
    replanning: int = 50

    def scaled(self, factor: float) -> "Effort":
        """The same effort with `factor` times as many iterations."""
        growth = Growth(self.growth.rounds, math.ceil(self.growth.settling * factor), self.growth.proposals)
        return Effort(
            growth,
            self.relocations,
            math.ceil(self.refining * factor),
            math.ceil(self.polishing * factor),
            math.ceil(self.replanning * factor),
        )


class Planner:
    """Plans strokes of one brush towards one goal on one canvas (paper, Algorithm 1).

    rows: height of the picture in which is planned; the start is planned at half of it. Every
    random choice comes from `seed`.
    """

    def __init__(
        self, goal: Goal, size: CanvasSize, model: StrokeModel, *, rows: int, effort: Effort, seed: int
    ) -> None:
        self.goal = goal
        self.size = size
        self.model = model
        self.effort = effort
        self.fine = PixelGrid.of_height(size, rows)
        self.coarse = PixelGrid.of_height(size, max(rows // 2, 32))
        self.seed = seed
        self._objectives = {grid: prepare(goal, grid) for grid in (self.fine, self.coarse)}

    def plan(self, canvas: Tensor, strokes: int, colors: int, notify: Callable[[Step], None]) -> Plan:
        """A plan of `strokes` strokes in `colors` paints for a canvas picture [3, H, W] of the fine grid."""
        generator = torch.Generator().manual_seed(self.seed)
        coarse, fine = self._scene(canvas, self.coarse), self._scene(canvas, self.fine)
        target = self._guide(self.coarse)
        steps = _Progress(notify, self.iterations(strokes))
        found, paints = progressive(
            strokes,
            coarse,
            target,
            paints=self._first_paints(colors),
            light_to_dark=True,
            growth=self.effort.growth,
            generator=generator,
            notify=steps.begin(self._growing(strokes)),
        )
        for round_number in range(self.effort.relocations):
            share = 0.1 * (1 - round_number / self.effort.relocations)
            found, paints = relocate(found, paints, coarse, target, share=share, proposals=24, generator=generator)
            found, paints = optimize(
                found, coarse, iterations=self.effort.refining, paints=paints, notify=steps.begin(self.effort.refining)
            )
        found, paints = optimize(
            found, fine, iterations=self.effort.polishing, paints=paints, notify=steps.begin(self.effort.polishing)
        )
        assert paints is not None
        ordered, palette, paint = as_palette(found, paints)
        return self._as_plan(ordered, palette, paint)

    def replan(self, rest: Plan, canvas: Tensor, notify: Callable[[Step], None]) -> Plan:
        """The strokes of `rest` planned again on a photograph [3, H, W] of the canvas; their palette stays.

        The work is in proportion to the number of strokes that are left.
        """
        if len(rest) == 0:
            return rest
        generator = torch.Generator().manual_seed(self.seed + len(rest))
        coarse, fine = self._scene(canvas, self.coarse), self._scene(canvas, self.fine)
        steps = _Progress(notify, self.effort.refining + self.effort.replanning)
        paints: Paints | None = Paints(rest.palette.color, rest.paint)
        found, paints = relocate(
            rest.strokes, paints, coarse, self._guide(self.coarse), share=0.15, proposals=24, generator=generator
        )
        for scene, iterations in ((coarse, self.effort.refining), (fine, self.effort.replanning)):
            found, paints = optimize(
                found, scene, iterations=iterations, paints=paints, vary_colors=False, notify=steps.begin(iterations)
            )
        assert paints is not None
        again = self._as_plan(found, rest.palette, paints.paint)
        return min((rest, again), key=lambda plan: self.judge(self.expected(plan, canvas)))

    def expected(self, plan: Plan, canvas: Tensor) -> Tensor:
        """The canvas [3, H, W] as it would look after the plan."""
        with torch.no_grad():
            return self._scene(canvas, self.fine).render(plan.strokes)

    def judge(self, picture: Tensor) -> float:
        """The objective of a picture [3, H, W] of the canvas: the less, the nearer to the goal."""
        with torch.no_grad():
            return float(self._objectives[self.fine](images.fit(picture, self.fine.rows, self.fine.columns)))

    def _as_plan(self, strokes: Strokes, palette: Palette, paint: Tensor) -> Plan:
        limits = self.model.limits.within(self.size)
        return Plan.of(
            strokes.project(limits, self.size), palette, paint, canvas=self.size, brush=self.model.brush, limits=limits
        )

    def _scene(self, canvas: Tensor, grid: PixelGrid) -> Scene:
        objective: Objective = self._objectives[grid]
        return Scene(images.fit(canvas, grid.rows, grid.columns), self.size, self.model, objective)

    def _guide(self, grid: PixelGrid) -> Tensor:
        """The picture that says where strokes are needed."""
        return images.fit(self.goal.terms[0].image, grid.rows, grid.columns)

    def _first_paints(self, colors: int) -> Paints:
        grid = PixelGrid.of_height(self.size, _PALETTE_SAMPLES)
        pixels = self._guide(grid).flatten(1).T  # [pixels, 3]
        palette = Palette.cluster(pixels, torch.ones(len(pixels)), colors, self.seed)
        return Paints(palette.color, torch.zeros(0, dtype=torch.long))

    def _growing(self, strokes: int) -> int:
        return min(self.effort.growth.rounds, strokes) * self.effort.growth.settling

    def iterations(self, strokes: int) -> int:
        """How many iterations a plan of so many strokes takes."""
        return self._growing(strokes) + self.effort.relocations * self.effort.refining + self.effort.polishing


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
        return lambda step: self._notify(Step(before + step.iteration, self._total, step.loss))
