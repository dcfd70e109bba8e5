"""Experiment: a painting with and without looks. How far does it stray from its first plan, and from its target?

After every batch of strokes the canvas is photographed, and the expected picture is computed: the photograph with
the remaining plan on top. Its difference from the first plan is the deviation (paper, Fig. "deviation from the
initial plan"), its difference from the target the error. With looks, the remaining plan is replanned on each
photograph; without, it stays the same.

A painter who looks also learns the placement of the robot. To separate this from replanning, a robot with known
placement paints the same.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from torch import Tensor

from frida_painter import images
from frida_painter.report.chart import Series, chart
from frida_painter.runs.spec import RunSpec
from frida_painter_lab.comparison import Comparison, PaintingWay, Scene
from frida_painter_lab.experiment import Results, ResultTable, Row
from frida_painter_lab.measures import mse, psnr
from frida_painter_lab.paintings import PLACEMENT, Painted
from frida_painter_lab.targets import Target

LOOKING, BLIND = "with replanning", "without looking"
KNOWN_LOOKING, KNOWN_BLIND = "placement known, with replanning", "placement known, without looking"
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

    photo: Target
    seeds: tuple[int, ...] = (0, 1, 2)

    def scenes(self) -> Sequence[Scene]:
        """Returns the photograph."""
        return [(self.photo,)]

    def ways(self) -> Sequence[PaintingWay]:
        """Returns the four ways."""
        looks: dict[str, Any] = {"replan_policy": f"every:{self._batch}"}
        film: dict[str, Any] = {"replans": 0, "film": True}
        return [
            PaintingWay(BLIND, changes=film),
            PaintingWay(LOOKING, BLIND, changes=looks),
            PaintingWay(KNOWN_BLIND, BLIND, changes=film, without=(PLACEMENT,)),
            PaintingWay(KNOWN_LOOKING, KNOWN_BLIND, changes=looks, without=(PLACEMENT,)),
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
        """Returns the two curves, and the paintings of the first seed."""
        curves = (
            (DEVIATION, "Deviation from the first plan"),
            (ERROR, "Error of the picture to be expected"),
        )
        drawn = {what: self._curve(title, what, results) for what, title in curves}
        return {**drawn, "paintings": super().pictures(results)[self.NAME]}

    def _curve(self, title: str, what: str, results: Results) -> Tensor:
        """Returns a chart of the mean over the seeds, with their range as a band."""
        lines = []
        for way in self.ways():
            values = np.array([results.values(f"{what} {done}", painted=way.name) for done in self.points])
            mean, least, most = values.mean(1).tolist(), values.min(1).tolist(), values.max(1).tolist()
            lines.append(Series(way.name, [float(done) for done in self.points], mean, least, most, band=True))
        return chart(title, "strokes painted", "mean squared difference; band: all seeds", lines)
