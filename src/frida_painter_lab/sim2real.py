"""Experiment: the gap between a painting and its simulation, for three planners (paper, Fig. "sim2real gap").

Three planners plan the same target: (a) ours; (b) unconstrained soft strokes of any size, opacity and colour, as in
Huang et al. 2019; (c) soft strokes within the limits of a brush, opaque and in a few paints, as in Schaldenbrand
and Oh 2021. All minimise the same squared difference. The same virtual robot paints all plans, without looks.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from frida_painter import images
from frida_painter.plan import Plan
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter_lab.comparison import Comparison, PaintingWay, Scene
from frida_painter_lab.measures import mse
from frida_painter_lab.paintings import Painted, StudioRun, Tell, make_first_plan
from frida_painter_lab.soft_strokes import SoftEffort, allow_any_stroke, as_plan, constrain_to_brush, plan_soft_strokes
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
    MEASURES: ClassVar[Mapping[str, bool | None]] = {
        "gap": False,
        "simulated to target": False,
        "painted to target": False,
    }
    SHOWN = ("simulated", "painting")

    photos: tuple[Target, ...]
    seeds: tuple[int, ...] = (0, 1, 2)

    def scenes(self) -> Sequence[Scene]:
        """Returns the photographs."""
        return [(photo,) for photo in self.photos]

    def ways(self) -> Sequence[PaintingWay]:
        """Returns the planners; each rival is compared with ours."""
        return [PaintingWay(OURS), PaintingWay(UNCONSTRAINED, OURS), PaintingWay(CONSTRAINED, OURS)]

    def make_plan(self, run: StudioRun, opened: PaintingRun, tell: Tell) -> tuple[Plan, Tensor]:
        """Plans with soft strokes, and converts them to strokes of the robot; ours plans as usual."""
        if run["painted"] == OURS:
            return make_first_plan(opened, tell)
        spec, model, bare = opened.spec, opened.planner.models[opened.planner.kinds[0]], opened.planner.bare
        held = run["painted"] == CONSTRAINED
        made = plan_soft_strokes(
            images.fit(self.scene_of(run)[0].picture, *bare.shape[1:]),
            spec.canvas,
            constrain_to_brush(model, spec.canvas) if held else allow_any_stroke(spec.canvas),
            spec.strokes,
            colors=spec.colors if held else None,
            effort=SoftEffort().scale(spec.effort),
            seed=spec.seed,
            notify=tell,
        )
        return as_plan(made.strokes, model, spec.canvas, spec.colors, bare, spec.seed), made.picture

    def figures(self, painted: Painted, picture: Tensor, *scene: Target) -> Mapping[str, float]:
        """Measures the distances between simulation, photograph of the painting, and target."""
        wanted = images.fit(scene[0].picture, *picture.shape[1:])
        pairs = ((painted.planned, picture), (painted.planned, wanted), (picture, wanted))
        return {name: mse(*pair) for name, pair in zip(self.MEASURES, pairs, strict=True)}
