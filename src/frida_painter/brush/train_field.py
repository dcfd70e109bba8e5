"""Training a stroke field on a stroke library.

Two strokes of one shape differ by a millimetre or two in where they lie and how wide they are; a
model that follows every stroke learns that chance. So while the field learns, it is told each
stroke's shape only roughly, differently each time, though the place exactly: what is left for it to
learn is what strokes of similar shape have in common.

Both marks are learned by one network: the median minimises absolute errors, the mean squared ones. How much marks vary
about the mean is measured on the strokes that were held out.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from frida_painter.brush.field import MEAN, MEDIAN, StrokeField
from frida_painter.brush.library import StrokeLibrary
from frida_painter.brush.spread import CoverageSpread
from frida_painter.brush.squash import squash, stretched
from frida_painter.brush.training import Best, Split, TrainingProgress, TrainingReport

_BATCH = 8
_MOST_CELLS = 1600
_STEPS = 1200
_FEWEST_EPOCHS = 2
_MOST_EPOCHS = 240
_RATE = 1e-2
_DECAY = 1e-3
_VAGUENESS = 0.08
_SQUARED = 2.0  # weight of the squared error of the mean
_INKED = 0.3
_NEARLY_ALL = 0.95
_MARGIN = 0.2  # in units of the field


@dataclass(frozen=True)
class _Lesson:
    """What is seen of one stroke.

    views [m, 7] of its near cells; wanted [m]: their magnitude; style [1, 3]: its shape; elsewhere: sum
    of the magnitude that lies on other cells.
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
    """Trains `model` in place on the library's strokes.

    A fifth of the strokes is held out for validation. Training ends after `epochs` (None: about 1200
    steps of 8 strokes), or when the validation error has not fallen for `patience` of them. Then the
    field is trained anew for as many epochs on all strokes, the held out ones too, and so is rather
    better than the report says. The same seed gives the same weights. Raises
    LibraryError where there are fewer than 5 strokes.
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
    return min(_MOST_EPOCHS, max(_FEWEST_EPOCHS, math.ceil(_STEPS / math.ceil(count / _BATCH))))


class _Course:
    """Adam on the lessons, its rate rising and falling once over all rounds."""

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
        """Shows every stroke once; returns the mean sum of absolute errors of a map on the way."""
        total = 0.0
        for index in torch.split(torch.randperm(len(self.lessons), generator=self.chance), _BATCH):
            batch = [self._glance(self.lessons[int(number)]) for number in index]
            views, styles, wanted = (torch.cat(part) for part in zip(*batch, strict=True))
            off = stretched(self.model.logits(views, styles)) - wanted[:, None]
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
        """Some cells of a stroke: their views [m, 7], its shape told vaguely [m, 3], their magnitude [m]."""
        views, wanted = lesson.views, lesson.wanted
        if len(wanted) > _MOST_CELLS:
            some = torch.randint(len(wanted), (_MOST_CELLS,), generator=self.chance)
            views, wanted = views[some], wanted[some]
        vague = lesson.style + _VAGUENESS * torch.randn(1, 3, generator=self.chance)
        return views, vague.expand(len(wanted), 3), wanted


@torch.no_grad()
def _lessons(model: StrokeField, library: StrokeLibrary) -> list[_Lesson]:
    """One lesson for each stroke of the library."""
    thickness, length, bend = library.shapes()
    maps = library.maps(model.frame).flatten(1)
    near = model.near(length, bend)
    styles = model.styles(thickness, length, bend)
    places = model.frame.cell_centers().view(-1, 2)
    lessons = []
    for index in range(len(library)):
        here, only = near[index], slice(index, index + 1)
        views = model.views(places[here], torch.zeros(int(here.sum()), dtype=torch.long), length[only], bend[only])
        lessons.append(_Lesson(views, maps[index, here], styles[only], float(maps[index, ~here].sum())))
    return lessons


@torch.no_grad()
def _error(model: StrokeField, lessons: list[_Lesson]) -> float:
    """Sum of absolute errors of a map's median, mean over the lessons."""
    total = 0.0
    for lesson in lessons:
        total += float((_drawn(model, lesson)[:, MEDIAN] - lesson.wanted).abs().sum()) + lesson.elsewhere
    return total / len(lessons)


@torch.no_grad()
def _spread(model: StrokeField, lessons: list[_Lesson]) -> CoverageSpread:
    """How much marks vary about their means."""
    means = torch.cat([_drawn(model, lesson)[:, MEAN] for lesson in lessons])
    return CoverageSpread.fitted(means, torch.cat([lesson.wanted for lesson in lessons]))


def _drawn(model: StrokeField, lesson: _Lesson) -> Tensor:
    """Median and mean of a lesson's cells, [m, 2]."""
    return squash(model.logits(lesson.views, lesson.style.expand(len(lesson.wanted), 3)))


def _reach(model: StrokeField, library: StrokeLibrary) -> float:
    """How far from the rectangle around its path a stroke's paint may lie, metres.

    It is as far as nearly all strokes of the library have it, and some margin; the rest has drops.
    """
    _, length, bend = library.shapes()
    outside = model.outside(length, bend)
    inked = library.maps(model.frame).flatten(1) > _INKED
    farthest = torch.where(inked, outside, 0.0).amax(1)
    return float(torch.quantile(farthest, _NEARLY_ALL)) + _MARGIN * model.unit
