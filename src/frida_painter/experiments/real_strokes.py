"""How well every model predicts strokes that it has not seen, over several splits of one library.

The table that the project is measured by: on each seeded split of 42 strokes for the test and the
rest for training and validation, every rival learns from the second part and is tested on the
first, and the learned ones again from fewer strokes of it.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from frida_painter.brush.library import StrokeLibrary
from frida_painter.brush.limits import FEWEST_STROKES
from frida_painter.errors import LibraryError
from frida_painter.experiments.outcome import Notify, Outcome, Progress, ResultTable, Row, silent
from frida_painter.experiments.result_cache import Measurement, ResultCache
from frida_painter.experiments.rivals import BEZIER, LEARNED, RIVALS, errors, fingerprint, learn
from frida_painter.experiments.scale import LearningScale

NAME = "real-strokes"


FULL = LearningScale(strokes=200, held_out=42, sizes=(10, 25, 50, 100, 150))
QUICK = LearningScale(strokes=16, held_out=4, sizes=(6,), quick=True)


def run(
    library: StrokeLibrary,
    name: str,
    *,
    seeds: Sequence[int] = (0, 1, 2, 3, 4),
    scale: LearningScale = FULL,
    keep: Path | None = None,
    notify: Notify = silent,
) -> Outcome:
    """Learns and tests on a library called `name`, once per seed.

    keep: a folder in which finished trainings wait in case the rest is interrupted. Raises
    LibraryError where the library is too small.
    """
    rest = len(library) - scale.held_out
    if rest < FEWEST_STROKES:
        raise LibraryError(
            f"The stroke library has {len(library)} strokes, {scale.held_out} of which are held out for the test; "
            f"give one of at least {scale.held_out + FEWEST_STROKES}."
        )
    sizes = tuple(size for size in scale.sizes if size < rest)
    cache = ResultCache(keep, {"library": fingerprint(library), "scale": repr(scale)})
    sized = [(model, size) for model in (*LEARNED, BEZIER) for size in sizes]
    tasks = [(model, size, seed) for model, size in (*((rival, rest) for rival in RIVALS), *sized) for seed in seeds]
    error: dict[tuple[str, int, int], float] = {}
    for number, (model, size, seed) in enumerate(tasks):
        notify(Progress(number / len(tasks), f"split {seed}: {model} from {size} strokes"))
        order = np.random.default_rng(seed).permutation(len(library))
        test, part = library[order[rest:]], library[order[:size]]

        def measure(
            model: str = model, part: StrokeLibrary = part, test: StrokeLibrary = test, seed: int = seed
        ) -> Measurement:
            predict = learn(model, part, seed=seed, quick=scale.quick)
            return Measurement({"error": float(errors(predict, test).mean())}, {})

        finding = cache.recall(f"{model.replace(' ', '-')}-{size}-{seed}", measure)
        error[model, size, seed] = finding.numbers["error"]
    notify(Progress(1.0, "done"))

    def row(model: str, size: int) -> Row:
        found = np.array([error[model, size, seed] for seed in seeds])
        return {
            "model": model,
            "strokes": size,
            "error": float(found.mean()),
            "least": float(found.min()),
            "most": float(found.max()),
        }

    whole = tuple(row(rival, rest) for rival in RIVALS)
    best = min(whole, key=lambda one: float(one["error"] or 0))
    tables = [ResultTable(f"Mean absolute error, {len(seeds)} splits of {rest} + {scale.held_out} strokes", whole)]
    if sizes:
        tables.append(ResultTable("The same from fewer strokes", tuple(row(model, size) for model, size in sized)))
    return Outcome(
        NAME,
        f"Errors on strokes held out: {name}",
        {"library": name, "strokes": len(library), "held out": scale.held_out, "seeds": tuple(seeds), "sizes": sizes},
        tuple(tables),
        (f"The best is {best['model']} with {best['error']:.4f} in the mean over the splits.",),
    )
