"""How far a painting is from its simulation, for three planners and one robot (paper, Fig. "sim2real gap").

The same target is planned with (a) our planner; (b) unconstrained soft strokes of any size, opacity
and colour, in the manner of Huang et al. 2019; (c) soft strokes held to what a brush can do, opaque
and in a few paints, in the manner of Schaldenbrand and Oh 2021. All pursue the same squared
difference. The same virtual robot paints all plans, without looking in between.
"""

from collections.abc import Sequence

import numpy as np
from torch import Tensor

from frida_painter import images
from frida_painter.experiments import paintings, robot_strokes, soft_planner
from frida_painter.experiments.measures import mse
from frida_painter.experiments.outcome import Outcome, ResultTable, Row
from frida_painter.experiments.paintings import MakePlan, Painted, PaintingTrial, Tell
from frida_painter.experiments.soft_planner import SoftEffort
from frida_painter.experiments.soft_strokes import Freedom
from frida_painter.experiments.targets import Target
from frida_painter.experiments.trials import Experiment, Measurement, Results
from frida_painter.frames import CanvasSize
from frida_painter.plan import Plan
from frida_painter.report.figure_sheet import Cell, FigureRow, page
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec

NAME = "sim2real"
OURS, UNCONSTRAINED, CONSTRAINED = "ours", "unconstrained", "constrained"
PLANNERS = (OURS, UNCONSTRAINED, CONSTRAINED)
MANNER = {
    OURS: "ours",
    UNCONSTRAINED: "unconstrained (as Huang et al. 2019)",
    CONSTRAINED: "constrained (as Schaldenbrand & Oh 2021)",
}
FULL = RunSpec.of(strokes=120, layers=1, colors=12, replans=0)
QUICK = RunSpec.of(strokes=8, colors=3, render_height=64, effort=0.05, replans=0)


def experiment(
    targets: Sequence[Target], *, seeds: Sequence[int] = (0, 1, 2), scale: RunSpec = FULL
) -> Experiment[PaintingTrial]:
    """Plans and paints every target with every planner, once per seed, on the same easel for all planners."""
    pictures = {target.name: target.picture for target in targets}

    def measure(trial: PaintingTrial, painted: Painted) -> Measurement:
        simulated, photograph = painted.planned, painted.photograph
        wanted = images.fit(pictures[trial["target"]], *photograph.shape[1:])
        numbers = {
            "gap": mse(simulated, photograph),
            "simulated to target": mse(simulated, wanted),
            "painted to target": mse(photograph, wanted),
        }
        return Measurement(numbers, {"simulated": simulated, "painted": photograph})

    def report(results: Results) -> Outcome:
        summary = [_summary(name, planner, results) for name in pictures for planner in PLANNERS]
        return Outcome(
            NAME,
            "The gap between simulated and painted pictures",
            {"targets": tuple(pictures), "seeds": tuple(seeds), **paintings.settings(scale)},
            (
                ResultTable("Mean squared differences, mean over the seeds", tuple(summary)),
                ResultTable("All paintings", results.rows()),
            ),
            _notes(summary),
            {NAME: _sheet(targets, results, seeds[0])},
        )

    trials = [
        PaintingTrial.of(
            {"target": target.name, "seed": seed, "planner": planner},
            paintings.like(scale, target.picture, [{"image": str(target.path)}], seed),
            _soft(target, planner) if planner != OURS else None,
        )
        for target in targets
        for seed in seeds
        for planner in PLANNERS
    ]
    return paintings.experiment(trials, measure, report)


def _soft(target: Target, planner: str) -> MakePlan:
    """What plans with soft strokes, and makes the robot's strokes of them."""

    def make_plan(run: PaintingRun, tell: Tell) -> tuple[Plan, Tensor]:
        spec, model, bare = run.spec, run.planner.models[run.planner.brushes[0]], run.planner.bare
        held = planner == CONSTRAINED
        made = soft_planner.plan(
            images.fit(target.picture, *bare.shape[1:]),
            spec.canvas,
            robot_strokes.held_to(model, spec.canvas) if held else unconstrained(spec.canvas),
            spec.strokes,
            colors=spec.colors if held else None,
            effort=SoftEffort().scaled(spec.effort),
            seed=spec.seed,
            notify=tell,
        )
        plan = robot_strokes.as_plan(made.strokes, model, spec.canvas, spec.colors, bare, spec.seed)
        return plan, made.picture

    return make_plan


def unconstrained(size: CanvasSize) -> Freedom:
    """Strokes from a hair to half the canvas, of any opacity."""
    return Freedom(
        length=(0.001, size.width + size.height),
        radius=(0.0008, 0.25 * min(size.width, size.height)),
        bow=(-size.width, size.width),
        opacity=(0.0, 1.0),
        tapered=True,
    )


def _summary(target: str, planner: str, results: Results) -> Row:
    gap = results.values("gap", target=target, planner=planner)
    return {
        "target": target,
        "planner": MANNER[planner],
        "gap": float(np.mean(gap)),
        "gap, least": min(gap),
        "gap, most": max(gap),
        "gap / ours": float(np.mean(gap)) / results.mean("gap", target=target, planner=OURS),
        **{
            name: results.mean(name, target=target, planner=planner)
            for name in ("simulated to target", "painted to target")
        },
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


def _sheet(targets: Sequence[Target], results: Results, seed: int) -> Tensor:
    """Every target beside what each planner meant to paint and what came of it."""
    lines = []
    for target in targets:
        findings = [results.one(target=target.name, seed=seed, planner=planner) for planner in PLANNERS]
        cells = [Cell(images.fit(target.picture, *findings[0].pictures["painted"].shape[1:]), target.name)]
        for finding in findings:
            cells.append(Cell(finding.pictures["simulated"], "simulated"))
            cells.append(Cell(finding.pictures["painted"], f"painted, gap {finding.numbers['gap']:.4f}"))
        lines.append(FigureRow("", cells))
    headings = ["target", *(words for planner in PLANNERS for words in (MANNER[planner].split(" (")[0], ""))]
    return page("Simulated and painted, without looking in between", headings, lines, width=210)
