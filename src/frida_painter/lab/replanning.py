"""Experiment: a painting with and without looks. How far does it stray from its first plan, and from its target?

After every batch of strokes the canvas is photographed, and the expected picture is computed: the photograph with
the remaining plan on top. Its difference from the first plan is the deviation (paper, Fig. "deviation from the
initial plan"), its difference from the target the error. With looks, the remaining plan is replanned on each
photograph; without, it stays the same.

A painter who looks also learns the placement of the robot. To separate this from replanning, a robot with known
placement paints the same.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from torch import Tensor

from frida_painter import images
from frida_painter.lab import paintings
from frida_painter.lab.paintings import PLACEMENT, Painted, PaintingTrial
from frida_painter.lab.targets import Target
from frida_painter.lab.trials import Experiment, Measurement, Outcome, Results, ResultTable, Row, mse, psnr
from frida_painter.report.chart import Series, chart
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.runs.spec import RunSpec

NAME = "replanning"
LOOKING, BLIND = "with replanning", "without looking"
KNOWN_LOOKING, KNOWN_BLIND = "placement known, with replanning", "placement known, without looking"
WAYS = (BLIND, LOOKING, KNOWN_BLIND, KNOWN_LOOKING)
DEVIATION, ERROR, SIMILARITY = "deviation", "error", "PSNR, dB"
FULL = RunSpec.of(strokes=195, layers=1, colors=12, replans=12)
QUICK = RunSpec.of(strokes=9, colors=3, render_height=64, effort=0.05, replans=2)


def experiment(target: Target, *, seeds: Sequence[int] = (0, 1, 2), scale: RunSpec = FULL) -> Experiment[PaintingTrial]:
    """Returns the experiment: the target painted four times per seed, from the same first plan.

    The four ways are with and without looks, by a robot with a small placement error and by one without.
    Without looks the canvas is photographed as for a film, which has no effect.
    """
    every = scale.strokes // (scale.replans + 1)
    points = [*range(0, scale.strokes, every), scale.strokes]
    looks: dict[str, Any] = {"replan_policy": f"every:{every}"}
    film: dict[str, Any] = {"replans": 0, "film": True}
    ways = {
        BLIND: (film, ()),
        LOOKING: (looks, ()),
        KNOWN_BLIND: (film, (PLACEMENT,)),
        KNOWN_LOOKING: (looks, (PLACEMENT,)),
    }

    def measure(trial: PaintingTrial, painted: Painted) -> Measurement:
        """Measures how the expected picture differs from the first plan and the target, during the painting.

        The differences are given for certain numbers of strokes. Frames of a film come at slightly different
        numbers, so the values are interpolated.
        """
        wanted = images.fit(target.picture, *painted.planned.shape[1:])
        numbers = {SIMILARITY: psnr(painted.truth, wanted)}
        seen = sorted(painted.expected)
        for what, than in ((DEVIATION, painted.expected[0]), (ERROR, wanted)):
            known = np.interp(points, seen, [mse(painted.expected[done], than) for done in seen])
            numbers |= {f"{what} {done}": float(value) for done, value in zip(points, known, strict=True)}
        return Measurement(numbers, {"plan": painted.expected[0], "painting": painted.photograph})

    def report(results: Results) -> Outcome:
        rows: list[Row] = [
            {"seed": seed, "painted": way, "strokes": done, **_point(results.one(seed=seed, painted=way), done)}
            for seed in seeds
            for way in WAYS
            for done in points
        ]
        summary: list[Row] = [
            {
                "painted": way,
                "deviation at the end": results.mean(f"{DEVIATION} {points[-1]}", painted=way),
                "error of the first plan": results.mean(f"{ERROR} 0", painted=way),
                "error at the end": results.mean(f"{ERROR} {points[-1]}", painted=way),
                SIMILARITY: results.mean(SIMILARITY, painted=way),
            }
            for way in WAYS
        ]
        return Outcome(
            NAME,
            f"{target.name.capitalize()}, painted with and without looking",
            {"target": target.name, "seeds": tuple(seeds), **paintings.settings(scale)},
            (ResultTable("At the end, mean over the seeds", tuple(summary)),
             ResultTable("After every look", tuple(rows))),
            _notes(results, scale.replans),
            {
                "deviation": _curve("Deviation from the first plan", DEVIATION, results, points),
                "error": _curve("Error of the picture to be expected", ERROR, results, points),
                "paintings": _sheet(target, results, seeds[0]),
            },
        )  # fmt: skip

    trials = [
        PaintingTrial.of(
            {"seed": seed, "painted": way},
            paintings.like(scale, target.picture, [{"image": str(target.path)}], seed, **changes),
            without=without,
        )
        for seed in seeds
        for way, (changes, without) in ways.items()
    ]
    return paintings.experiment(trials, measure, report)


def _point(found: Measurement, done: int) -> Row:
    return {what: found.numbers[f"{what} {done}"] for what in (DEVIATION, ERROR)}


def _notes(results: Results, looks: int) -> tuple[str, ...]:
    """Returns sentences on the gain of a known placement and the gain of replanning, each alone."""

    def wins(way: str, than: str) -> str:
        gains = np.array(results.values(SIMILARITY, painted=way)) - results.values(SIMILARITY, painted=than)
        return f"{gains.mean():+.2f} dB ({(gains > 0).sum()} of {len(gains)} seeds are better)"

    return (
        f"Knowing the placement from the start wins {wins(KNOWN_BLIND, BLIND)}.",
        f"Planning again after {looks} looks wins {wins(KNOWN_LOOKING, KNOWN_BLIND)} where the placement is known.",
        f"Where it is not, {looks} looks win {wins(LOOKING, BLIND)}, with what they tell of the placement.",
    )


def _curve(title: str, what: str, results: Results, points: Sequence[int]) -> Tensor:
    """Returns a chart of the mean over the seeds, with their range as a band."""
    lines = []
    for way in WAYS:
        values = np.array([results.values(f"{what} {done}", painted=way) for done in points])
        mean, least, most = values.mean(1).tolist(), values.min(1).tolist(), values.max(1).tolist()
        lines.append(Series(way, [float(done) for done in points], mean, least, most, band=True))
    to = "the first plan" if what == DEVIATION else "the target"
    return chart(title, "strokes painted", f"mean squared difference to {to}; band: all seeds", lines)


def _sheet(target: Target, results: Results, seed: int) -> Tensor:
    found = {way: results.one(seed=seed, painted=way) for way in WAYS}
    plan = found[BLIND].pictures["plan"]
    cells = [Cell(images.fit(target.picture, *plan.shape[1:]), "target"), Cell(plan, "first plan")]
    cells += [Cell(one.pictures["painting"], f"{way}: {one.numbers[SIMILARITY]:.2f} dB") for way, one in found.items()]
    lines = [FigureRow("", cells[:3]), FigureRow("", cells[3:])]
    return page("", (), lines, width=340)
