"""Training of a stroke field on a stroke library: held-out strokes, progress, report.

Two strokes of one shape differ by a millimetre or two in place and width. A model that follows each stroke learns
this noise. So noise is added to the shape of each stroke in training, but not to the place. The field then learns
what strokes of similar shape have in common.

One network learns both marks: the median minimises absolute errors, the mean squared errors. The spread is
measured on the held-out strokes.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from frida_painter.brush import FEWEST_STROKES
from frida_painter.brush.field import MEAN, MEDIAN, StrokeField
from frida_painter.brush.kinds import CoverageSpread
from frida_painter.brush.library import StrokeLibrary
from frida_painter.brush.table import squash, stretch_sigmoid
from frida_painter.errors import LibraryError
from frida_painter.frames import MapFrame
from frida_painter.strokes.strokes import StrokeLimits

VALIDATION_SHARE = 0.2


@dataclass(frozen=True)
class TrainingProgress:
    """Progress of a training after `epoch` of at most `epochs`.

    The errors are mean absolute errors of the magnitude.
    """

    epoch: int
    epochs: int
    training_error: float
    validation_error: float
    best_error: float


Hearing = Callable[[TrainingProgress], None]
Model = TypeVar("Model", bound=nn.Module)


@dataclass(frozen=True)
class TrainingReport:
    """Result of a training.

    held_out: indices of the held-out strokes in the library
    predicted [held out, rows, columns]: their marks by the best weights
    curve: progress of each epoch
    """

    held_out: NDArray[np.int64]
    predicted: Tensor
    curve: tuple[TrainingProgress, ...]

    @property
    def best_epoch(self) -> int:
        """Epoch with the best weights."""
        return min(self.curve, key=lambda step: step.validation_error).epoch

    @property
    def validation_error(self) -> float:
        """Mean absolute error of the best weights on the held-out strokes over the whole map."""
        return min(step.validation_error for step in self.curve)


def make_fresh(kind: type[Model], brush: str, frame: MapFrame, limits: StrokeLimits, seed: int) -> Model:
    """Returns a stroke model with random weights; the same seed gives the same ones."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return kind(brush, frame, limits)


def require_enough(library: StrokeLibrary) -> None:
    """Raises LibraryError if there are fewer than 5 strokes."""
    if len(library) < FEWEST_STROKES:
        raise LibraryError(
            f"The stroke library has {len(library)} strokes to learn from; training needs at least {FEWEST_STROKES}, "
            "and about 100 for a good model."
        )


