"""Training of stroke models by name, and their comparison with recorded strokes."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush import FIELD, MODELS, PARAM2STROKE
from frida_painter.brush.field import StrokeField
from frida_painter.brush.kinds import BrushKind, StrokeModel, growth_of, median_of, spread_of
from frida_painter.brush.library import StrokeLibrary, clean, resample
from frida_painter.errors import ConfigError, LibraryError
from frida_painter.frames import MapFrame
from frida_painter.strokes.strokes import StrokeLimits
from frida_painter_calibration.teaching.families import FamilyField
from frida_painter_calibration.teaching.param2stroke import Param2Stroke, train_param2stroke
from frida_painter_calibration.teaching.training import (
    Hearing,
    TrainingReport,
    make_fresh,
    require_enough,
    train_field,
)

OTHER_BRUSH = "other"
"""Name of a brush outside this project."""
_COLUMNS = {FIELD: 160, PARAM2STROKE: 80}
_USUAL_COLUMNS = 80
_ROOM = 0.03  # share of the range
_MIN_ROOM = 0.0005
_SHORTEST = 0.0001


@dataclass(frozen=True)
class Learned:
    """Trained stroke model, its report, and the strokes of the training, which are counted in the report."""

    model: StrokeField | Param2Stroke
    report: TrainingReport
    library: StrokeLibrary


def learn(
    name: str,
    library: StrokeLibrary,
    kind: BrushKind | None = None,
    *,
    seed: int = 0,
    hasty: bool = False,
    notify: Hearing | None = None,
) -> Learned:
    """Trains the stroke model `name` on the clean strokes of a library.

    kind: brush that painted them; None for a brush outside this project. Then the library sets frame and limits.
    hasty: True for a very short training, to test the procedure
    The same seed gives the same weights.
    Raises ConfigError if the model is unknown, and LibraryError if there are fewer than 5 clean strokes or the
    crops do not contain the start of the strokes.
    """
    if name not in MODELS:
        raise ConfigError(f"Stroke model {name!r} is not known; models are {' and '.join(MODELS)}.")
    require_enough(library)
    if kind is None:
        brush, (frame, limits) = OTHER_BRUSH, geometry(library, _COLUMNS[name])
    else:
        brush, frame, limits = kind.name, kind.frame, kind.limits
    strokes, family = clean(library), limits.family
    require_enough(strokes)
    if family is None and library.code is not None:
        raise LibraryError(
            "The stroke library holds strokes of a family; say of which (--strokes-of), and the brush that painted it."
        )
    if family is not None and name != FIELD:
        raise ConfigError(f"The strokes of a family were to be learned by {name}; only {FIELD} learns them.")
    if family is not None and (strokes.code is None or strokes.code.shape[1] != family.codes):
        raise LibraryError(f"The stroke library holds no strokes of the family {family.name}; paint it anew.")
    if name == PARAM2STROKE:
        network = make_fresh(Param2Stroke, brush, frame, limits, seed)
        hurry = {"rehearsals": 0, "epochs": 11} if hasty else {}
        return Learned(network, train_param2stroke(network, strokes, seed=seed, notify=notify, **hurry), strokes)
    field = make_fresh(StrokeField if family is None else FamilyField, brush, frame, limits, seed)
    report = train_field(field, strokes, seed=seed, epochs=2 if hasty else None, notify=notify)
    return Learned(field, report, strokes)


def geometry(library: StrokeLibrary, most_columns: int = _USUAL_COLUMNS) -> tuple[MapFrame, StrokeLimits]:
    """Returns frame and limits of a brush from its library.

    The frame is the rectangle of the crops with an even number of nearly square cells. The limits are those of
    the strokes with a small margin, because later strokes may be longer than any of the library.
    Raises LibraryError if the crops do not contain the start of the strokes.
    """
    whole = library.frame
    if not (whole.left < 0 < whole.right and whole.bottom < 0 < whole.top):
        raise LibraryError(
            f"The strokes of the library start at row, column {library.origin_px} of crops of "
            f"{whole.rows} x {whole.columns} pixels; give crops that hold the start of the stroke."
        )
    columns = max(4, min(most_columns, 2 * round(whole.columns / 2)))
    pitch = (whole.right - whole.left) / columns
    rows = max(4, 2 * round((whole.top - whole.bottom) / pitch / 2))
    bounds = []
    for values in (library.length_m, library.bend_m):
        least, most = float(values.min()), float(values.max())
        room = max(_MIN_ROOM, _ROOM * (most - least))
        bounds.append((least - room, most + room))
    (shortest, longest), bends = bounds
    return whole.resize(rows, columns), StrokeLimits((max(_SHORTEST, shortest), longest), bends)


_BATCH = 32
_TOLERANCE = 1e-6
_MAX_OUTSIDE = 0.25
_CAMERA_NOISE = 0.03  # standard deviation of a magnitude


@dataclass(frozen=True)
class Evaluation:
    """Errors of n strokes.

    error [n]: mean absolute error of the magnitude over the whole stored crop, in [0, 1]
    paint [n]: error of an empty prediction, which is the mean magnitude
    outside [n]: True if length or bend is outside the limits of the model
    """

    error: NDArray[np.float64]
    paint: NDArray[np.float64]
    outside: NDArray[np.bool_]


def evaluate(model: StrokeModel, library: StrokeLibrary) -> Evaluation:
    """Compares all marks of a library, dirty ones too, with those of a model, at the pixels of the library.

    A stroke outside the limits of the model is compared too and marked in `outside`. Raises LibraryError if
    more than a quarter of the strokes are outside: the library then belongs to another brush.
    """
    if (model.limits.family is None) != (library.code is None):
        raise LibraryError("The library and the model are of different kinds of strokes; give those of one family.")
    outside, known = np.zeros(len(library), np.bool_), []
    for name, values in (("length", library.length_m), ("bend", library.bend_m)):
        least, most = getattr(model.limits, name)
        outside |= ~((values >= least - _TOLERANCE) & (values <= most + _TOLERANCE))
        known.append(f"{name} {1000 * least:.1f} to {1000 * most:.1f} mm")
    if outside.mean() > _MAX_OUTSIDE:
        raise LibraryError(
            f"Of {len(library)} strokes of the library {outside.sum()} are outside what the model knows "
            f"({', '.join(known)}); give a library of the brush that the model was trained for."
        )
    return Evaluation(errors(model, library), library.magnitude.mean((1, 2), dtype=np.float64) / 255, outside)


@torch.no_grad()
def errors(model: StrokeModel, library: StrokeLibrary) -> NDArray[np.float64]:
    """Returns the mean absolute error of each stroke's magnitude over the whole stored crop, [n] in [0, 1]."""
    shapes = library.shapes()
    found = []
    for part in np.array_split(np.arange(len(library)), -(-len(library) // _BATCH)):
        wanted = torch.from_numpy(library.magnitude[part]).float() / 255
        maps, growth = median_of(model)(*(values[part] for values in shapes)), growth_of(model, shapes[1][part])
        if growth is None:
            drawn = resample(maps, model.frame, library.frame)
        else:
            grown = zip(maps, map(model.frame.scale, growth.tolist()), strict=True)
            drawn = torch.cat([resample(one[None], frame, library.frame) for one, frame in grown])
        found.append((drawn - wanted).abs().mean((1, 2)).double().numpy())
    return np.concatenate(found)


class Likelihood(NamedTuple):
    """Quality of a model's mean and variance: mean log density of a cell's magnitude in nats; higher is better.

    predicted: for normal distributions with the mean and the variance of the model
    constant: for the same mean and the best constant variance for these marks
    """

    predicted: float
    constant: float


@torch.no_grad()
def likelihood(model: StrokeModel, library: StrokeLibrary) -> Likelihood:
    """Returns the likelihood on all cells of the model's frame, of marks outside the training data.

    The noise of a camera is added to both variances.
    """
    noise = _CAMERA_NOISE**2
    means = torch.cat(
        [model(*part) for part in zip(*(torch.split(one, _BATCH) for one in library.shapes()), strict=True)]
    )
    missed = (library.maps(model.frame) - means).square()

    def density(variance: Tensor) -> float:
        return float(-0.5 * (torch.log(2 * torch.pi * variance) + missed / variance).mean())

    return Likelihood(density(spread_of(model).variance(means) + noise), density(missed.mean() + noise))
