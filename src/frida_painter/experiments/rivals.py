"""The models of a stroke that are compared with one another, each learned from a stroke library.

`learn` gives a function from the shapes of a library's strokes to what their marks should look
like, on the cells on which the library stores them; `errors` holds that against what they are.
"""

import hashlib
from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.bezier import BezierStroke, RibbonShape, fit_bezier
from frida_painter.brush.library import StrokeLibrary
from frida_painter.brush.param2stroke import Param2Stroke
from frida_painter.brush.resample import resample
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.brush.train import train
from frida_painter.frames import MapFrame
from frida_painter.strokes import StrokeLimits

ZEROS, MEAN, BEZIER, PARAM2STROKE = "all zeros", "mean stroke", "fitted Bezier", "param2stroke"
RIVALS = (ZEROS, MEAN, BEZIER, PARAM2STROKE)
LEARNED = (PARAM2STROKE,)
DEFAULT = PARAM2STROKE
Predict = Callable[[StrokeLibrary], Tensor]
_BATCH = 32
_COLUMNS = 80


def learn(rival: str, library: StrokeLibrary, *, seed: int, quick: bool = False) -> Predict:
    """What that rival says after learning from the library; `quick`: hardly trained, to see that it runs."""
    if rival == ZEROS:
        return lambda other: torch.zeros(other.magnitude.shape)
    if rival == MEAN:
        mean = torch.from_numpy(library.magnitude.mean(0)).float() / 255
        return lambda other: mean.expand(len(other), -1, -1)
    return drawn_by(learn_model(rival, library, seed=seed, quick=quick))


def learn_model(rival: str, library: StrokeLibrary, *, seed: int, quick: bool = False) -> StrokeModel:
    """The stroke model of a rival that has one, on the rectangle and within the limits of the library's strokes."""
    frame, limits = geometry(library)
    if rival == BEZIER:
        ribbon = BezierStroke("any", frame, limits, RibbonShape.typical(0.25 * (frame.top - frame.bottom)))
        fit_bezier(ribbon, library, seed=seed, steps=4 if quick else 150)
        return ribbon
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = Param2Stroke("any", frame, limits)
    if quick:
        train(network, library, seed=seed, rehearsals=0, epochs=11)
    else:
        train(network, library, seed=seed)
    return network


def geometry(library: StrokeLibrary) -> tuple[MapFrame, StrokeLimits]:
    """The rectangle of the library's crops in near-square cells, and what its strokes are between."""
    whole = library.frame
    pitch = (whole.right - whole.left) / _COLUMNS
    rows = max(4, 4 * round((whole.top - whole.bottom) / pitch / 4))
    limits = StrokeLimits(
        (float(library.length_m.min()), float(library.length_m.max())),
        (float(library.bend_m.min()), float(library.bend_m.max())),
    )
    return whole.resized(rows, _COLUMNS), limits


def fingerprint(library: StrokeLibrary) -> str:
    """sha256 of everything that a model learns from."""
    content = hashlib.sha256(repr((library.metres_per_pixel, library.origin_px)).encode())
    for part in (library.magnitude, library.length_m, library.bend_m, library.thickness):
        content.update(np.ascontiguousarray(part).tobytes())
    return content.hexdigest()


def drawn_by(model: StrokeModel) -> Predict:
    """What a stroke model says of a library's strokes, on the library's own cells."""

    @torch.no_grad()
    def predict(library: StrokeLibrary) -> Tensor:
        parts = zip(*(torch.split(part, _BATCH) for part in library.shapes()), strict=True)
        return torch.cat([resample(model(*part), model.frame, library.frame) for part in parts])

    return predict


def errors(predict: Predict, library: StrokeLibrary) -> NDArray[np.float64]:
    """Mean absolute error of each stroke's magnitude over the whole crop as stored, [n]."""
    wanted = torch.from_numpy(library.magnitude).float() / 255
    return (predict(library) - wanted).abs().mean((1, 2)).double().numpy()
