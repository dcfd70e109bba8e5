"""How far a stroke model is from strokes that a brush has really made."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.kinds import BrushKind
from frida_painter.brush.learn import learn
from frida_painter.brush.library import StrokeLibrary
from frida_painter.brush.limits import FEWEST_STROKES
from frida_painter.brush.resample import resample
from frida_painter.brush.spread import median_of, spread_of
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.brush.training import TrainingProgress
from frida_painter.errors import LibraryError

_BATCH = 32
_TOLERANCE = 1e-6
_MOST_OUTSIDE = 0.25
_CAMERA_NOISE = 0.03  # standard deviation of a magnitude


@dataclass(frozen=True)
class Evaluation:
    """How far off each of n strokes is.

    error [n]: mean absolute error of the magnitude over the whole crop as stored, in [0, 1]; paint
    [n]: the error that bare paper would have, which is the mean magnitude; outside [n]: whether the
    stroke lies outside the lengths and bends that the model knows.
    """

    error: NDArray[np.float64]
    paint: NDArray[np.float64]
    outside: NDArray[np.bool_]


def evaluate(model: StrokeModel, library: StrokeLibrary) -> Evaluation:
    """Compares every mark of the library, dirty ones too, with the model's, brought to the library's pixels.

    A stroke outside the model's limits is drawn all the same and told in `outside`. Raises
    LibraryError where there are so many of them that the library must be of another brush.
    """
    limits = {"length": model.limits.length, "bend": model.limits.bend}
    outside = np.zeros(len(library), np.bool_)
    for values, (least, most) in zip((library.length_m, library.bend_m), limits.values(), strict=True):
        outside |= ~((values >= least - _TOLERANCE) & (values <= most + _TOLERANCE))
    if outside.mean() > _MOST_OUTSIDE:
        known = ", ".join(f"{name} {1000 * low:.1f} to {1000 * high:.1f} mm" for name, (low, high) in limits.items())
        raise LibraryError(
            f"Of {len(library)} strokes of the library {outside.sum()} are outside what the model knows ({known}); "
            "give a library of the brush that the model was trained for."
        )
    return Evaluation(errors(model, library), library.magnitude.mean((1, 2), dtype=np.float64) / 255, outside)


@torch.no_grad()
def errors(model: StrokeModel, library: StrokeLibrary) -> NDArray[np.float64]:
    """Mean absolute error of each stroke's magnitude over the whole crop as stored, [n] in [0, 1]."""
    shapes = library.shapes()
    found = []
    for part in np.array_split(np.arange(len(library)), -(-len(library) // _BATCH)):
        wanted = torch.from_numpy(library.magnitude[part]).float() / 255
        drawn = resample(median_of(model)(*(values[part] for values in shapes)), model.frame, library.frame)
        found.append((drawn - wanted).abs().mean((1, 2)).double().numpy())
    return np.concatenate(found)


@dataclass(frozen=True)
class Likelihood:
    """How well a model's mean and variance foretell marks: mean log density of a cell's magnitude, in nats.

    predicted: of a normal distribution with the mean and the variance that the model says; constant: of one with the
    same mean and the same variance everywhere, the best there is for these very marks. The more, the better.
    """

    predicted: float
    constant: float


@torch.no_grad()
def likelihood(model: StrokeModel, library: StrokeLibrary) -> Likelihood:
    """On all cells of the model's frame, of marks that it has not learned from; a camera's noise adds to both."""
    noise = _CAMERA_NOISE**2
    means = torch.cat(
        [model(*part) for part in zip(*(torch.split(one, _BATCH) for one in library.shapes()), strict=True)]
    )
    missed = (library.maps(model.frame) - means).square()

    def density(variance: Tensor) -> float:
        return float(-0.5 * (torch.log(2 * torch.pi * variance) + missed / variance).mean())

    return Likelihood(density(spread_of(model).variance(means) + noise), density(missed.mean() + noise))


def cross_validate(
    name: str,
    library: StrokeLibrary,
    kind: BrushKind | None = None,
    *,
    folds: int,
    seed: int = 0,
    notify: Callable[[int, TrainingProgress], None] | None = None,
) -> NDArray[np.float64]:
    """Trains the stroke model called `name` once without each fold of the library, and tests it on that fold.

    Returns the mean error of each fold, [folds]. notify hears the fold's number, from 0, and how far
    it has come. Raises LibraryError where there are too few strokes for so many folds.
    """
    fewest = max(folds, FEWEST_STROKES + -(-FEWEST_STROKES // (folds - 1)))
    if len(library) < fewest:
        raise LibraryError(
            f"The stroke library has {len(library)} strokes; {folds} folds need at least {fewest}, "
            f"so that {FEWEST_STROKES} are left to learn from."
        )
    order = np.random.default_rng(seed).permutation(len(library))
    tested = []
    for fold, test in enumerate(np.array_split(order, folds)):

        def hear(progress: TrainingProgress, fold: int = fold) -> None:
            if notify is not None:
                notify(fold, progress)

        learned = learn(name, library[np.setdiff1d(order, test)], kind, seed=seed, notify=hear)
        tested.append(errors(learned.model, library[test]).mean())
    return np.array(tested)
