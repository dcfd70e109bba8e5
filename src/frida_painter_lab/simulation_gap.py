"""Experiments on the gap between a plan and its painting: `sim2real`, `replanning` and `ladder`.

`sim2real` (paper, Fig. "sim2real gap") plans the same target in three ways: (a) ours; (b) unconstrained soft strokes of
any size, opacity and colour, as in Huang et al. 2019; (c) soft strokes within the limits of a brush, opaque and in a
few paints, as in Schaldenbrand and Oh 2021. All minimise the same squared difference. The same virtual robot paints
all plans, without looks.

`replanning` (paper, Fig. "deviation from the initial plan") photographs the canvas after every batch of strokes. The
expected picture is the photograph with the remaining plan on top. Its difference from the first plan is the deviation,
its difference from the target the error. With looks, the remaining plan is replanned on each photograph; without, it
stays the same. A painter who looks also learns the placement of the robot; to separate this from replanning, a robot
with known placement paints the same.

`ladder` leads from the plan to the painting. Every rung is the same first plan, in the same studio, with one change.
Its paintings are judged by their true colours, not by the camera.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
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
    CAMERA,
    IMPERFECTIONS,
    PLACEMENT,
    Comparison,
    Imperfection,
    Painted,
    PaintingWay,
    StudioRun,
    Tell,
    make_first_plan,
)
from frida_painter_lab.soft_strokes import SoftPlanner, allow_any_stroke, as_plan, constrain_to_brush
from frida_painter_lab.targets import Target

OURS = "ours"
UNCONSTRAINED = "unconstrained (as Huang et al. 2019)"
CONSTRAINED = "constrained (as Schaldenbrand & Oh 2021)"


@dataclass(frozen=True, kw_only=True)
class Sim2Real(Comparison):
    """Experiment `sim2real`: every target planned and painted with every planner, on the same easel."""

    NAME = "sim2real"
    TITLE = "The gap between simulated and painted pictures"
    FULL = RunSpec.of(strokes=120, layers=1, colors=12, replans=0)
    QUICK = RunSpec.of(strokes=8, colors=3, render_height=64, effort=0.05, replans=0)
    WAYS = (PaintingWay(OURS), PaintingWay(UNCONSTRAINED, OURS), PaintingWay(CONSTRAINED, OURS))
    MEASURES: ClassVar[Mapping[str, bool | None]] = {
        "gap": False, "simulated to target": False, "painted to target": False,
    }  # fmt: skip
    SHOWN = ("simulated", "painting")

    photos: tuple[Target, ...]
    seeds: tuple[int, ...] = (0, 1, 2)

    def make_plan(self, run: StudioRun, opened: PaintingRun, tell: Tell) -> tuple[Plan, Tensor]:
        """Plans with soft strokes, and converts them to strokes of the robot; ours plans as usual."""
        if run["painted"] == OURS:
            return make_first_plan(opened, tell)
        spec, model, bare = opened.spec, opened.planner.models[opened.planner.kinds[0]], opened.planner.bare
        held = run["painted"] == CONSTRAINED
        planner = SoftPlanner(
            target=images.fit(self.scene_of(run)[0].picture, *bare.shape[1:]),
            size=spec.canvas,
            freedom=constrain_to_brush(model, spec.canvas) if held else allow_any_stroke(spec.canvas),
            colors=spec.colors if held else None,
            effort=spec.effort,
            seed=spec.seed,
            notify=tell,
        )
        strokes, picture = planner.plan(spec.strokes)
        return as_plan(strokes, model, spec.canvas, spec.colors, bare, spec.seed), picture

    def figures(self, painted: Painted, picture: Tensor, *scene: Target) -> Mapping[str, float]:
        """Measures the distances between simulation, photograph of the painting, and target."""
        wanted = images.fit(scene[0].picture, *picture.shape[1:])
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
    PICTURES = ("photo",)
    MEASURES: ClassVar[Mapping[str, bool | None]] = {SIMILARITY: True}
    SHOWN = ("simulated", "painting")

    photo: Target
    seeds: tuple[int, ...] = (0, 1, 2)

    def ways(self) -> Sequence[PaintingWay]:
        """Returns the four ways."""
        looks: dict[str, Any] = {"replan_policy": f"every:{self._batch}"}
        film: dict[str, Any] = {"replans": 0, "film": True}
        return [
            PaintingWay(UNSEEN, changes=film),
            PaintingWay(LOOKING, UNSEEN, changes=looks),
            PaintingWay(KNOWN_UNSEEN, UNSEEN, changes=film, without=(PLACEMENT,)),
            PaintingWay(KNOWN_LOOKING, KNOWN_UNSEEN, changes=looks, without=(PLACEMENT,)),
        ]

    @property
    def points(self) -> list[int]:
        """Numbers of strokes at which the canvas is seen."""
        return [*range(0, self.common.strokes, self._batch), self.common.strokes]

    @property
    def _batch(self) -> int:
        return self.common.strokes // (self.common.replans + 1)

    def figures(self, painted: Painted, picture: Tensor, *scene: Target) -> Mapping[str, float]:
        """Measures how the expected picture differs from the first plan and the target, during the painting.

        The differences are given for certain numbers of strokes. Frames of a film come at slightly different
        numbers, so the values are interpolated.
        """
        wanted = images.fit(scene[0].picture, *painted.planned.shape[1:])
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


BLIND, KNOWN, USUAL = "without a look", "placement known, no look", "with 4 looks"
PLANNED, EXPECTED = "of the plan as rendered", "of the plan as expected"


def _rung(name: str, than: str, looks: int = 0, *without: Imperfection) -> PaintingWay:
    return PaintingWay(name, than, changes={"replans": looks}, without=without)


RUNGS = (
    _rung(BLIND, ""),
    _rung("with 1 look", BLIND, 1),
    _rung(USUAL, BLIND, 4),
    _rung("with 12 looks", BLIND, 12),
    _rung(KNOWN, BLIND, 0, PLACEMENT),
    _rung("placement known, 4 looks", KNOWN, 4, PLACEMENT),
    _rung("placement known, 12 looks", KNOWN, 12, PLACEMENT),
    *(
        _rung(f"placement known, no {one.name}", KNOWN, 0, PLACEMENT, one)
        for one in IMPERFECTIONS
        if one not in (PLACEMENT, CAMERA)
    ),
    _rung(f"{USUAL}, no {CAMERA.name}", USUAL, 4, CAMERA),
    _rung("no imperfection, no look", KNOWN, 0, *IMPERFECTIONS),
)


@dataclass(frozen=True, kw_only=True)
class Ladder(Comparison):
    """Experiment `ladder`: every photograph planned once per seed, and that plan painted on every rung.

    strokes: of a painting
    made: first plans and their pictures by photograph and seed, which all rungs of a process share
    """

    NAME = "ladder"
    TITLE = "Where the quality of a painting is lost"
    SHARING = "painted"
    FULL = RunSpec.of(strokes=200, colors=12, replans=0)
    QUICK = RunSpec.of(strokes=14, colors=3, render_height=64, effort=0.05, replans=0)
    MEASURES: ClassVar[Mapping[str, bool | None]] = {SIMILARITY: True, PLANNED: None, EXPECTED: None}
    SHOWN = ("canvas",)
    COLUMNS = 5

    photos: tuple[Target, ...]
    strokes: int | None = None
    made: dict[tuple[str, str], tuple[Plan, Tensor]] = field(default_factory=dict, compare=False, repr=False)

    def ways(self) -> Sequence[PaintingWay]:
        """Returns the rungs."""
        more = {"strokes": self.strokes} if self.strokes else {}
        return [replace(rung, changes={**rung.changes, **more}) for rung in RUNGS]

    def make_plan(self, run: StudioRun, opened: PaintingRun, tell: Tell) -> tuple[Plan, Tensor]:
        """Returns the first plan of the photograph and seed, made once."""
        whose = run["target"], run["seed"]
        if whose not in self.made:
            self.made[whose] = make_first_plan(opened, tell)
        return self.made[whose]

    def figures(self, painted: Painted, picture: Tensor, *scene: Target) -> Mapping[str, float]:
        """Measures the true canvas and the plan beside the photograph."""
        wanted, forecast = images.fit(scene[0].picture, *painted.planned.shape[1:]), painted.run.forecast(painted.plan)
        assert forecast is not None  # the goal is a photograph
        return {
            SIMILARITY: psnr(painted.truth, wanted),
            PLANNED: psnr(painted.planned, wanted),
            EXPECTED: forecast.expected,
        }