def hold_out(library: StrokeLibrary, chance: torch.Generator) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns the indices of the strokes to train with, and of a held-out fifth (paper, "Brush Stroke Model").

    Both are in random order. Raises LibraryError for fewer than 5 strokes.
    """
    require_enough(library)
    order = torch.randperm(len(library), generator=chance).numpy()
    count = max(1, round(VALIDATION_SHARE * len(library)))
    return order[count:], order[:count]


def train_until_best(
    model: nn.Module,
    course: Iterable[float],
    validate: Callable[[], float],
    epochs: int,
    patience: int,
    notify: Hearing | None,
    *,
    unjudged: int = 0,
) -> tuple[TrainingProgress, ...]:
    """Trains a model, gives it the weights of the epoch with the lowest validation error, and returns all progress.

    course: trains for an epoch whenever it is asked for the next training error
    epochs: number of epochs of the course
    patience: number of epochs without a better validation error after which training ends
    unjudged: number of first epochs for which patience does not count
    """
    curve: list[TrainingProgress] = []
    least, best, weights = math.inf, 0, _copy(model)
    for training_error in course:
        error = validate()
        if error < least:
            least, best, weights = error, len(curve) + 1, _copy(model)
        curve.append(TrainingProgress(len(curve) + 1, epochs, training_error, error, least))
        if notify is not None:
            notify(curve[-1])
        if len(curve) - max(best, unjudged) >= patience:
            break
    model.load_state_dict(weights)
    return tuple(curve)


def _copy(model: nn.Module) -> dict[str, Tensor]:
    return {name: tensor.detach().clone() for name, tensor in model.state_dict().items()}


# The lessons: parts of strokes, and what a field says of them.

_BATCH = 8
_MAX_CELLS = 1600
_STEPS = 1200
_FEWEST_EPOCHS = 2
_MAX_EPOCHS = 240
_RATE = 1e-2
_DECAY = 1e-3
_VAGUENESS = 0.08
_SQUARED = 2.0  # weight of the squared error of the mean
_INKED = 0.3
_NEARLY_ALL = 0.95
_MARGIN = 0.2  # in units of the field


@dataclass(frozen=True)
class _Lesson:
    """Training data of one stroke.

    views [m, v]: views of its near cells
    wanted [m]: their magnitudes
    style [1, k]: shape of the stroke
    elsewhere: sum of the magnitudes on other cells
    """

    views: Tensor
    wanted: Tensor
    style: Tensor
    elsewhere: float


def train_field(
    model: StrokeField,
    library: StrokeLibrary,
    *,
    seed: int = 0,
    epochs: int | None = None,
    patience: int = 80,
    notify: Hearing | None = None,
) -> TrainingReport:
    """Trains `model` in place on the strokes of a library.

    epochs: largest number of epochs; None for about 1200 steps of 8 strokes
    patience: number of epochs without a better validation error after which training ends
    The first training holds out a fifth of the strokes for validation. Then the field is trained again on all
    strokes for the same number of epochs, so it is slightly better than the report says. The same seed gives
    the same weights.
    Raises LibraryError if there are fewer than 5 strokes.
    """
    chance = torch.Generator().manual_seed(seed)
    training, held_out = hold_out(library, chance)
    lessons = _prepare(model, library)
    untrained = _copy(model)
    cells = model.frame.rows * model.frame.columns
    steps = math.ceil(len(training) / _BATCH)
    rounds = epochs or min(_MAX_EPOCHS, max(_FEWEST_EPOCHS, math.ceil(_STEPS / steps)))
    unseen = [lessons[index] for index in held_out]

    @torch.no_grad()
    def validate() -> float:
        missed = (float((_predict(model, one)[:, MEDIAN] - one.wanted).abs().sum()) + one.elsewhere for one in unseen)
        return sum(missed) / len(unseen) / cells

    course = _train(model, [lessons[index] for index in training], rounds, chance)
    curve = train_until_best(model, (error / cells for error in course), validate, rounds, patience, notify)
    with torch.no_grad():
        predicted = model.median(*library[held_out].shapes())
        means = torch.cat([_predict(model, lesson)[:, MEAN] for lesson in unseen])
        spread = CoverageSpread.fit(means, torch.cat([lesson.wanted for lesson in unseen]))
    model.load_state_dict(untrained)
    model.varies.copy_(torch.tensor(spread))
    for _ in _train(model, lessons, len(curve), chance):
        pass
    return TrainingReport(held_out, predicted, curve)


def _train(model: StrokeField, lessons: list[_Lesson], rounds: int, chance: torch.Generator) -> Iterator[float]:
    """Yields, after each epoch of Adam, the mean over strokes of the sum of absolute errors.

    The rate rises and falls once over all epochs.
    """
    optimizer = torch.optim.AdamW(model.parameters(), lr=_RATE, weight_decay=_DECAY)
    steps = rounds * math.ceil(len(lessons) / _BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, max_lr=_RATE, total_steps=steps, pct_start=0.1)
    for _ in range(rounds):
        total = 0.0
        for index in torch.split(torch.randperm(len(lessons), generator=chance), _BATCH):
            chosen = [lessons[int(number)] for number in index]
            batch = [_glance(lesson, chance) for lesson in chosen]
            views, styles, wanted = (torch.cat(part) for part in zip(*batch, strict=True))
            off = stretch_sigmoid(model.logits(views, styles)) - wanted[:, None]
            missed = off[:, MEDIAN].abs()
            optimizer.zero_grad()
            (missed.mean() + _SQUARED * off[:, MEAN].square().mean()).backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            schedule.step()
            parts = torch.split(missed.detach(), [len(one[2]) for one in batch])
            for lesson, part in zip(chosen, parts, strict=True):
                total += float(part.mean()) * len(lesson.wanted) + lesson.elsewhere
        yield total / len(lessons)


def _glance(lesson: _Lesson, chance: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
    """Returns some cells of a stroke: views [m, v], noisy shape [m, k], magnitudes [m]."""
    views, wanted = lesson.views, lesson.wanted
    if len(wanted) > _MAX_CELLS:
        some = torch.randint(len(wanted), (_MAX_CELLS,), generator=chance)
        views, wanted = views[some], wanted[some]
    vague = lesson.style + _VAGUENESS * torch.randn(lesson.style.shape, generator=chance)
    return views, vague.expand(len(wanted), -1), wanted


@torch.no_grad()
def _prepare(model: StrokeField, library: StrokeLibrary) -> list[_Lesson]:
    """Returns the training data of each stroke, after the reach of the model is set from all of them.

    The reach is the largest distance of paint from the rectangle around the path in nearly all strokes, plus a
    margin; the other strokes have drops.
    """
    thickness, length, bend = library.shapes()
    maps = model.recorded_maps(library).flatten(1)
    farthest = torch.where(maps > _INKED, model.outside(length, bend), 0.0).amax(1)
    model.reach.fill_(float(torch.quantile(farthest, _NEARLY_ALL)) + _MARGIN * model.unit)
    near = model.near(length, bend)
    styles, places = model.styles(thickness, length, bend), model.cell_places(length)
    lessons = []
    for index in range(len(library)):
        here, only = near[index], slice(index, index + 1)
        mine = torch.zeros(int(here.sum()), dtype=torch.long)
        views = model.views(places[index, here], mine, length[only], bend[only])
        lessons.append(_Lesson(views, maps[index, here], styles[only], float(maps[index, ~here].sum())))
    return lessons


def _predict(model: StrokeField, lesson: _Lesson) -> Tensor:
    """Returns median and mean at a lesson's cells: [m, 2]."""
    return squash(model.logits(lesson.views, lesson.style.expand(len(lesson.wanted), -1)))
