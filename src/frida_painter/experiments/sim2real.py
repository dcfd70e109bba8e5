"""How far a painting is from its simulation, for three planners and one robot (paper, Fig. "sim2real gap").

The same target is planned with (a) our planner; (b) unconstrained soft strokes of any size, opacity
and colour, in the manner of Huang et al. 2019; (c) soft strokes held to what a brush can do, opaque
and in a few paints, in the manner of Schaldenbrand and Oh 2021. All pursue the same squared
difference. The same virtual robot paints all plans, without looking in between.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import images
from frida_painter.brush.table_cache import cached_table
from frida_painter.brush.weights import load_stroke_model
from frida_painter.experiments import robot_strokes, soft_planner
from frida_painter.experiments.execution import execute, open_easel
from frida_painter.experiments.outcome import Notify, Outcome, Progress, ResultTable, Row, each, silent
from frida_painter.experiments.result_cache import Measurement, ResultCache
from frida_painter.experiments.scale import CANVAS, ROBOT_ERROR, PlanningScale
from frida_painter.experiments.soft_planner import SoftEffort
from frida_painter.experiments.soft_strokes import Freedom
from frida_painter.experiments.targets import Target
from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.goal import Goal
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.plan import Plan
from frida_painter.planning.planner import Effort, Planner
from frida_painter.report.figure_sheet import Cell, FigureRow, page

NAME = "sim2real"
OURS, UNCONSTRAINED, CONSTRAINED = "ours", "unconstrained", "constrained"
PLANNERS = (OURS, UNCONSTRAINED, CONSTRAINED)
MANNER = {
    OURS: "ours",
    UNCONSTRAINED: "unconstrained (as Huang et al. 2019)",
    CONSTRAINED: "constrained (as Schaldenbrand & Oh 2021)",
}
_PHOTOGRAPH_ROWS = 768
_PLANNING = 0.6  # share of the time that a painting takes
_Tell = Callable[[float], None]
_Key = tuple[str, int, str]  # target, seed, planner


FULL = PlanningScale(strokes=120, colors=12, rows=256, effort=1.0)
QUICK = PlanningScale(strokes=8, colors=3, rows=64, effort=0.05, quick=True)


def run(
    targets: Sequence[Target],
    *,
    brush: str = "broad",
    canvas: CanvasSize = CANVAS,
    seeds: Sequence[int] = (0, 1, 2),
    scale: PlanningScale = FULL,
    keep: Path | None = None,
    notify: Notify = silent,
) -> Outcome:
    """Plans and paints every target with every planner, once per seed.

    canvas: turned as the target asks for; keep: a folder in which finished paintings wait in case
    the rest is interrupted. The robot stands as far off as `seed` says, the same for all planners.
    """
    bench = _Bench(brush, canvas, scale)
    tasks = [(target, seed, planner) for target in targets for seed in seeds for planner in PLANNERS]
    found: dict[_Key, Measurement] = {}
    for (target, seed, planner), telling in each(tasks, notify):
        paint = partial(bench.paint, target, seed, planner, telling)
        cache = ResultCache(keep, bench.depends_on(target))
        found[target.name, seed, planner] = cache.recall(f"{target.name}-{planner}-{seed}", paint)
        telling(Progress(1.0, f"painted {target.name}"))
    names = [target.name for target in targets]
    summary = [_summary(name, planner, found, seeds) for name in names for planner in PLANNERS]
    every: list[Row] = [
        {"target": name, "seed": seed, "planner": MANNER[planner], **finding.numbers}
        for (name, seed, planner), finding in found.items()
    ]
    return Outcome(
        NAME,
        "The gap between simulated and painted pictures",
        {
            "targets": tuple(names), "seeds": tuple(seeds), "brush": brush, "canvas": str(canvas),
            **scale.settings(),
            "robot": f"{ROBOT_ERROR}, the same for all planners",
        },
        (
            ResultTable("Mean squared differences, mean over the seeds", tuple(summary)),
            ResultTable("All paintings", tuple(every)),
        ),
        _notes(summary),
        {NAME: _sheet(targets, found, seeds[0], bench)},
    )  # fmt: skip


class _Bench:
    """Everything that the three planners share."""

    def __init__(self, brush: str, canvas: CanvasSize, scale: PlanningScale) -> None:
        self.brush, self.canvas, self.scale = brush, canvas, scale
        self.model = cached_table(load_stroke_model(brush))

    def depends_on(self, target: Target) -> dict[str, object]:
        """All that a painting of the target follows from, but for its seed and planner."""
        pixels = hashlib.sha256(images.to_uint8(target.picture).tobytes()).hexdigest()
        return {"brush": self.brush, "canvas": str(self.canvas), "scale": repr(self.scale), "target": pixels}

    def grid(self, target: Target) -> PixelGrid:
        """The picture in which a target is planned and compared."""
        return PixelGrid.of_height(self.canvas.turned_like(*target.picture.shape[1:]), self.scale.rows)

    def paint(self, target: Target, seed: int, planner: str, notify: Notify) -> Measurement:
        """Plans, paints, and compares."""
        grid = self.grid(target)
        wanted = images.fit(target.picture, grid.rows, grid.columns)

        def planning(share: float) -> None:
            notify(Progress(_PLANNING * share, f"{target.name}, seed {seed}: planning, {planner}"))

        def moving(done: int) -> None:
            share = _PLANNING + (1 - _PLANNING) * done / self.scale.strokes
            notify(Progress(share, f"{target.name}, seed {seed}: painting, {planner}"))

        make = self._ours if planner == OURS else self._held if planner == CONSTRAINED else self._free
        plan, simulated = make(wanted, grid.size, seed, planning)
        easel = open_easel(grid.size, self.brush, seed)
        painted = images.fit(execute(plan, easel, _PHOTOGRAPH_ROWS, moving), grid.rows, grid.columns)
        numbers = {
            "gap": _mse(simulated, painted),
            "simulated to target": _mse(simulated, wanted),
            "painted to target": _mse(painted, wanted),
        }
        return Measurement(numbers, {"simulated": simulated, "painted": painted})

    def _ours(self, wanted: Tensor, size: CanvasSize, seed: int, tell: _Tell) -> tuple[Plan, Tensor]:
        scale, goal = self.scale, Goal((ImageTerm(wanted),))
        effort = Effort().scaled(scale.effort)
        planner = Planner(goal, size, self.model, rows=scale.rows, effort=effort, seed=seed)
        bare = torch.ones_like(wanted)
        plan = planner.plan(bare, scale.strokes, scale.colors, lambda step: tell(step.iteration / step.of))
        return plan, planner.expected(plan, bare)

    def _free(self, wanted: Tensor, size: CanvasSize, seed: int, tell: _Tell) -> tuple[Plan, Tensor]:
        return self._soft(wanted, size, seed, tell, unconstrained(size), None)

    def _held(self, wanted: Tensor, size: CanvasSize, seed: int, tell: _Tell) -> tuple[Plan, Tensor]:
        return self._soft(wanted, size, seed, tell, robot_strokes.held_to(self.model, size), self.scale.colors)

    def _soft(
        self, wanted: Tensor, size: CanvasSize, seed: int, tell: _Tell, freedom: Freedom, colors: int | None
    ) -> tuple[Plan, Tensor]:
        scale = self.scale
        effort = SoftEffort(2, 3, 3) if scale.quick else SoftEffort()
        made = soft_planner.plan(
            wanted,
            size,
            freedom,
            scale.strokes,
            colors=colors,
            effort=effort,
            seed=seed,
            notify=tell,
        )
        bare = torch.ones_like(wanted)
        return robot_strokes.as_plan(made.strokes, self.model, size, scale.colors, bare, seed), made.picture


def unconstrained(size: CanvasSize) -> Freedom:
    """Strokes from a hair to half the canvas, of any opacity."""
    return Freedom(
        length=(0.001, size.width + size.height),
        radius=(0.0008, 0.25 * min(size.width, size.height)),
        bow=(-size.width, size.width),
        opacity=(0.0, 1.0),
        tapered=True,
    )


def _mse(first: Tensor, second: Tensor) -> float:
    return float((first - second).square().mean())


def _summary(target: str, planner: str, found: Mapping[_Key, Measurement], seeds: Sequence[int]) -> Row:
    def measured(who: str, what: str) -> NDArray[np.float64]:
        return np.array([found[target, seed, who].numbers[what] for seed in seeds])

    gap = measured(planner, "gap")
    return {
        "target": target,
        "planner": MANNER[planner],
        "gap": float(gap.mean()),
        "gap, least": float(gap.min()),
        "gap, most": float(gap.max()),
        "gap / ours": float(gap.mean() / measured(OURS, "gap").mean()),
        "simulated to target": float(measured(planner, "simulated to target").mean()),
        "painted to target": float(measured(planner, "painted to target").mean()),
    }


def _notes(summary: Sequence[Row]) -> tuple[str, ...]:
    """What the summary says, whichever way it goes."""
    notes = []
    for planner in PLANNERS[1:]:
        factors = {row["target"]: float(row["gap / ours"] or 0) for row in summary if row["planner"] == MANNER[planner]}
        larger = [name for name, factor in factors.items() if factor > 1]
        mean = float(np.exp(np.mean(np.log(list(factors.values())))))
        notes.append(
            f"The gap of {planner} strokes is larger than ours on {len(larger)} of {len(factors)} targets, by a factor "
            f"of {min(factors.values()):.2f} to {max(factors.values()):.2f} (geometric mean {mean:.2f})."
        )
    return tuple(notes)


def _sheet(targets: Sequence[Target], found: Mapping[_Key, Measurement], seed: int, bench: _Bench) -> Tensor:
    """Every target beside what each planner meant to paint and what came of it."""
    lines = []
    for target in targets:
        grid = bench.grid(target)
        cells = [Cell(images.fit(target.picture, grid.rows, grid.columns), target.name)]
        for planner in PLANNERS:
            finding = found[target.name, seed, planner]
            cells.append(Cell(finding.pictures["simulated"], "simulated"))
            cells.append(Cell(finding.pictures["painted"], f"painted, gap {finding.numbers['gap']:.4f}"))
        lines.append(FigureRow("", cells))
    headings = ["target", *(words for planner in PLANNERS for words in (MANNER[planner].split(" (")[0], ""))]
    return page("Simulated and painted, without looking in between", headings, lines, width=210)
