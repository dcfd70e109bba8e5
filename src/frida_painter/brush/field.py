"""Stroke field, this project's stroke model: amount of paint at a place, seen from the path of the stroke.

param2stroke draws a whole map. The field is evaluated place by place. A place is described by its position
along the path and beside it. So the model contains what is known: a mark follows the Bezier, looks alike for
strokes of all lengths, and is nearly symmetric in left and right bends. A network of a few thousand weights
learns the rest from as few as ten strokes.

It predicts two marks of a stroke. The mean over repeated strokes is used for planning. The median shows the
typical stroke, with sharper edges. `spread` describes the variation.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import torch
from torch import Tensor, nn

from frida_painter.brush.kinds import CERTAIN, BrushKind, CoverageSpread
from frida_painter.brush.library import StrokeLibrary
from frida_painter.brush.table import squash, stretch_sigmoid
from frida_painter.brush.training import Best, ModelFile, Split, TrainingProgress, TrainingReport, write_model
from frida_painter.frames import MapFrame
from frida_painter.strokes import StrokeLimits

FORMAT = "frida-painter stroke field"
VERSION = 2
HIDDEN = 32
MEDIAN, MEAN = 0, 1
_SAMPLES = 25  # along a path
_LOPSIDED = 0.3
_SPREAD = 2.0
_BARE = 2.0
_NOTHING = -20.0
_CELLS_AT_ONCE = 2**18


@dataclass(frozen=True)
class PathView:
    """n places as seen from the paths of their strokes, in metres.

    along [n]: arc length from the start, negative before it
    ahead [n]: arc length to the end
    aside [n]: distance to the left of the path, the side of positive bends
    """

    along: Tensor
    ahead: Tensor
    aside: Tensor

    @classmethod
    def of(cls, place: Tensor, stroke: Tensor, length: Tensor, bend: Tensor, blend: float) -> "PathView":
        """Returns the view of places from the paths of their strokes.

        place [n, 2]: places in the frame of their strokes
        stroke [n]: number of the stroke of each place
        length, bend [k]: shapes of the strokes
        blend: distance in metres over which the views from the points of a path are blended

        Each point of the path has a direction and sees a place relative to it. These views are blended by
        distance, so the result is smooth everywhere, also inside a tight bend. It is exact for a straight path.
        Differentiable in length and bend.
        """
        fraction = torch.linspace(0, 1, _SAMPLES, dtype=length.dtype, device=length.device)
        x = length[:, None] * fraction  # [k, samples]
        y = bend[:, None] * (3 * fraction * (1 - fraction))
        slope_y = bend[:, None] * (3 - 6 * fraction)
        speed = torch.sqrt(length[:, None] ** 2 + slope_y**2 + 1e-12)
        turn_x, turn_y = length[:, None] / speed, slope_y / speed
        step = torch.hypot(x.diff(dim=1), y.diff(dim=1) + 1e-9)
        walked = torch.nn.functional.pad(step.cumsum(1), (1, 0))
        # The view of a point is linear in the place, and so is the difference of squared distances. So matrix
        # products with three numbers for each point of a path are enough.
        ahead_of = walked - x * turn_x - y * turn_y
        left_of = x * turn_y - y * turn_x
        nearness = torch.stack((2 * x, 2 * y, -(x * x + y * y)), -1)[stroke] / blend**2  # [n, samples, 3]
        share = torch.softmax(nearness[..., 0] * place[:, :1] + nearness[..., 1] * place[:, 1:] + nearness[..., 2], -1)
        turn = (share[..., None] * torch.stack((turn_x, turn_y, ahead_of, left_of), -1)[stroke]).sum(1)  # [n, 4]
        along = turn[:, 0] * place[:, 0] + turn[:, 1] * place[:, 1] + turn[:, 2]
        aside = turn[:, 0] * place[:, 1] - turn[:, 1] * place[:, 0] + turn[:, 3]
        return cls(along, walked[:, -1][stroke] - along, aside)


class StrokeField(nn.Module):
    """Network of four linear layers from a place and the shape of a stroke to two logits; see `PathView` and `squash`.

    The unit of length is a fifth of the longest stroke. Most inputs do not change when stroke and place are
    mirrored at the x axis. The other inputs are scaled down, so that the field learns differences between left
    and right only from clear evidence.

    reach: largest distance of paint from the rectangle around the path, in metres
    varies [2]: the spread
    """

    reach: Tensor
    varies: Tensor
    features = 18
    format, version = FORMAT, VERSION

    def __init__(self, brush: str, frame: MapFrame, limits: StrokeLimits) -> None:
        super().__init__()
        self.brush = brush
        self.frame = frame
        self.limits = limits
        self.unit = limits.length[1] / 5
        self.register_buffer("reach", torch.tensor(max(frame.top, frame.right)))
        self.register_buffer("varies", torch.tensor(CERTAIN))
        self.layers = nn.Sequential(
            nn.Linear(self.features, HIDDEN),
            nn.SiLU(),
            nn.Linear(HIDDEN, HIDDEN),
            nn.SiLU(),
            nn.Linear(HIDDEN, HIDDEN),
            nn.SiLU(),
            nn.Linear(HIDDEN, 2),
        )
        with torch.no_grad():
            first, last = self.layers[0], self.layers[-1]
            first.weight.mul_(_SPREAD)  # type: ignore[operator]  # edges are sharp
            last.bias.fill_(-_BARE)  # type: ignore[operator]  # most places are bare

    @classmethod
    def fresh(cls, kind: BrushKind, seed: int = 0) -> Self:
        """Returns an untrained model for a brush; the same seed gives the same weights."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            return cls(kind.name, kind.frame, kind.limits)

    @property
    def spread(self) -> CoverageSpread:
        """Variation of the marks of equal strokes about their mean."""
        return CoverageSpread(*self.varies.tolist())

    def forward(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns mean magnitudes [n, rows, columns] in [0, 1].

        thickness [n]: in [0, 1]
        length [n], bend [n]: in metres
        """
        return self._in_batches(thickness, length, bend, MEAN)

    def median(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns median magnitudes [n, rows, columns] in [0, 1].

        thickness [n]: in [0, 1]
        length [n], bend [n]: in metres
        """
        return self._in_batches(thickness, length, bend, MEDIAN)

    def _in_batches(self, thickness: Tensor, length: Tensor, bend: Tensor, which: int) -> Tensor:
        count = max(1, _CELLS_AT_ONCE // (self.frame.rows * self.frame.columns))
        batches = zip(*(torch.split(part, count) for part in (thickness, length, bend)), strict=True)
        maps = [self._maps(*batch, which=which) for batch in batches]
        return torch.cat(maps) if maps else length.new_zeros(0, self.frame.rows, self.frame.columns)

    def _maps(self, thickness: Tensor, length: Tensor, bend: Tensor, *, which: int) -> Tensor:
        path, owner = _paths(length, bend)
        near = self.near(*path)  # [paths, cells]
        number, cell = near.nonzero(as_tuple=True)
        place = self.cell_places(path[0])[number, cell]
        views = self.views(place, number, *path)
        seen = near[owner]  # [n, cells]
        stroke, cell = seen.nonzero(as_tuple=True)
        row = torch.empty(near.shape, dtype=torch.long, device=near.device)
        row[near] = torch.arange(len(views), device=near.device)
        logits = self.logits(views[row[owner[stroke], cell]], self.styles(thickness, length, bend)[stroke])[:, which]
        empty = torch.full(seen.shape, _NOTHING, dtype=logits.dtype, device=logits.device)
        return squash(empty.masked_scatter(seen, logits)).view(-1, self.frame.rows, self.frame.columns)

    def cell_places(self, length: Tensor) -> Tensor:
        """Returns the centres of the cells of strokes of these lengths [n], [n, rows x columns, 2] in metres."""
        cell = self.frame.cell_centers(dtype=length.dtype, device=length.device).view(-1, 2)
        return cell.expand(len(length), -1, -1)

    def recorded_maps(self, library: StrokeLibrary) -> Tensor:
        """Returns the marks of a library on the cells of the strokes' frames, [n, rows, columns] in [0, 1]."""
        return library.maps(self.frame)

    def near(self, length: Tensor, bend: Tensor) -> Tensor:
        """Returns the mask of cells that may hold paint: [n, rows x columns]."""
        return self.outside(length, bend) < self.reach

    @torch.no_grad()
    def outside(self, length: Tensor, bend: Tensor) -> Tensor:
        """Returns the distance of cells from the rectangle around the path in metres, negative inside.

        Returns [n, rows x columns].
        """
        x, y = self.frame.cell_centers(dtype=length.dtype, device=length.device).view(-1, 2).unbind(-1)
        belly = 0.75 * bend[:, None]
        across = torch.maximum(-x, x - length[:, None])
        beside = torch.maximum(belly.clamp(max=0) - y, y - belly.clamp(min=0))
        return torch.maximum(across, beside)

    def styles(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns the shapes of strokes as inputs of the network: [n, 3], each with a range of about 1."""
        return torch.stack((thickness, length / (4 * self.unit), bend / (2 * self.unit)), -1)

    def views(self, place: Tensor, stroke: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns the views of places from their strokes: [m, 7], with lengths in `unit`.

        place [m, 2]: places in the frame of their strokes
        stroke [m]: number of the stroke of each place
        """
        view = PathView.of(place, stroke, length, bend, 0.2 * self.unit)
        beyond = torch.maximum(-view.along, -view.ahead).clamp(min=0)
        away = torch.sqrt(view.aside**2 + beyond**2 + 1e-4 * self.unit**2)
        x, y = place.unbind(-1)
        seen = (view.along, view.ahead, view.aside, away, x, length[stroke] - x, y)
        return torch.stack(seen, -1) / self.unit

    def logits(self, view: Tensor, style: Tensor) -> Tensor:
        """Returns median and mean before the squash [m, 2] for views [m, 7] and styles of their strokes [m, 3]."""
        along, ahead, aside, away, x, rest, y = view.unbind(-1)
        thickness, length, bend = style.unbind(-1)
        steepness = bend / (2 * length + 0.3)
        mirrored = (
            along - 1, ahead - 1, 2 * away - 1, 0.5 * x - 0.7, 0.5 * rest - 0.7,
            4 * aside * aside - 1, y * y - 1, 2 * aside * bend, y * bend, 2 * aside * steepness,
            2 * thickness - 1, 2 * length - 2.25, 2 * bend * bend - 0.5, steepness * steepness - 0.5,
        )  # fmt: skip
        lopsided = (2 * aside, bend, y, steepness)
        features = torch.stack((*mirrored, *(_LOPSIDED * part for part in lopsided)), -1)
        marks: Tensor = self.layers(features)
        return marks

    def save(self, path: Path) -> str:
        """Writes the weights with their metadata and returns the file's sha256. Raises StorageError."""
        return write_model(path, self.format, self.version, self, self.state_dict())

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads weights of `save`. Raises WeightsError if they are missing or damaged or do not fit."""
        return cls.restore(ModelFile.read(path))

    @classmethod
    def restore(cls, file: ModelFile) -> Self:
        """Returns the model of a file of weights. Raises WeightsError if it is of another kind or does not fit."""
        if file.version == 1:
            file = _with_one_mark_for_both(file)
        file.require(FORMAT, VERSION)
        model = cls(file.brush, file.frame, file.limits)
        file.fill(model)
        try:
            model.spread.require()
        except ValueError as cause:
            raise file.misfit(cause) from cause
        if not 0 < float(model.reach) < math.inf:
            raise file.misfit(ValueError(f"a reach of {float(model.reach)} m"))
        return model


def _with_one_mark_for_both(file: ModelFile) -> ModelFile:
    """Converts a file of version 1, which has only the median: the median is used as the mean too."""
    tensors = {**file.tensors, "varies": torch.tensor(CERTAIN)}
    for name in ("layers.6.weight", "layers.6.bias"):
        if name in tensors:
            tensors[name] = torch.cat((tensors[name], tensors[name]))
    return replace(file, version=VERSION, tensors=tensors)


def _paths(length: Tensor, bend: Tensor) -> tuple[tuple[Tensor, Tensor], Tensor]:
    """Returns length and bend of the distinct paths [k] of n strokes, and the index of each stroke's path [n].

    If gradients are needed, each stroke has a separate path.
    """
    if torch.is_grad_enabled() and (length.requires_grad or bend.requires_grad):
        return (length, bend), torch.arange(len(length), device=length.device)
    shape = bend if bend.dim() == 2 else bend[:, None]  # codes of a family, or bends
    path, owner = torch.unique(torch.cat((length[:, None], shape), 1), dim=0, return_inverse=True)
    return (path[:, 0], path[:, 1:] if bend.dim() == 2 else path[:, 1]), owner


# Training of a stroke field on a stroke library
#
# Two strokes of one shape differ by a millimetre or two in place and width. A model that follows each stroke learns
# this noise. So noise is added to the shape of each stroke in training, but not to the place. The field then learns
# what strokes of similar shape have in common.
#
# One network learns both marks: the median minimises absolute errors, the mean squared errors. The spread is
# measured on the held-out strokes.

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
