"""Training of a stroke field on a stroke library: held-out strokes, progress, report.

Two strokes of one shape differ by a millimetre or two in place and width. A model that follows each stroke learns
this noise. So noise is added to the shape of each stroke in training, but not to the place. The field then learns
what strokes of similar shape have in common.

One network learns both marks: the median minimises absolute errors, the mean squared errors. The spread is
measured on the held-out strokes.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

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


@dataclass(frozen=True)
class TrainingReport:
    """Result of a training.

    best_epoch: epoch with the best weights
    validation_error: their mean absolute error on held-out strokes over the whole map
    held_out: indices of these strokes in the library
    predicted [held out, rows, columns]: their marks by these weights
    curve: progress of each epoch
    """

    best_epoch: int
    validation_error: float
    held_out: NDArray[np.int64]
    predicted: Tensor
    curve: tuple[TrainingProgress, ...]


@dataclass(frozen=True)
class Split:
    """Indices of the strokes for training and of those held out for validation, in random order."""

    training: NDArray[np.int64]
    held_out: NDArray[np.int64]

    @classmethod
    def of(cls, library: StrokeLibrary, chance: torch.Generator) -> "Split":
        """Returns a split that holds out a fifth (paper, "Brush Stroke Model").

        Raises LibraryError for fewer than 5 strokes.
        """
        require_enough(library)
        order = torch.randperm(len(library), generator=chance).numpy()
        count = max(1, round(VALIDATION_SHARE * len(library)))
        return cls(order[count:], order[:count])


def require_enough(library: StrokeLibrary) -> None:
    """Raises LibraryError if there are fewer than 5 strokes."""
    if len(library) < FEWEST_STROKES:
        raise LibraryError(
            f"The stroke library has {len(library)} strokes to learn from; training needs at least {FEWEST_STROKES}, "
            "and about 100 for a good model."
        )


class Best:
    """Best weights so far by validation error."""

    def __init__(self, model: nn.Module) -> None:
        self.model = model
        self.error = float("inf")
        self.epoch = 0
        self._weights = _copy(model)

    def see(self, epoch: int, error: float) -> None:
        """Keeps the present weights of the model if their error is the lowest."""
        if error < self.error:
            self.error, self.epoch, self._weights = error, epoch, _copy(self.model)

    def restore(self) -> None:
        """Loads the best weights into the model."""
        self.model.load_state_dict(self._weights)


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
    notify: Callable[[TrainingProgress], None] | None = None,
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
    split = Split.of(library, chance)
    model.reach.fill_(_reach(model, library))
    untrained = {name: tensor.clone() for name, tensor in model.state_dict().items()}
    lessons = _lessons(model, library)
    cells = model.frame.rows * model.frame.columns
    rounds = epochs or _rounds(len(split.training))

    curve: list[TrainingProgress] = []
    best = Best(model)
    course = _Course(model, [lessons[index] for index in split.training], rounds, chance)
    while len(curve) < rounds and len(curve) - best.epoch < patience:
        training_error = course.epoch() / cells
        error = _error(model, [lessons[index] for index in split.held_out]) / cells
        best.see(len(curve) + 1, error)
        curve.append(TrainingProgress(len(curve) + 1, rounds, training_error, error, best.error))
        if notify is not None:
            notify(curve[-1])
    best.restore()
    with torch.no_grad():
        predicted = model.median(*library[split.held_out].shapes())
        spread = _spread(model, [lessons[index] for index in split.held_out])
    report = TrainingReport(best.epoch, best.error, split.held_out, predicted, tuple(curve))

    model.load_state_dict(untrained)
    model.varies.copy_(torch.tensor(spread))
    again = _Course(model, lessons, len(curve), chance)
    for _ in curve:
        again.epoch()
    return report


def _rounds(count: int) -> int:
    return min(_MAX_EPOCHS, max(_FEWEST_EPOCHS, math.ceil(_STEPS / math.ceil(count / _BATCH))))


class _Course:
    """Training by Adam with a rate that rises and falls once over all epochs."""

    def __init__(self, model: StrokeField, lessons: list[_Lesson], rounds: int, chance: torch.Generator) -> None:
        self.model = model
        self.lessons = lessons
        self.chance = chance
        self.optimizer = torch.optim.AdamW(model.parameters(), lr=_RATE, weight_decay=_DECAY)
        steps = rounds * math.ceil(len(lessons) / _BATCH)
        self.schedule = torch.optim.lr_scheduler.OneCycleLR(
            self.optimizer, max_lr=_RATE, total_steps=steps, pct_start=0.1
        )

    def epoch(self) -> float:
        """Trains on each stroke once; returns the mean over strokes of the sum of absolute errors."""
        total = 0.0
        for index in torch.split(torch.randperm(len(self.lessons), generator=self.chance), _BATCH):
            batch = [self._glance(self.lessons[int(number)]) for number in index]
            views, styles, wanted = (torch.cat(part) for part in zip(*batch, strict=True))
            off = stretch_sigmoid(self.model.logits(views, styles)) - wanted[:, None]
            missed = off[:, MEDIAN].abs()
            self.optimizer.zero_grad()
            (missed.mean() + _SQUARED * off[:, MEAN].square().mean()).backward()  # type: ignore[no-untyped-call]
            self.optimizer.step()
            self.schedule.step()
            for number, part in zip(index, torch.split(missed.detach(), [len(one[2]) for one in batch]), strict=True):
                lesson = self.lessons[int(number)]
                total += float(part.mean()) * len(lesson.wanted) + lesson.elsewhere
        return total / len(self.lessons)

    def _glance(self, lesson: _Lesson) -> tuple[Tensor, Tensor, Tensor]:
        """Returns some cells of a stroke: views [m, 7], noisy shape [m, 3], magnitudes [m]."""
        views, wanted = lesson.views, lesson.wanted
        if len(wanted) > _MAX_CELLS:
            some = torch.randint(len(wanted), (_MAX_CELLS,), generator=self.chance)
            views, wanted = views[some], wanted[some]
        vague = lesson.style + _VAGUENESS * torch.randn(lesson.style.shape, generator=self.chance)
        return views, vague.expand(len(wanted), -1), wanted


@torch.no_grad()
def _lessons(model: StrokeField, library: StrokeLibrary) -> list[_Lesson]:
    """Returns the training data of each stroke."""
    thickness, length, bend = library.shapes()
    maps = model.recorded_maps(library).flatten(1)
    near = model.near(length, bend)
    styles = model.styles(thickness, length, bend)
    places = model.cell_places(length)
    lessons = []
    for index in range(len(library)):
        here, only = near[index], slice(index, index + 1)
        views = model.views(
            places[index, here], torch.zeros(int(here.sum()), dtype=torch.long), length[only], bend[only]
        )
        lessons.append(_Lesson(views, maps[index, here], styles[only], float(maps[index, ~here].sum())))
    return lessons


@torch.no_grad()
def _error(model: StrokeField, lessons: list[_Lesson]) -> float:
    """Returns the sum of absolute errors of the median map, mean over the strokes."""
    total = 0.0
    for lesson in lessons:
        total += float((_predict_cells(model, lesson)[:, MEDIAN] - lesson.wanted).abs().sum()) + lesson.elsewhere
    return total / len(lessons)


@torch.no_grad()
def _spread(model: StrokeField, lessons: list[_Lesson]) -> CoverageSpread:
    """Returns the variation of marks about their means."""
    means = torch.cat([_predict_cells(model, lesson)[:, MEAN] for lesson in lessons])
    return CoverageSpread.fit(means, torch.cat([lesson.wanted for lesson in lessons]))


def _predict_cells(model: StrokeField, lesson: _Lesson) -> Tensor:
    """Returns median and mean at a lesson's cells: [m, 2]."""
    return squash(model.logits(lesson.views, lesson.style.expand(len(lesson.wanted), -1)))


def _reach(model: StrokeField, library: StrokeLibrary) -> float:
    """Returns the largest distance of paint from the rectangle around the path in metres.

    It covers nearly all strokes of the library, plus a margin; the other strokes have drops.
    """
    _, length, bend = library.shapes()
    outside = model.outside(length, bend)
    inked = model.recorded_maps(library).flatten(1) > _INKED
    farthest = torch.where(inked, outside, 0.0).amax(1)
    return float(torch.quantile(farthest, _NEARLY_ALL)) + _MARGIN * model.unit
