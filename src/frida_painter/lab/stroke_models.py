"""Experiment: real strokes beside modelled ones (paper, Fig. "real versus modelled strokes", there on 50 samples).

Some strokes of a library are held out. Every model learns from the rest, and is compared with the fitted Bezier
model on the held-out strokes, stroke by stroke.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import stats
from torch import Tensor

from frida_painter.brush import DEFAULT_MODEL, MODELS
from frida_painter.brush.kinds import StrokeModel, median_of
from frida_painter.brush.library import StrokeLibrary, clean, resample
from frida_painter.errors import LibraryError
from frida_painter.lab import ExperimentScale
from frida_painter.lab.trials import Notify, Outcome, Progress, ResultTable, Row, silent
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.teaching import evaluation as training
from frida_painter.teaching.bezier import BezierStroke, RibbonShape, fit_bezier

# Stroke models in comparison, each learned from a stroke library.
# `learn` returns a function from the shapes of a library's strokes to their predicted marks, on the library's cells.
# `errors` compares these with the real marks, and `PairedTest` tests if one model is better than another.

ZEROS, MEAN, BEZIER = "all zeros", "mean stroke", "fitted Bezier"
DEFAULT = DEFAULT_MODEL
LEARNED = (DEFAULT, *(name for name in MODELS if name != DEFAULT))
RIVALS = (ZEROS, MEAN, BEZIER, *reversed(LEARNED))
Predict = Callable[[StrokeLibrary], Tensor]
_BATCH = 32


def learn(rival: str, library: StrokeLibrary, *, seed: int, quick: bool = False) -> Predict:
    """Learns a rival model from the library, and returns a function that predicts the marks of a library's strokes.

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


def fingerprint(library: StrokeLibrary) -> str:
    """Returns the sha256 of everything that a model learns from."""
    content = hashlib.sha256(repr((library.metres_per_pixel, library.origin_px)).encode())
    for part in (library.magnitude, library.length_m, library.bend_m, library.thickness):
        content.update(np.ascontiguousarray(part).tobytes())
    return content.hexdigest()


def predict_with(model: StrokeModel) -> Predict:
    """Returns a function that predicts the marks of a library's strokes with a stroke model.

    The marks are on the library's cells. They are the model's medians if it has them.
    """
    median = median_of(model)

    @torch.no_grad()
    def predict(library: StrokeLibrary) -> Tensor:
        parts = zip(*(torch.split(part, _BATCH) for part in library.shapes()), strict=True)
        return torch.cat([resample(median(*part), model.frame, library.frame) for part in parts])

    return predict


def errors(predict: Predict, library: StrokeLibrary) -> NDArray[np.float64]:
    """Returns the mean absolute error of each stroke's magnitude over the whole stored crop, [n]."""
    wanted = torch.from_numpy(library.magnitude).float() / 255
    return (predict(library) - wanted).abs().mean((1, 2)).double().numpy()


@dataclass(frozen=True)
class PairedTest:
    """Result of two tests on paired errors.

    difference: mean of first minus second
    better: number of pairs in which the first is smaller
    t_p: two-sided p-value of the paired t-test
    wilcoxon_p: p-value of Wilcoxon's signed-rank test, which does not assume a normal distribution

    Both p-values are 1 if all pairs are equal.
    """

    difference: float
    better: int
    t_p: float
    wilcoxon_p: float

    @classmethod
    def of(cls, first: NDArray[np.float64], second: NDArray[np.float64]) -> "PairedTest":
        """Returns the tests of two series of errors [n] on the same n >= 2 items."""
        apart = first - second
        if not apart.any():
            return cls(0.0, 0, 1.0, 1.0)
        return cls(
            float(apart.mean()),
            int((apart < 0).sum()),
            float(stats.ttest_rel(first, second).pvalue),
            float(stats.wilcoxon(first, second).pvalue),
        )


NAME = "stroke-model"
FEWEST_STROKES = 12
_MAX_SHARE = 0.4
_SHOWN = 8  # strokes in the picture


FULL = ExperimentScale(strokes=200, held_out=50)
QUICK = ExperimentScale(strokes=16, held_out=6, quick=True)


