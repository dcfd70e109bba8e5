"""Experiments about stroke models: what each has learned from a stroke library, on strokes that are held out.

`stroke-model` compares them stroke by stroke (paper, Fig. "real versus modelled strokes", there on 50 samples).
`strokes-needed` asks how many strokes a model needs (paper, Fig. "param2stroke error"). `real-strokes` is the
project's main table: several splits of one library, every model, and fewer strokes.
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
from frida_painter_lab.runs import Labels, Run, Value
from frida_painter_lab.sweeps.report import FieldEffect, Result, paired_tests

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


def virtual_library(brush: str, count: int, seed: int, notify: Notify) -> StrokeLibrary:
    """Paints a library of `count` strokes of a brush of the project. Raises ConfigError if there is no such brush."""

    def hear(progress: StrokesProgress) -> None:
        notify(Progress(progress.done / progress.of, "painting a stroke library"))

    painting = strokes(open_virtual_easel(brush, seed), brush_kind(brush), count=count, seed=seed, notify=hear)
    return lead(painting, lambda question: question.proposal or False).library


@dataclass(frozen=True)
class Amounts:
    """Amounts of strokes in an experiment.

    strokes: of a library that is painted for it
    held_out: strokes that no model learns from
    sizes: numbers of strokes for training and validation
    """

    strokes: int
    held_out: int
    sizes: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True)
class LibraryExperiment(Experiment):
    """Experiment whose runs each learn one model from some strokes of a library, and test it on held-out ones.

    FULL, QUICK: amounts of strokes

    library: file, library, or None for one that is painted in the virtual studio
    title: name of the library
    amounts: in place of FULL or QUICK
    """

    FULL: ClassVar[Amounts]
    QUICK: ClassVar[Amounts]

    library: Path | StrokeLibrary | None = None
    title: str = ""
    amounts: Amounts | None = None

    @property
    def asked(self) -> Amounts:
        """Amounts of strokes."""
        return self.amounts or (self.QUICK if self.quick else self.FULL)

    @property
    def heading(self) -> str:
        """One line for people, with the library."""
        return f"{self.TITLE}: {self.title}"

    @property
    def known(self) -> StrokeLibrary:
        """Library of a prepared experiment."""
        assert isinstance(self.library, StrokeLibrary), "prepare comes first"
        return self.library

    def prepare(self, notify: Notify) -> Self:
        """Returns the experiment with its library, loaded or painted. Raises LibraryError if it is too small."""
        if isinstance(self.library, Path):
            ready = replace(self, library=StrokeLibrary.load(self.library), title=self.library.stem)
        elif self.library is None:
            painted = virtual_library(self.brush, self.asked.strokes, getattr(self, "seed", 0), notify)
            ready = replace(self, library=painted, title=f"virtual {self.brush} brush")
        else:
            ready = self
        ready.require_strokes()
        return ready

    def require_strokes(self) -> None:
        """Raises LibraryError if the library is too small."""
        self.require(self.asked.held_out + FEWEST_STROKES)

    def require(self, fewest: int) -> None:
        """Raises LibraryError if the library has fewer strokes than that."""
        if len(self.known) < fewest:
            raise LibraryError(
                f"The stroke library has {len(self.known)} strokes, some of which are held out for the test; give one "
                f"of at least {fewest}."
            )

    def settings(self) -> Mapping[str, Value | Sequence[Value]]:
        """Returns the library, and the amounts of strokes."""
        return {"library": self.title, "strokes": len(self.known), "held out": self.asked.held_out}

    @cached_property
    def content(self) -> Mapping[str, object]:
        """Content of the library, and the amounts, as a run depends on them."""
        return {"library": fingerprint(self.known), "amounts": repr(self.asked), "quick": self.quick}


@dataclass(frozen=True, kw_only=True)
class StrokeModels(LibraryExperiment):
    """Experiment `stroke-model`: every model on the same held-out strokes, with paired tests against the Bezier."""

    NAME = "stroke-model"
    TITLE = "Real and modelled strokes"
    FULL = Amounts(200, 50)
    QUICK = Amounts(16, 6)
    FEWEST: ClassVar[int] = 12
    MAX_SHARE: ClassVar[float] = 0.4

    seed: int = 0

    def require_strokes(self) -> None:
        """Raises LibraryError if the library is too small."""
        self.require(self.FEWEST)

    @cached_property
    def split(self) -> tuple[StrokeLibrary, StrokeLibrary]:
        """Strokes to learn from, and held-out ones."""
        order = np.random.default_rng(self.seed).permutation(len(self.known))
        held_out = min(self.asked.held_out, int(self.MAX_SHARE * len(self.known)))
        return self.known[order[held_out:]], self.known[order[:held_out]]

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
        return {**super().settings(), "held out": len(self.split[1]), "seed": self.seed}

    def tables(self, results: Results) -> Sequence[ResultTable]:
        """Returns the errors of each model, and paired tests against the Bezier, corrected by Holm's method."""
        tests = {test.first: test for test in _test_against_bezier(results)}
        rows: list[Row] = []
        for model, its in _errors_by_model(results).items():
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
        return [ResultTable(f"Mean absolute error on {len(self.split[1])} strokes held out", rows)]

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


def _test_against_bezier(results: Results) -> list[FieldEffect]:
    """Returns the change from each learned model to the fitted Bezier, stroke by stroke, with Holm's correction."""
    found = [
        Result({"model": model, "stroke": number}, error)
        for model, its in _errors_by_model(results).items()
        for number, error in enumerate(its.tolist())
    ]
    return [test for test in paired_tests(found, ["model"]) if test.second == BEZIER]


