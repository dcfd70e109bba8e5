"""From a stroke library to a stroke model: the one place where the kinds of models are told apart."""

from collections.abc import Callable
from dataclasses import dataclass

import torch

from frida_painter.brush.field import StrokeField
from frida_painter.brush.judge import clean
from frida_painter.brush.kinds import BrushKind
from frida_painter.brush.library import StrokeLibrary
from frida_painter.brush.limits import FIELD, MODELS, PARAM2STROKE
from frida_painter.brush.param2stroke import Param2Stroke
from frida_painter.brush.train_field import train_field
from frida_painter.brush.train_param2stroke import train_param2stroke
from frida_painter.brush.training import TrainingProgress, TrainingReport, require_enough
from frida_painter.errors import ConfigError, LibraryError
from frida_painter.frames import MapFrame
from frida_painter.strokes import StrokeLimits

_KINDS_OF_MODEL: dict[str, type[StrokeField] | type[Param2Stroke]] = {FIELD: StrokeField, PARAM2STROKE: Param2Stroke}
OTHER_BRUSH = "other"
"""Name of a brush that is none of the project's."""
_COLUMNS = {FIELD: 160, PARAM2STROKE: 80}
_USUAL_COLUMNS = 80
_ROOM = 0.03  # of the range
_LEAST_ROOM = 0.0005
_SHORTEST = 0.0001


@dataclass(frozen=True)
class Learned:
    """A trained stroke model, what training did, and the strokes that it was trained on, which `report` counts."""

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
    notify: Callable[[TrainingProgress], None] | None = None,
) -> Learned:
    """Trains the stroke model called `name` on the clean strokes of a library.

    kind: the brush that painted them, None for a brush that is none of the project's: the library
    then says what it can do. hasty: hardly trained, to see that everything runs. The same seed gives
    the same weights. Raises ConfigError where there is no such model, and LibraryError where there
    are fewer than 5 clean strokes or the crops do not hold the strokes' start.
    """
    if name not in MODELS:
        raise ConfigError(f"Stroke model {name!r} is not known; models are {' and '.join(MODELS)}.")
    require_enough(library)
    if kind is None:
        brush, (frame, limits) = OTHER_BRUSH, geometry(library, _COLUMNS[name])
    else:
        brush, frame, limits = kind.name, kind.frame, kind.limits
    strokes = clean(library)
    require_enough(strokes)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model = _KINDS_OF_MODEL[name](brush, frame, limits)
    if isinstance(model, StrokeField):
        report = train_field(model, strokes, seed=seed, epochs=2 if hasty else None, notify=notify)
    elif hasty:
        report = train_param2stroke(model, strokes, seed=seed, rehearsals=0, epochs=11, notify=notify)
    else:
        report = train_param2stroke(model, strokes, seed=seed, notify=notify)
    return Learned(model, report, strokes)


def geometry(library: StrokeLibrary, most_columns: int = _USUAL_COLUMNS) -> tuple[MapFrame, StrokeLimits]:
    """Frame and limits of a brush of which only the library is known.

    The frame is the rectangle of the crops in near-square cells, even numbers of them; the limits are
    those of the strokes with a little room, since the longest of a few hundred is not the longest that
    there will be. Raises LibraryError where the crops do not hold the strokes' start.
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
    shortest, longest = _with_room(float(library.length_m.min()), float(library.length_m.max()))
    bends = _with_room(float(library.bend_m.min()), float(library.bend_m.max()))
    return whole.resized(rows, columns), StrokeLimits((max(_SHORTEST, shortest), longest), bends)


def _with_room(least: float, most: float) -> tuple[float, float]:
    room = max(_LEAST_ROOM, _ROOM * (most - least))
    return least - room, most + room
