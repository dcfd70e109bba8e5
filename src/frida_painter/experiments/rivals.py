"""The models of a stroke that are compared with one another, each learned from a stroke library.

`learn` gives a function from the shapes of a library's strokes to what their marks should look
like, on the cells on which the library stores them; `errors` holds that against what they are, and
`PairedTest` says whether one is really better than another.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import stats
from torch import Tensor

from frida_painter.brush import learn as training
from frida_painter.brush.bezier import BezierStroke, RibbonShape, fit_bezier
from frida_painter.brush.judge import clean
from frida_painter.brush.library import StrokeLibrary
from frida_painter.brush.limits import DEFAULT_MODEL, MODELS
from frida_painter.brush.resample import resample
from frida_painter.brush.spread import median_of
from frida_painter.brush.stroke_model import StrokeModel

ZEROS, MEAN, BEZIER = "all zeros", "mean stroke", "fitted Bezier"
DEFAULT = DEFAULT_MODEL
LEARNED = (DEFAULT, *(name for name in MODELS if name != DEFAULT))
RIVALS = (ZEROS, MEAN, BEZIER, *reversed(LEARNED))
Predict = Callable[[StrokeLibrary], Tensor]
_BATCH = 32


def learn(rival: str, library: StrokeLibrary, *, seed: int, quick: bool = False) -> Predict:
    """What that rival says after learning from the library; `quick`: hardly trained, to see that it runs."""
    if rival == ZEROS:
        return lambda other: torch.zeros(other.magnitude.shape)
    if rival == MEAN:
        mean = torch.from_numpy(library.magnitude.mean(0)).float() / 255
        return lambda other: mean.expand(len(other), -1, -1)
    return drawn_by(learn_model(rival, library, seed=seed, quick=quick))


def learn_model(rival: str, library: StrokeLibrary, *, seed: int, quick: bool = False) -> StrokeModel:
    """The stroke model of a rival that has one, learned as painters learn it, from the clean strokes of the library.

    Raises LibraryError where there are too few of them.
    """
    if rival != BEZIER:
        return training.learn(rival, library, seed=seed, hasty=quick).model
    frame, limits = training.geometry(library)
    ribbon = BezierStroke(training.OTHER_BRUSH, frame, limits, RibbonShape.typical(0.25 * (frame.top - frame.bottom)))
    fit_bezier(ribbon, clean(library), seed=seed, steps=4 if quick else 150)
    return ribbon


def fingerprint(library: StrokeLibrary) -> str:
    """sha256 of everything that a model learns from."""
    content = hashlib.sha256(repr((library.metres_per_pixel, library.origin_px)).encode())
    for part in (library.magnitude, library.length_m, library.bend_m, library.thickness):
        content.update(np.ascontiguousarray(part).tobytes())
    return content.hexdigest()


def drawn_by(model: StrokeModel) -> Predict:
    """What a stroke model says of a library's strokes, the median where it knows that, on the library's own cells."""
    median = median_of(model)

    @torch.no_grad()
    def predict(library: StrokeLibrary) -> Tensor:
        parts = zip(*(torch.split(part, _BATCH) for part in library.shapes()), strict=True)
        return torch.cat([resample(median(*part), model.frame, library.frame) for part in parts])

    return predict


def errors(predict: Predict, library: StrokeLibrary) -> NDArray[np.float64]:
    """Mean absolute error of each stroke's magnitude over the whole crop as stored, [n]."""
    wanted = torch.from_numpy(library.magnitude).float() / 255
    return (predict(library) - wanted).abs().mean((1, 2)).double().numpy()


@dataclass(frozen=True)
class PairedTest:
    """What two tests say of paired errors.

    difference: mean of first minus second; better: for how many pairs the first is smaller; t_p:
    two-sided p of the paired t-test; wilcoxon_p: of Wilcoxon's signed-rank test, which asks for no
    normal distribution. Both are 1 where all pairs are equal.
    """

    difference: float
    better: int
    t_p: float
    wilcoxon_p: float

    @classmethod
    def of(cls, first: NDArray[np.float64], second: NDArray[np.float64]) -> "PairedTest":
        """The tests of two rows of errors [n] on the same n >= 2 things."""
        apart = first - second
        if not apart.any():
            return cls(0.0, 0, 1.0, 1.0)
        return cls(
            float(apart.mean()),
            int((apart < 0).sum()),
            float(stats.ttest_rel(first, second).pvalue),
            float(stats.wilcoxon(first, second).pvalue),
        )
