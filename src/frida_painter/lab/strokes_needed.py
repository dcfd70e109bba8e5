"""Experiment: the number of strokes that a model needs (paper, Fig. "param2stroke error", there tested on 42 strokes).

For every number of strokes the model is trained five times, each time on other strokes and with a different
validation set. It is tested on the same held-out strokes.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from torch import Tensor

from frida_painter.brush import FEWEST_STROKES
from frida_painter.brush.library import StrokeLibrary
from frida_painter.errors import LibraryError
from frida_painter.lab import ExperimentScale
from frida_painter.lab.stroke_models import BEZIER, LEARNED, errors, fingerprint, learn
from frida_painter.lab.trials import (
    Experiment,
    ExperimentTrial,
    Measurement,
    Notify,
    Outcome,
    Progress,
    Results,
    ResultTable,
    Row,
)
from frida_painter.report.chart import Series, chart

NAME = "strokes-needed"


FULL = ExperimentScale(strokes=200, held_out=42, sizes=(10, 25, 50, 100, 150), folds=5)
QUICK = ExperimentScale(strokes=16, held_out=4, sizes=(6, 10), folds=2, quick=True)


def experiment(
    library: StrokeLibrary, name: str, *, seed: int = 0, scale: ExperimentScale = FULL
) -> Experiment[ExperimentTrial]:
    """Returns the experiment on a library. Raises LibraryError if it is too small for two of the sizes.

    name: of the library
    """
    order = np.random.default_rng(seed).permutation(len(library))
    test, pool = library[order[: scale.held_out]], order[scale.held_out :]
    sizes = tuple(size for size in scale.sizes if FEWEST_STROKES <= size <= len(pool))
    if len(sizes) < 2:
        raise LibraryError(
            f"The stroke library has {len(library)} strokes, {scale.held_out} of which are held out for the test; "
            f"give one of at least {scale.held_out + sorted(scale.sizes)[1]}."
        )
    models = (*LEARNED, BEZIER)

    def measure(trial: ExperimentTrial, notify: Notify) -> Measurement:
        model, size, fold = trial["model"], int(trial["strokes"]), int(trial["fold"])
        notify(Progress(0.0, f"{model} from {size} strokes, {fold + 1} of {scale.folds}"))
        chosen = np.random.default_rng((seed, fold)).permutation(pool)[:size]
        predict = learn(model, library[chosen], seed=seed + fold, quick=scale.quick)
        return Measurement({"error": float(errors(predict, test).mean())})

    def report(results: Results) -> Outcome:
        rows = [
            _row(model, size, results.values("error", model=model, strokes=size)) for model in models for size in sizes
        ]
        return Outcome(
            NAME,
            f"Error against the number of strokes: {name}",
            {
                "library": name, "strokes": len(library), "sizes": sizes, "folds": scale.folds,
                "held out": scale.held_out, "seed": seed,
            },
            (ResultTable(f"Mean absolute error on {scale.held_out} strokes held out", tuple(rows)),),
            tuple(_note(model, rows) for model in LEARNED),
            {NAME: _curve(name, models, rows)},
        )  # fmt: skip

    depends_on = {"library": fingerprint(library), "seed": seed, "scale": repr(scale)}
    trials = [
        ExperimentTrial({"model": model, "strokes": size, "fold": fold}, depends_on)
        for model in models
        for size in sizes
        for fold in range(scale.folds)
    ]
    return Experiment(trials, measure, report)


def _row(model: str, size: int, error: Sequence[float]) -> Row:
    log = np.log(error)
    return {
        "model": model,
        "strokes": size,
        "error": float(np.exp(log.mean())),
        "log error": float(log.mean()),
        "log error, standard deviation": float(log.std(ddof=1)),
        "best": min(error),
        "worst": max(error),
    }


def _note(model: str, rows: Sequence[Row]) -> str:
    mine = [(int(row["strokes"] or 0), float(row["error"] or 0)) for row in rows if row["model"] == model]
    steps = ", ".join(f"{100 * (1 - b / a):.0f} % from {m} to {n}" for (m, a), (n, b) in pairwise(mine))
    return f"With more strokes the error of {model} falls by {steps} strokes."


def _curve(name: str, models: Sequence[str], rows: Sequence[Row]) -> Tensor:
    lines = []
    for model in models:
        mine = [row for row in rows if row["model"] == model]
        center = np.array([float(row["log error"] or 0) for row in mine])
        spread = np.array([float(row["log error, standard deviation"] or 0) for row in mine])
        low, mean, high = (np.exp(center + sign * spread).tolist() for sign in (-1, 0, 1))
        lines.append(Series(model, [float(row["strokes"] or 0) for row in mine], mean, low, high, band=False))
    return chart(
        f"Strokes needed: {name}",
        "strokes for training and validation",
        "mean absolute error on strokes held out (logarithmic); bars: one standard deviation of five trainings",
        lines,
        logarithmic=True,
    )
