"""Real strokes beside the modelled ones (paper, Fig. "real versus modelled strokes", there on 50 samples).

Some strokes of a library are held out; every model learns from the rest, and is compared with the
fitted Bezier model on the strokes held out, stroke by stroke.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.library import StrokeLibrary
from frida_painter.errors import LibraryError
from frida_painter.experiments.outcome import Notify, Outcome, Progress, ResultTable, Row, silent
from frida_painter.experiments.rivals import BEZIER, LEARNED, PairedTest, errors, learn
from frida_painter.experiments.scale import ExperimentScale
from frida_painter.report.figure_sheet import Cell, FigureRow, page

NAME = "stroke-model"
FEWEST_STROKES = 12
_MOST_SHARE = 0.4
_SHOWN = 8  # strokes in the picture


FULL = ExperimentScale(strokes=200, held_out=50)
QUICK = ExperimentScale(strokes=16, held_out=6, quick=True)


def run(
    library: StrokeLibrary, name: str, *, seed: int = 0, scale: ExperimentScale = FULL, notify: Notify = silent
) -> Outcome:
    """Learns from a library called `name` and tests on strokes held out. Raises LibraryError where it is too small."""
    if len(library) < FEWEST_STROKES:
        raise LibraryError(
            f"The stroke library has {len(library)} strokes; comparing models on strokes held out takes at least "
            f"{FEWEST_STROKES}, and 50 held out of 200 for figures that mean something."
        )
    order = np.random.default_rng(seed).permutation(len(library))
    held_out = min(scale.held_out, int(_MOST_SHARE * len(library)))
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
    """Strokes from the one that the first model does best to the one it does worst, evenly spaced."""
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
    """A magnitude map [rows, columns] as dark paint on white paper [3, rows, columns]."""
    return (1 - 0.96 * magnitude.clamp(0, 1)).expand(3, -1, -1)
