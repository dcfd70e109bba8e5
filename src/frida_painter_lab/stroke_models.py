"""Experiments about stroke models: what each has learned from a stroke library, on strokes that are held out.

`stroke-model` compares them stroke by stroke (paper, Fig. "real versus modelled strokes", there on 50 samples).
`strokes-needed` asks how many strokes a model needs (paper, Fig. "param2stroke error"), on several splits of one
library, and compares all models on all of them.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush import DEFAULT_MODEL, FEWEST_STROKES, MODELS
from frida_painter.brush.kinds import StrokeModel, brush_kind, median_of
from frida_painter.brush.library import StrokeLibrary, clean, resample
from frida_painter.easel.dialogue import lead
from frida_painter.easel.virtual_easel import open_virtual_easel
from frida_painter.errors import LibraryError
from frida_painter.report.chart import Series, chart
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter_calibration.procedures.strokes import StrokesProgress, strokes
from frida_painter_calibration.teaching import evaluation as training
from frida_painter_calibration.teaching.bezier import BezierStroke, RibbonShape, fit_bezier
from frida_painter_lab.experiment import Experiment, Measurement, Notify, Progress, Results, ResultTable, Row
from frida_painter_lab.runs import Run, Value
from frida_painter_lab.statistics import Result, paired_tests

ZEROS, MEAN, BEZIER = "all zeros", "mean stroke", "fitted Bezier"
LEARNED = (DEFAULT_MODEL, *(name for name in MODELS if name != DEFAULT_MODEL))
RIVALS = (ZEROS, MEAN, BEZIER, *reversed(LEARNED))
Predict = Callable[[StrokeLibrary], Tensor]
"""Returns the marks of a library's strokes by their shapes, on the library's cells."""
_BATCH = 32
_SHOWN = 8  # strokes in a picture


def learn(rival: str, library: StrokeLibrary, *, seed: int, quick: bool = False) -> Predict:
    """Learns a rival model from the library, and returns what predicts marks.

    quick: True for minimal training, as a test
    """
    if rival == ZEROS:
        return lambda other: torch.zeros(other.magnitude.shape)
    if rival == MEAN:
        mean = torch.from_numpy(library.magnitude.mean(0)).float() / 255
        return lambda other: mean.expand(len(other), -1, -1)
    return predict_with(learn_model(rival, library, seed=seed, quick=quick))


def learn_model(rival: str, library: StrokeLibrary, *, seed: int, quick: bool = False) -> StrokeModel:
    """Returns the stroke model of a rival that has one, learned from the clean strokes of the library.

    Raises LibraryError if there are too few of them.
    """
    if rival != BEZIER:
        return training.learn(rival, library, seed=seed, hasty=quick).model
    frame, limits = training.geometry(library)
    ribbon = BezierStroke(training.OTHER_BRUSH, frame, limits, RibbonShape.typical(0.25 * (frame.top - frame.bottom)))
    fit_bezier(ribbon, clean(library), seed=seed, steps=4 if quick else 150)
    return ribbon


def predict_with(model: StrokeModel) -> Predict:
    """Returns what predicts marks by a stroke model: its medians if it has them."""
    median = median_of(model)

    @torch.no_grad()
    def predict(library: StrokeLibrary) -> Tensor:
        parts = zip(*(torch.split(part, _BATCH) for part in library.shapes()), strict=True)
        return torch.cat([resample(median(*part), model.frame, library.frame) for part in parts])

    return predict


def errors(marks: Tensor, library: StrokeLibrary) -> NDArray[np.float64]:
    """Returns the mean absolute error of predicted marks over the whole stored crop of each stroke, [n]."""
    wanted = torch.from_numpy(library.magnitude).float() / 255
    return (marks - wanted).abs().mean((1, 2)).double().numpy()


def fingerprint(library: StrokeLibrary) -> str:
    """Returns the sha256 of everything that a model learns from."""
    content = hashlib.sha256(repr((library.metres_per_pixel, library.origin_px)).encode())
    for part in (library.magnitude, library.length_m, library.bend_m, library.thickness):
        content.update(np.ascontiguousarray(part).tobytes())
    return content.hexdigest()


@dataclass(frozen=True, kw_only=True)
class LibraryExperiment(Experiment):
    """Experiment whose runs each learn one model from some strokes of a library, and test it on held-out ones.

    FULL, QUICK: number of strokes of a library that is painted for it, and of those that are held out
    FEWEST: strokes that a library must have besides those that are held out

    library: file, library, or None for one that is painted in the virtual studio
    title: name of the library
    """

    FULL: ClassVar[tuple[int, int]]
    QUICK: ClassVar[tuple[int, int]]
    FEWEST: ClassVar[int]

    library: Path | StrokeLibrary | None = None
    title: str = ""

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
            seed = getattr(self, "seed", 0)
            easel, kind = open_virtual_easel(self.brush, seed), brush_kind(self.brush)
            painting = strokes(easel, kind, count=count, seed=seed, notify=hear)
            painted = lead(painting, lambda question: question.proposal or False).library
            ready = replace(self, library=painted, title=f"virtual {self.brush} brush")
        if len(ready.known) < ready.held_out + self.FEWEST:
            raise LibraryError(
                f"The stroke library has {len(ready.known)} strokes, some of which are held out for the test; give one "
                f"of at least {ready.held_out + self.FEWEST}."
            )
        return ready

    def settings(self) -> Mapping[str, Value | Sequence[Value]]:
        """Returns the library, and the amounts of strokes."""
        return {"library": self.title, "strokes": len(self.known), "held out": self.held_out}

    @cached_property
    def content(self) -> Mapping[str, object]:
        """Content of the library, and the amounts, as a run depends on them."""
        return {"library": fingerprint(self.known), "held out": self.held_out, "quick": self.quick}


@dataclass(frozen=True, kw_only=True)
class StrokeModels(LibraryExperiment):
    """Experiment `stroke-model`: every model on the same held-out strokes, with paired tests against the Bezier."""

    NAME = "stroke-model"
    TITLE = "Real and modelled strokes"
    FULL = 200, 50
    QUICK = 16, 6
    FEWEST = 6

    seed: int = 0

    @property
    def held_out(self) -> int:
        """Number of strokes that no model learns from: of a small library at most two fifths."""
        return min(super().held_out, int(0.4 * len(self.known)))

    @cached_property
    def split(self) -> tuple[StrokeLibrary, StrokeLibrary]:
        """Strokes to learn from, and held-out ones."""
        order = np.random.default_rng(self.seed).permutation(len(self.known))
        return self.known[order[self.held_out :]], self.known[order[: self.held_out]]

    def runs(self) -> Sequence[Run]:
        """Returns a run for each model."""
        return [Run({"model": model, "seed": self.seed}, self.content) for model in (*LEARNED, BEZIER)]

    def measure(self, run: Run, notify: Notify) -> Measurement:
        """Measures the error of each held-out stroke; the picture has their marks, one below the other."""
        notify(Progress(0.0, f"learning: {run['model']}"))
        known, test = self.split
        marks = learn(run["model"], known, seed=self.seed, quick=self.quick)(test)
        numbers = {str(number): error for number, error in enumerate(errors(marks, test).tolist())}
        return Measurement(numbers, {"marks": marks.clamp(0, 1).flatten(0, 1).expand(3, -1, -1)})

    def settings(self) -> Mapping[str, Value | Sequence[Value]]:
        """Returns the library and the split."""
        return {**super().settings(), "seed": self.seed}

    def tables(self, results: Results) -> Sequence[ResultTable]:
        """Returns the errors of each model, and paired tests against the Bezier, corrected by Holm's method."""
        error = _errors_by_model(results)
        found = [
            Result({"model": model, "stroke": number}, one)
            for model, its in error.items()
            for number, one in enumerate(its.tolist())
        ]
        tests = {test.first: test for test in paired_tests(found, ["model"]) if test.second == BEZIER}
        rows: list[Row] = []
        for model, its in error.items():
            test = tests.get(model)
            rows.append({
                "model": model,
                "mean L1": float(its.mean()),
                "standard deviation": float(its.std(ddof=1)),
                "best stroke": float(its.min()),
                "worst stroke": float(its.max()),
                f"better than {BEZIER} on": f"{test.more} of {len(its)}" if test else None,
                "p, paired t-test": test.t if test else None,
                "p, Wilcoxon": test.wilcoxon if test else None,
            })  # fmt: skip
        return [ResultTable(f"Mean absolute error on {self.held_out} strokes held out", rows)]

    def pictures(self, results: Results) -> Mapping[str, Tensor]:
        """Returns a sheet of strokes from the default model's best to its worst, evenly spaced."""
        error, test = _errors_by_model(results), self.split[1]
        ranked = np.argsort(error[DEFAULT_MODEL])
        chosen = ranked[np.linspace(0, len(ranked) - 1, min(_SHOWN, len(ranked))).round().astype(int)]
        real = torch.from_numpy(test.magnitude).float() / 255
        lines = [FigureRow("real", [Cell(as_ink(real[index])) for index in chosen])]
        for model, its in error.items():
            marks = results.one(model=model).pictures["marks"][0].view(real.shape)
            cells = [Cell(as_ink(marks[index]), f"L1 {its[index]:.4f}") for index in chosen]
            lines.append(FigureRow(f"{model}\nmean {its.mean():.4f}", cells))
        title = f"Strokes held out, from the one that {DEFAULT_MODEL} does best to the one it does worst"
        return {self.NAME: page(title, (), lines, width=170)}


