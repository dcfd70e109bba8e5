"""Experiment: errors of every stroke model on unseen strokes, over several splits of one library.

This is the project's main table of stroke models. Each seeded split has 42 strokes for the test, and the rest for
training and validation. Every model learns from the rest and is tested on the 42. The learned models and the fitted
Bezier also learn from fewer strokes.
"""

from collections.abc import Sequence

import numpy as np

from frida_painter.brush import FEWEST_STROKES
from frida_painter.brush.library import StrokeLibrary
from frida_painter.errors import LibraryError
from frida_painter.lab import ExperimentScale
from frida_painter.lab.stroke_models import (
    BEZIER,
    DEFAULT,
    LEARNED,
    RIVALS,
    errors,
    fingerprint,
    learn,
    learn_model,
    predict_with,
)
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
from frida_painter.teaching.evaluation import likelihood

NAME = "real-strokes"


FULL = ExperimentScale(strokes=200, held_out=42, sizes=(10, 25, 50, 100, 150))
QUICK = ExperimentScale(strokes=16, held_out=4, sizes=(6,), quick=True)


def experiment(
    library: StrokeLibrary, name: str, *, seeds: Sequence[int] = (0, 1, 2, 3, 4), scale: ExperimentScale = FULL
) -> Experiment[ExperimentTrial]:
    """Returns the experiment on a library, with one split per seed. Raises LibraryError if the library is too small.

    name: of the library
    """
    rest = len(library) - scale.held_out
    if rest < FEWEST_STROKES:
        raise LibraryError(
            f"The stroke library has {len(library)} strokes, {scale.held_out} of which are held out for the test; "
            f"give one of at least {scale.held_out + FEWEST_STROKES}."
        )
    sizes = tuple(size for size in scale.sizes if size < rest)
    sized = [(model, size) for model in (*LEARNED, BEZIER) for size in sizes]

    def measure(trial: ExperimentTrial, notify: Notify) -> Measurement:
        model, size, seed = trial["model"], int(trial["strokes"]), int(trial["split"])
        notify(Progress(0.0, f"split {seed}: {model} from {size} strokes"))
        order = np.random.default_rng(seed).permutation(len(library))
        known, test = library[order[:size]], library[order[rest:]]
        if model not in LEARNED:
            predict = learn(model, known, seed=seed, quick=scale.quick)
            return Measurement({"error": float(errors(predict, test).mean())})
        learned = learn_model(model, known, seed=seed, quick=scale.quick)
        foretold = likelihood(learned, test)
        return Measurement(
            {
                "error": float(errors(predict_with(learned), test).mean()),
                "log likelihood": foretold.predicted,
                "with one variance": foretold.constant,
            }
        )

    def report(results: Results) -> Outcome:
        whole = [_row(rival, rest, results) for rival in RIVALS]
        best = min(whole, key=lambda one: float(one["error"] or 0))
        title = f"Mean absolute error, {len(seeds)} splits of {rest} + {scale.held_out} strokes"
        varies = tuple(_likelihood_row(seed, rest, results) for seed in seeds)
        tables = [
            ResultTable(title, tuple(whole)),
            ResultTable(f"Log likelihood per cell of strokes held out, by the {DEFAULT}", varies),
        ]
        if sizes:
            fewer = tuple(_row(model, size, results) for model, size in sized)
            tables.append(ResultTable("The same from fewer strokes", fewer))
        return Outcome(
            NAME,
            f"Errors on strokes held out: {name}",
            {
                "library": name, "strokes": len(library), "held out": scale.held_out, "seeds": tuple(seeds),
                "sizes": sizes,
            },
            tuple(tables),
            (f"The best is {best['model']} with {best['error']:.4f} in the mean over the splits.",),
        )  # fmt: skip

    depends_on = {"library": fingerprint(library), "scale": repr(scale), "measured": "error and likelihood"}
    trials = [
        ExperimentTrial({"model": model, "strokes": size, "split": seed}, depends_on)
        for model, size in (*((rival, rest) for rival in RIVALS), *sized)
        for seed in seeds
    ]
    return Experiment(trials, measure, report)


def _row(model: str, size: int, results: Results) -> Row:
    error = results.values("error", model=model, strokes=size)
    return {
        "model": model,
        "strokes": size,
        "error": float(np.mean(error)),
        "least": min(error),
        "most": max(error),
    }


def _likelihood_row(seed: int, size: int, results: Results) -> Row:
    """Returns the log likelihood of one split: with predicted variances, and with one variance for all cells."""
    names = ("log likelihood", "with one variance")
    predicted, constant = (results.values(name, model=DEFAULT, strokes=size, split=seed)[0] for name in names)
    return {"split": seed, "mean and variance": predicted, "one variance": constant}
