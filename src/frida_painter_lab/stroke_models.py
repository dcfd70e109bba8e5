"""Experiment about stroke models: what each has learned from a stroke library, on strokes that are held out.

`strokes-needed` asks how many strokes a model needs (paper, Fig. "param2stroke error"), on several splits of one
library, and compares all models on all of them (paper, Fig. "real versus modelled strokes").
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush import DEFAULT_MODEL, FEWEST_STROKES, MODELS
from frida_painter.brush.kinds import StrokeModel, brush_kind
from frida_painter.brush.library import StrokeLibrary, clean
from frida_painter.easel.dialogue import lead
from frida_painter.easel.virtual_easel import open_virtual_easel
from frida_painter.errors import LibraryError
from frida_painter.report.chart import Series, chart
from frida_painter_calibration.procedures.strokes import StrokesProgress, strokes
from frida_painter_calibration.teaching import evaluation as training
from frida_painter_calibration.teaching.bezier import BezierStroke, RibbonShape, fit_bezier
from frida_painter_lab.experiment import Experiment, Measurement, Notify, Progress, Results, ResultTable, Row
from frida_painter_lab.runs import Run, Value

ZEROS, MEAN, BEZIER = "all zeros", "mean stroke", "fitted Bezier"
LEARNED = (DEFAULT_MODEL, *(name for name in MODELS if name != DEFAULT_MODEL))
RIVALS = (ZEROS, MEAN, BEZIER, *reversed(LEARNED))


def find_errors(
    rival: str, library: StrokeLibrary, test: StrokeLibrary, *, seed: int, quick: bool = False
) -> tuple[NDArray[np.float64], StrokeModel | None]:
    """Returns the mean absolute error [n] of a rival that learned from a library, on other strokes, and its model.

    quick: True for minimal training, as a test
    Raises LibraryError if there are too few clean strokes.
    """
    if rival in (ZEROS, MEAN):
        marks = 0.0 if rival == ZEROS else library.magnitude.mean(0)
        return np.abs(marks - test.magnitude).mean((1, 2)) / 255, None
    if rival != BEZIER:
        model: StrokeModel = training.learn(rival, library, seed=seed, hasty=quick).model
    else:
        frame, limits = training.geometry(library)
        shape = RibbonShape.typical(0.25 * (frame.top - frame.bottom))
        model = ribbon = BezierStroke(training.OTHER_BRUSH, frame, limits, shape)
        fit_bezier(ribbon, clean(library), seed=seed, steps=4 if quick else 150)
    return training.errors(model, test), model


def fingerprint(library: StrokeLibrary) -> str:
    """Returns the sha256 of everything that a model learns from."""
    content = hashlib.sha256(repr((library.metres_per_pixel, library.origin_px)).encode())
    for part in (library.magnitude, library.length_m, library.bend_m, library.thickness):
        content.update(np.ascontiguousarray(part).tobytes())
    return content.hexdigest()


@dataclass(frozen=True, kw_only=True)
class StrokesNeeded(Experiment):
    """Experiment `strokes-needed`: every model from few and many strokes, on several seeded splits of a library.

    FULL, QUICK: number of strokes of a library that is painted for it, and of those that are held out
    SIZES: numbers of strokes for training and validation, besides all that are not held out

    library: file, library, or None for one that is painted in the virtual studio
    title: name of the library
    """

    NAME = "strokes-needed"
    TITLE = "Error against the number of strokes"
    FULL: ClassVar[tuple[int, int]] = (200, 42)
    QUICK: ClassVar[tuple[int, int]] = (16, 4)
    SIZES: ClassVar[tuple[int, ...]] = (6, 10, 25, 50, 100, 150)

    library: Path | StrokeLibrary | None = None
    title: str = ""
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)

    @property
    def heading(self) -> str:
        """One line for people, with the library."""
        return f"{self.TITLE}: {self.title}"

    @property
    def known(self) -> StrokeLibrary:
        """Library of a prepared experiment."""
        assert isinstance(self.library, StrokeLibrary), "prepare comes first"
        return self.library

    @property
    def held_out(self) -> int:
        """Number of strokes that no model learns from."""
        return (self.QUICK if self.quick else self.FULL)[1]

    def prepare(self, notify: Notify) -> Self:
        """Returns the experiment with its library, loaded or painted. Raises LibraryError if it is too small."""
        ready = self
        if isinstance(self.library, Path):
            ready = replace(self, library=StrokeLibrary.load(self.library), title=self.library.stem)
        elif self.library is None:

            def hear(progress: StrokesProgress) -> None:
                notify(Progress(progress.done / progress.of, "painting a stroke library"))

            count, _ = self.QUICK if self.quick else self.FULL
            easel, kind = open_virtual_easel(self.brush, 0), brush_kind(self.brush)
            painting = strokes(easel, kind, count=count, seed=0, notify=hear)
            painted = lead(painting, lambda question: question.proposal or False).library
            ready = replace(self, library=painted, title=f"virtual {self.brush} brush")
        if len(ready.known) < (fewest := ready.held_out + FEWEST_STROKES + 1):
            raise LibraryError(
                f"The stroke library has {len(ready.known)} strokes, some of which are held out for the test; give one "
                f"of at least {fewest}."
            )
        return ready

    @cached_property
    def content(self) -> Mapping[str, object]:
        """Content of the library, and the amounts, as a run depends on them."""
        return {"library": fingerprint(self.known), "held out": self.held_out, "quick": self.quick}

    @property
    def rest(self) -> int:
        """Number of strokes that are not held out."""
        return len(self.known) - self.held_out

    def cases(self) -> Sequence[tuple[str, int]]:
        """Returns each model with a number of strokes: all rivals with all that are not held out, and some with fewer.

        A quick run has the first size alone.
        """
        sizes = [size for size in self.SIZES[: 1 if self.quick else None] if FEWEST_STROKES <= size < self.rest]
        fewer = [(model, size) for model in (*LEARNED, BEZIER) for size in sizes]
        return [*((rival, self.rest) for rival in RIVALS), *fewer]

    def runs(self) -> Sequence[Run]:
        """Returns a run for each model, number of strokes and split."""
        return [
            Run({"model": model, "strokes": size, "split": split}, self.content)
            for model, size in self.cases()
            for split in self.seeds
        ]

    def measure(self, run: Run, notify: Notify) -> Measurement:
        """Measures the mean error on the held-out strokes, and the likelihood by a model that varies."""
        model, size, split = run["model"], int(run["strokes"]), int(run["split"])
        notify(Progress(0.0, run.words))
        order = np.random.default_rng(split).permutation(len(self.known))
        known, test = self.known[order[:size]], self.known[order[self.rest :]]
        error, learned = find_errors(model, known, test, seed=split, quick=self.quick)
        numbers = {"error": float(error.mean())}
        if model in LEARNED and learned is not None:
            foretold = training.likelihood(learned, test)
            numbers |= {"log likelihood": foretold.predicted, "with one variance": foretold.constant}
        return Measurement(numbers)

    def settings(self) -> Mapping[str, Value | Sequence[Value]]:
        """Returns the library, the splits and the numbers of strokes."""
        return {
            "library": self.title, "strokes": len(self.known), "held out": self.held_out, "seeds": self.seeds,
        }  # fmt: skip

    def tables(self, results: Results) -> Sequence[ResultTable]:
        """Returns the errors of all models, the likelihood of the default one, and the errors from fewer strokes."""
        rows: list[Row] = []
        for model, size in self.cases():
            error = results.values("error", model=model, strokes=size)
            mean = float(np.mean(error))
            rows.append({"model": model, "strokes": size, "error": mean, "least": min(error), "most": max(error)})
        varies: list[Row] = []
        for split in self.seeds:
            one = results.one(model=DEFAULT_MODEL, strokes=self.rest, split=split).numbers
            varies.append({
                "split": split, "mean and variance": one["log likelihood"], "one variance": one["with one variance"],
            })  # fmt: skip
        title = f"Mean absolute error, {len(self.seeds)} splits of {self.rest} + {self.held_out} strokes"
        return [
            ResultTable(title, rows[: len(RIVALS)]),
            ResultTable(f"Log likelihood per cell of strokes held out, by the {DEFAULT_MODEL}", varies),
            ResultTable("The same from fewer strokes", rows[len(RIVALS) :]),
        ]

    def pictures(self, results: Results) -> Mapping[str, Tensor]:
        """Returns the chart of all models that learn."""
        lines = []
        for model in (*LEARNED, BEZIER):
            sizes = sorted(size for name, size in self.cases() if name == model)
            found = [results.values("error", model=model, strokes=size) for size in sizes]
            mean, least, most = ([float(measure(its)) for its in found] for measure in (np.mean, min, max))
            lines.append(Series(model, [float(size) for size in sizes], mean, least, most, band=False))
        told = "mean absolute error on strokes held out (logarithmic); bars: all splits"
        title = f"Strokes needed: {self.title}"
        return {self.NAME: chart(title, "strokes for training and validation", told, lines, logarithmic=True)}