def _errors_by_model(results: Results) -> dict[str, NDArray[np.float64]]:
    return {str(labels["model"]): np.array(list(one.numbers.values())) for labels, one in results.found}


def as_ink(magnitude: Tensor) -> Tensor:
    """Returns a magnitude map [rows, columns] as dark paint on white paper [3, rows, columns]."""
    return (1 - 0.96 * magnitude.clamp(0, 1)).expand(3, -1, -1)


@dataclass(frozen=True, kw_only=True)
class StrokesNeeded(LibraryExperiment):
    """Experiment `strokes-needed`: every model from few and many strokes, on several seeded splits of a library.

    SIZES: numbers of strokes for training and validation, besides all that are not held out
    """

    NAME = "strokes-needed"
    TITLE = "Error against the number of strokes"
    FULL = 200, 42
    QUICK = 16, 4
    FEWEST = FEWEST_STROKES + 1
    SIZES: ClassVar[tuple[int, ...]] = (6, 10, 25, 50, 100, 150)

    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)

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
        if model not in LEARNED:
            predict = learn(model, known, seed=split, quick=self.quick)
            return Measurement({"error": float(errors(predict(test), test).mean())})
        learned = learn_model(model, known, seed=split, quick=self.quick)
        foretold = training.likelihood(learned, test)
        return Measurement(
            {
                "error": float(errors(predict_with(learned)(test), test).mean()),
                "log likelihood": foretold.predicted,
                "with one variance": foretold.constant,
            }
        )

    def settings(self) -> Mapping[str, Value | Sequence[Value]]:
        """Returns the library, the splits and the numbers of strokes."""
        return {**super().settings(), "seeds": self.seeds}

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