def as_ink(magnitude: Tensor) -> Tensor:
    """Returns a magnitude map [rows, columns] as dark paint on white paper [3, rows, columns]."""
    return (1 - 0.96 * magnitude.clamp(0, 1)).expand(3, -1, -1)


@dataclass(frozen=True, kw_only=True)
class SplitExperiment(LibraryExperiment):
    """Experiment whose runs each learn from some strokes of a split of the library, and are tested on the others."""

    @property
    def splits(self) -> Sequence[int]:
        """Seeds of the splits."""
        raise NotImplementedError

    @property
    def rest(self) -> int:
        """Number of strokes that are not held out."""
        return len(self.known) - self.asked.held_out

    @property
    def sizes(self) -> tuple[int, ...]:
        """Numbers of strokes for training and validation that the library allows."""
        return tuple(size for size in self.asked.sizes if FEWEST_STROKES <= size < self.rest)

    def cases(self) -> Sequence[tuple[str, int]]:
        """Returns each model with a number of strokes."""
        return [(model, size) for model in (*LEARNED, BEZIER) for size in self.sizes]

    def runs(self) -> Sequence[Run]:
        """Returns a run for each model, number of strokes and split."""
        return [
            Run({"model": model, "strokes": size, "split": split}, self.content)
            for model, size in self.cases()
            for split in self.splits
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
        return {**super().settings(), "seeds": list(self.splits), "sizes": self.sizes}


@dataclass(frozen=True, kw_only=True)
class StrokesNeeded(SplitExperiment):
    """Experiment `strokes-needed`: every model from few and many strokes, trained several times on other ones."""

    NAME = "strokes-needed"
    TITLE = "Error against the number of strokes"
    FULL = Amounts(200, 42, (10, 25, 50, 100, 150))
    QUICK = Amounts(16, 4, (6, 10))

    seed: int = 0

    @property
    def splits(self) -> Sequence[int]:
        """Seeds of the splits."""
        return range(self.seed, self.seed + (2 if self.quick else 5))

    def require_strokes(self) -> None:
        """Raises LibraryError if the library is too small for two of the sizes."""
        self.require(self.asked.held_out + sorted(self.asked.sizes)[1] + 1)

    def tables(self, results: Results) -> Sequence[ResultTable]:
        """Returns the errors of each model by the number of strokes."""
        rows: list[Row] = []
        for model, size in self.cases():
            error = results.values("error", model=model, strokes=size)
            log = np.log(error)
            rows.append({
                "model": model, "strokes": size, "error": float(np.exp(log.mean())), "log error": float(log.mean()),
                "log error, standard deviation": float(log.std(ddof=1)), "best": min(error), "worst": max(error),
            })  # fmt: skip
        return [ResultTable(f"Mean absolute error on {self.asked.held_out} strokes held out", rows)]

    def _rows(self, results: Results) -> dict[str, list[Row]]:
        rows = self.tables(results)[0].rows
        return {model: [row for row in rows if row["model"] == model] for model in (*LEARNED, BEZIER)}

    def pictures(self, results: Results) -> Mapping[str, Tensor]:
        """Returns the chart of all models."""
        lines = []
        for model, mine in self._rows(results).items():
            center = np.array([float(row["log error"] or 0) for row in mine])
            spread = np.array([float(row["log error, standard deviation"] or 0) for row in mine])
            low, mean, high = (np.exp(center + sign * spread).tolist() for sign in (-1, 0, 1))
            lines.append(Series(model, [float(row["strokes"] or 0) for row in mine], mean, low, high, band=False))
        told = "mean absolute error on strokes held out (logarithmic); bars: one standard deviation of the trainings"
        title = f"Strokes needed: {self.title}"
        return {self.NAME: chart(title, "strokes for training and validation", told, lines, logarithmic=True)}


@dataclass(frozen=True, kw_only=True)
class RealStrokes(SplitExperiment):
    """Experiment `real-strokes`: every model on several seeded splits of a library, and from fewer strokes."""

    NAME = "real-strokes"
    TITLE = "Errors on strokes held out"
    FULL = Amounts(200, 42, (10, 25, 50, 100, 150))
    QUICK = Amounts(16, 4, (6,))

    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)

    @property
    def splits(self) -> Sequence[int]:
        """Seeds of the splits."""
        return self.seeds

    def cases(self) -> Sequence[tuple[str, int]]:
        """Returns each model with a number of strokes; all rivals with all that are not held out."""
        return [*((rival, self.rest) for rival in RIVALS), *super().cases()]

    def _row(self, results: Results, model: str, size: int) -> Row:
        error = results.values("error", model=model, strokes=size)
        mean = float(np.mean(error))
        return {"model": model, "strokes": size, "error": mean, "least": min(error), "most": max(error)}

    def tables(self, results: Results) -> Sequence[ResultTable]:
        """Returns the errors of all models, the likelihood of the default one, and the errors from fewer strokes."""
        varies = []
        for split in self.splits:
            of: Labels = {"model": DEFAULT_MODEL, "strokes": self.rest, "split": split}
            predicted, constant = (results.mean(name, **of) for name in ("log likelihood", "with one variance"))
            varies.append({"split": split, "mean and variance": predicted, "one variance": constant})
        title = f"Mean absolute error, {len(self.splits)} splits of {self.rest} + {self.asked.held_out} strokes"
        rows = [self._row(results, *case) for case in self.cases()]
        whole, fewer = rows[: len(RIVALS)], rows[len(RIVALS) :]
        return [
            ResultTable(title, whole),
            ResultTable(f"Log likelihood per cell of strokes held out, by the {DEFAULT_MODEL}", varies),
            *([ResultTable("The same from fewer strokes", fewer)] if fewer else []),
        ]
