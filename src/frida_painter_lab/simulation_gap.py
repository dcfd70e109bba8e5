"""Experiments on the gap between a plan and its painting: `sim2real` and `replanning`.

`sim2real` (paper, Fig. "sim2real gap") plans the same target in three ways: (a) ours; (b) unconstrained soft strokes of
any size, opacity and colour, as in Huang et al. 2019; (c) soft strokes within the limits of a brush, opaque and in a
few paints, as in Schaldenbrand and Oh 2021. All minimise the same squared difference. The same virtual robot paints
all plans, without looks.

`replanning` (paper, Fig. "deviation from the initial plan") photographs the canvas after every batch of strokes. The
expected picture is the photograph with the remaining plan on top. Its difference from the first plan is the deviation,
its difference from the target the error. With looks, the remaining plan is replanned on each photograph; without, it
stays the same. A painter who looks also learns the placement of the robot; to separate this from replanning, a robot
with known placement paints the same.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from torch import Tensor

from frida_painter.report.chart import Series, chart
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.strokes.plan import Plan
from frida_painter.system import images
from frida_painter_lab.experiment import Results, ResultTable, Row
from frida_painter_lab.measures import mse, psnr
from frida_painter_lab.paintings import (
    KNOWN_PLACEMENT,
    Comparison,
    Painted,
    PaintingWay,
    StudioRun,
    Tell,
)
from frida_painter_lab.soft_strokes import SoftPlanner, allow_any_stroke, as_plan, constrain_to_brush
from frida_painter_lab.targets import Target

OURS = "ours"
UNCONSTRAINED = "unconstrained (as Huang et al. 2019)"
CONSTRAINED = "constrained (as Schaldenbrand & Oh 2021)"


@dataclass(frozen=True, kw_only=True)
class Sim2Real(Comparison):
    """Experiment `sim2real`: every target planned and painted with every planner, on the same easel.

    strokes: of each painting; None for the usual number
    """

    NAME = "sim2real"
    TITLE = "The gap between simulated and painted pictures"
    FULL = RunSpec.of(strokes=120, layers=1, colors=12, replans=0)
    QUICK = RunSpec.of(strokes=8, colors=3, render_height=64, effort=0.05, replans=0)
    WAYS = (PaintingWay(OURS), PaintingWay(UNCONSTRAINED, OURS), PaintingWay(CONSTRAINED, OURS))
    MEASURES: ClassVar[Mapping[str, bool | None]] = {
        "gap": False, "simulated to target": False, "painted to target": False,
    }  # fmt: skip
    SHOWN = ("simulated", "painting")

    seeds: tuple[int, ...] = (0, 1, 2)
    strokes: int | None = None

    @cached_property
    def common(self) -> RunSpec:
        """Common settings of all paintings, with another number of strokes if one was asked for."""
        usual = super().common
        return usual if self.strokes is None else usual.with_values(strokes=self.strokes)

    def make_plan(self, run: StudioRun, opened: PaintingRun, tell: Tell) -> tuple[Plan, Tensor]:
        """Plans with soft strokes, and converts them to strokes of the robot; ours plans as usual."""
        if run["painted"] == OURS:
            return super().make_plan(run, opened, tell)
        spec, model, bare = opened.spec, opened.planner.models[opened.planner.kinds[0]], opened.planner.bare
        held = run["painted"] == CONSTRAINED
        planner = SoftPlanner(
            target=images.fit(self.target_of(run).picture, *bare.shape[1:]),
            size=spec.canvas,
            freedom=constrain_to_brush(model, spec.canvas) if held else allow_any_stroke(spec.canvas),
            colors=spec.colors if held else None,
            effort=spec.effort,
            seed=spec.seed,
            notify=tell,
        )
        strokes, picture = planner.plan(spec.strokes)
        return as_plan(strokes, model, spec.canvas, spec.colors, bare, spec.seed), picture

    def figures(self, painted: Painted, picture: Tensor, target: Target) -> Mapping[str, float]:
        """Measures the distances between simulation, photograph of the painting, and target."""
        wanted = images.fit(target.picture, *picture.shape[1:])
        pairs = ((painted.planned, picture), (painted.planned, wanted), (picture, wanted))
        return {name: mse(*pair) for name, pair in zip(self.MEASURES, pairs, strict=True)}


LOOKING, UNSEEN = "with replanning", "without looking"
KNOWN_LOOKING, KNOWN_UNSEEN = "placement known, with replanning", "placement known, without looking"
DEVIATION, ERROR, SIMILARITY = "deviation", "error", "PSNR, dB"


@dataclass(frozen=True, kw_only=True)
class Replanning(Comparison):
    """Experiment `replanning`: the target painted four times per seed, from the same first plan.

    The four ways are with and without looks, by a robot with a small placement error and by one without.
    Without looks the canvas is photographed as for a film, which has no effect.
    """

    NAME = "replanning"
    TITLE = "A photograph painted with and without looking"
    FULL = RunSpec.of(strokes=195, layers=1, colors=12, replans=12)
    QUICK = RunSpec.of(strokes=9, colors=3, render_height=64, effort=0.05, replans=2)
    MEASURES: ClassVar[Mapping[str, bool | None]] = {SIMILARITY: True}
    SHOWN = ("simulated", "painting")

    seeds: tuple[int, ...] = (0, 1, 2)

    def ways(self) -> Sequence[PaintingWay]:
        """Returns the four ways."""
        looks: dict[str, Any] = {"replan_policy": f"every:{self._batch}"}
        film: dict[str, Any] = {"replans": 0, "film": True}
        return [
            PaintingWay(UNSEEN, changes=film),
            PaintingWay(LOOKING, UNSEEN, changes=looks),
            PaintingWay(KNOWN_UNSEEN, UNSEEN, changes=film, furniture=KNOWN_PLACEMENT),
            PaintingWay(KNOWN_LOOKING, KNOWN_UNSEEN, changes=looks, furniture=KNOWN_PLACEMENT),
        ]

    @property
    def points(self) -> list[int]:
        """Numbers of strokes at which the canvas is seen."""
        return [*range(0, self.common.strokes, self._batch), self.common.strokes]

    @property
    def _batch(self) -> int:
        return self.common.strokes // (self.common.replans + 1)

    def figures(self, painted: Painted, picture: Tensor, target: Target) -> Mapping[str, float]:
        """Measures how the expected picture differs from the first plan and the target, during the painting.

        The differences are given for certain numbers of strokes. Frames of a film come at slightly different
        numbers, so the values are interpolated.
        """
        wanted = images.fit(target.picture, *painted.planned.shape[1:])
        numbers = {SIMILARITY: psnr(painted.truth, wanted)}
        seen = sorted(painted.expected)
        for what, than in ((DEVIATION, painted.expected[0]), (ERROR, wanted)):
            known = np.interp(self.points, seen, [mse(painted.expected[done], than) for done in seen])
            numbers |= {f"{what} {done}": float(value) for done, value in zip(self.points, known, strict=True)}
        return numbers

    def tables(self, results: Results) -> Sequence[ResultTable]:
        """Returns means and differences, and the figures after every look."""
        means, differences, _ = super().tables(results)
        rows: list[Row] = [
            {**labels, "strokes": done, **{what: one.numbers[f"{what} {done}"] for what in (DEVIATION, ERROR)}}
            for labels, one in results.found
            for done in self.points
        ]
        return [means, differences, ResultTable("After every look", rows)]

    def pictures(self, results: Results) -> Mapping[str, Tensor]:
        """Returns the two curves (the mean over the seeds, with their range as a band), and the paintings."""
        titles = {DEVIATION: "Deviation from the first plan", ERROR: "Error of the picture to be expected"}
        drawn, places = dict[str, Tensor](), [float(done) for done in self.points]
        for what, title in titles.items():
            lines = []
            for way in self.ways():
                values = np.array([results.values(f"{what} {done}", painted=way.name) for done in self.points])
                mean, least, most = values.mean(1).tolist(), values.min(1).tolist(), values.max(1).tolist()
                lines.append(Series(way.name, places, mean, least, most, band=True))
            drawn[what] = chart(title, "strokes painted", "mean squared difference; band: all seeds", lines)
        return {**drawn, "paintings": super().pictures(results)[self.NAME]}