def run(
    library: StrokeLibrary, name: str, *, seed: int = 0, scale: ExperimentScale = FULL, notify: Notify = silent
) -> Outcome:
    """Learns from a library and tests on held-out strokes. Raises LibraryError if it is too small.

    name: of the library
    """
    if len(library) < FEWEST_STROKES:
        raise LibraryError(
            f"The stroke library has {len(library)} strokes; comparing models on strokes held out takes at least "
            f"{FEWEST_STROKES}, and 50 held out of 200 for figures that mean something."
        )
    order = np.random.default_rng(seed).permutation(len(library))
    held_out = min(scale.held_out, int(_MAX_SHARE * len(library)))
    test, training = library[order[:held_out]], library[order[held_out:]]
    models = (*LEARNED, BEZIER)
    drawn: dict[str, Tensor] = {}
    error: dict[str, NDArray[np.float64]] = {}
    for number, model in enumerate(models):
        notify(Progress(number / len(models), f"learning: {model}"))
        predict = learn(model, training, seed=seed, quick=scale.quick)
        drawn[model], error[model] = predict(test), errors(predict, test)
    notify(Progress(1.0, "drawing"))
    tests = {model: PairedTest.of(error[model], error[BEZIER]) for model in LEARNED}
    return Outcome(
        NAME,
        f"Real and modelled strokes: {name}",
        {"library": name, "strokes": len(library), "held out": held_out, "seed": seed},
        (
            ResultTable(
                f"Mean absolute error on {held_out} strokes held out", tuple(_row(m, error[m]) for m in models)
            ),
            ResultTable(f"Paired tests against {BEZIER}", tuple(_test_row(m, tests[m], held_out) for m in LEARNED)),
        ),
        tuple(_note(m, tests[m], error[m], error[BEZIER]) for m in LEARNED),
        {NAME: _sheet(test, drawn, error, _SHOWN)},
    )


def _row(model: str, error: NDArray[np.float64]) -> Row:
    return {
        "model": model,
        "mean L1": float(error.mean()),
        "standard deviation": float(error.std(ddof=1)),
        "best stroke": float(error.min()),
        "worst stroke": float(error.max()),
    }


def _test_row(model: str, test: PairedTest, count: int) -> Row:
    return {
        "model": model,
        "mean difference": test.difference,
        "better on": f"{test.better} of {count}",
        "p, paired t-test": test.t_p,
        "p, Wilcoxon": test.wilcoxon_p,
    }


def _note(model: str, test: PairedTest, error: NDArray[np.float64], bezier: NDArray[np.float64]) -> str:
    sure = max(test.t_p, test.wilcoxon_p) < 0.01
    verdict = f"{'better' if test.difference < 0 else 'worse'} than" if sure else "not told apart from"
    return (
        f"{model.capitalize()} is {verdict} the {BEZIER} on strokes held out: mean L1 {error.mean():.4f} against "
        f"{bezier.mean():.4f} (p = {test.t_p:.2g} by the paired t-test, {test.wilcoxon_p:.2g} by Wilcoxon's)."
    )


def _sheet(test: StrokeLibrary, drawn: dict[str, Tensor], error: dict[str, NDArray[np.float64]], shown: int) -> Tensor:
    """Returns a sheet of strokes from the first model's best to its worst, evenly spaced."""
    first = next(iter(drawn))
    ranked = np.argsort(error[first])
    chosen = ranked[np.linspace(0, len(ranked) - 1, min(shown, len(ranked))).round().astype(int)]
    real = torch.from_numpy(test.magnitude).float() / 255
    lines = [FigureRow("real", [Cell(_ink(real[index])) for index in chosen])]
    for model, maps in drawn.items():
        cells = [Cell(_ink(maps[index]), f"L1 {error[model][index]:.4f}") for index in chosen]
        lines.append(FigureRow(f"{model}\nmean {error[model].mean():.4f}", cells))
    title = f"Strokes held out, from the one that {first} does best to the one it does worst"
    return page(title, (), lines, width=170)


def _ink(magnitude: Tensor) -> Tensor:
    """Returns a magnitude map [rows, columns] as dark paint on white paper [3, rows, columns]."""
    return (1 - 0.96 * magnitude.clamp(0, 1)).expand(3, -1, -1)
