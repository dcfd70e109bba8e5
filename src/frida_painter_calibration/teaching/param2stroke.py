"""Stroke model of the paper: a small network from the shape of a stroke to its mark."""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from frida_painter.brush import FEWEST_STROKES
from frida_painter.brush.field import ModelFile, StrokeField, write_model
from frida_painter.brush.kinds import BrushKind
from frida_painter.brush.library import StrokeLibrary
from frida_painter.brush.table import squash, stretch_sigmoid
from frida_painter.frames import MapFrame
from frida_painter.strokes import StrokeLimits
from frida_painter_calibration.teaching.training import Best, Split, TrainingProgress, TrainingReport, train_field

FORMAT = "frida-painter param2stroke"
VERSION = 1
HIDDEN = 96
CHANNELS = 12
_UPSCALE = 2
_SPREAD = 6.0
_BARE = 3.0


class Param2Stroke(nn.Module):
    """Network of two linear layers, two convolutions and a bilinear upscaler (paper, "Brush Stroke Model").

    limits: lengths and bends for the normalisation of the inputs
    frame: rectangle of the map, with even numbers of rows and columns; else raises ValueError

    The linear layers draw the mark as logits on cells of twice the size. The convolutions refine it, and the
    upscaler brings it to the size of the map. The squash comes last, so edges may be sharper than the cells.
    """

    def __init__(self, brush: str, frame: MapFrame, limits: StrokeLimits) -> None:
        super().__init__()
        if frame.rows % _UPSCALE or frame.columns % _UPSCALE:
            raise ValueError(f"a map of {frame.rows} x {frame.columns} cells cannot be upscaled by {_UPSCALE}")
        self.brush = brush
        self.frame = frame
        self.limits = limits
        self.coarse = (frame.rows // _UPSCALE, frame.columns // _UPSCALE)
        self.widen = nn.Linear(3, HIDDEN)
        self.draw = nn.Linear(HIDDEN, self.coarse[0] * self.coarse[1])
        self.refine = nn.Conv2d(1, CHANNELS, 3, padding=1)
        self.gather = nn.Conv2d(CHANNELS, 1, 3, padding=1)
        with torch.no_grad():
            # With larger first weights a small network can draw edges that move with its inputs. It starts with
            # bare paper, because otherwise training may get stuck there.
            self.widen.weight.mul_(_SPREAD)
            self.widen.bias.mul_(_SPREAD)
            self.gather.bias = nn.Parameter(torch.tensor([-_BARE]))

    @classmethod
    def fresh(cls, kind: BrushKind, seed: int = 0) -> Self:
        """Returns an untrained model for a brush; the same seed gives the same weights."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            return cls(kind.name, kind.frame, kind.limits)

    def forward(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns magnitudes [n, rows, columns] in [0, 1].

        thickness [n]: in [0, 1]
        length [n], bend [n]: in metres
        """
        return squash(self.logits(thickness, length, bend))

    def logits(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns the maps before the squash: [n, rows, columns]."""
        shape = torch.stack((thickness, _normal(length, self.limits.length), _normal(bend, self.limits.bend)), -1)
        hidden = nn.functional.silu(self.widen(2 * shape - 1))  # [n, hidden]
        drawing = self.draw(hidden).unflatten(1, (1, *self.coarse))  # [n, 1, rows / 2, columns / 2]
        refined = self.gather(nn.functional.silu(self.refine(drawing)))
        return nn.functional.interpolate(refined, scale_factor=_UPSCALE, mode="bilinear", align_corners=False)[:, 0]

    def save(self, path: Path) -> str:
        """Writes the weights with their metadata and returns the file's sha256. Raises StorageError."""
        return write_model(path, FORMAT, VERSION, self, self.state_dict())

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads weights of `save`. Raises WeightsError if they are missing or damaged or do not fit."""
        return cls.restore(ModelFile.read(path))

    @classmethod
    def restore(cls, file: ModelFile) -> Self:
        """Returns the model of a file of weights. Raises WeightsError if it is of another kind or does not fit."""
        file.require(FORMAT, VERSION)
        try:
            model = cls(file.brush, file.frame, file.limits)
        except ValueError as cause:
            raise file.misfit(cause) from cause
        file.fill(model)
        return model


def _normal(value: Tensor, bounds: tuple[float, float]) -> Tensor:
    """Returns the value scaled to 0 at the lower and 1 at the upper bound."""
    return (value - bounds[0]) / (bounds[1] - bounds[0])


# Training of param2stroke on a stroke library
#
# A few hundred photographs do not show facts that are known anyway: a mark lies along a Bezier, and its width
# follows the pressure. The field (field.py) contains these facts and learns more from the photographs. So the field
# is trained first. Then the network is trained on many strokes of the field, and at last on the photographs (G.
# Hinton, O. Vinyals and J. Dean, "Distilling the Knowledge in a Neural Network", 2015).

_BATCH = 32
_REHEARSED = 3000
_REHEARSAL_RATE = 1e-2
_RATE = 3e-3


@dataclass(frozen=True)
class _Examples:
    """Strokes with their target maps."""

    thickness: Tensor
    length: Tensor
    bend: Tensor
    wanted: Tensor  # [n, rows, columns]

    def __len__(self) -> int:
        return len(self.wanted)

    def __getitem__(self, index: Tensor | NDArray[np.int64]) -> "_Examples":
        return _Examples(self.thickness[index], self.length[index], self.bend[index], self.wanted[index])


def train_param2stroke(
    model: Param2Stroke,
    library: StrokeLibrary,
    *,
    seed: int = 0,
    rehearsals: int = 20,
    epochs: int = 60,
    patience: int = 30,
    notify: Callable[[TrainingProgress], None] | None = None,
) -> TrainingReport:
    """Trains `model` in place on the strokes of a library.

    rehearsals: epochs on strokes of a field; their training error is that against the field. 0 for none, as in
    the paper.
    epochs: largest number of epochs on the library
    patience: number of epochs without a better validation error after which training ends

    A fifth of the strokes is held out for validation (paper, "Brush Stroke Model"). The loss is L1, whose
    optimum is the median: the paper stays clean at places that only stray bristles reach. Then the network is
    trained again on all strokes until the best epoch, so it is slightly better than the report says. The same
    seed gives the same weights.
    Raises LibraryError if there are fewer than 5 strokes.
    """
    chance = torch.Generator().manual_seed(seed)
    split = Split.of(library, chance)
    examples = _Examples(*library.shapes(), library.maps(model.frame))
    untrained = {name: tensor.clone() for name, tensor in model.state_dict().items()}
    rounds = (rehearsals if len(split.training) >= FEWEST_STROKES else 0, epochs)  # too few strokes for a field
    validation = examples[split.held_out]

    curve: list[TrainingProgress] = []
    best = Best(model)
    for training_error in _course(model, library[split.training], examples[split.training], rounds, seed, chance):
        error = float((_predict(model, validation) - validation.wanted).abs().mean())
        best.see(len(curve) + 1, error)
        curve.append(TrainingProgress(len(curve) + 1, sum(rounds), training_error, error, best.error))
        if notify is not None:
            notify(curve[-1])
        if len(curve) - max(best.epoch, rounds[0]) >= patience:
            break
    best.restore()
    report = TrainingReport(best.epoch, best.error, split.held_out, _predict(model, validation), tuple(curve))

    model.load_state_dict(untrained)
    for _ in itertools.islice(_course(model, library, examples, rounds, seed, chance), best.epoch):
        pass
    return report


def _course(
    model: Param2Stroke,
    library: StrokeLibrary,
    examples: _Examples,
    rounds: tuple[int, int],
    seed: int,
    chance: torch.Generator,
) -> Iterator[float]:
    """Yields the training error of each epoch: first those of rehearsal, then those on the library."""
    rehearsals, epochs = rounds
    lessons = [(examples, _RATE, epochs)]
    if rehearsals > 0:
        lessons.insert(0, (_rehearse(model, library, seed, chance), _REHEARSAL_RATE, rehearsals))
    for part, rate, count in lessons:
        optimizer = torch.optim.Adam(model.parameters(), lr=rate)
        steps = count * -(-len(part) // _BATCH)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, max_lr=rate, total_steps=steps, pct_start=0.1)
        for _ in range(count):
            yield _epoch(model, part, optimizer, schedule, chance)


def _rehearse(model: Param2Stroke, library: StrokeLibrary, seed: int, chance: torch.Generator) -> _Examples:
    """Returns random strokes with the median maps of a field that was trained on the library."""
    limits = model.limits
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        teacher = StrokeField(model.brush, model.frame, limits)
    train_field(teacher, library, seed=seed)
    thickness, along, aside = torch.rand(3, _REHEARSED, generator=chance)
    length = limits.length[0] + along * (limits.length[1] - limits.length[0])
    bend = limits.bend[0] + aside * (limits.bend[1] - limits.bend[0])
    with torch.no_grad():
        return _Examples(thickness, length, bend, teacher.median(thickness, length, bend))


def _epoch(
    model: Param2Stroke,
    examples: _Examples,
    optimizer: torch.optim.Optimizer,
    schedule: torch.optim.lr_scheduler.LRScheduler,
    chance: torch.Generator,
) -> float:
    """Trains on each example once; returns the mean absolute error during the epoch."""
    total = 0.0
    for index in torch.split(torch.randperm(len(examples), generator=chance), _BATCH):
        batch = examples[index]
        difference = stretch_sigmoid(model.logits(batch.thickness, batch.length, batch.bend)) - batch.wanted
        absolute = difference.abs().mean()
        optimizer.zero_grad()
        absolute.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        schedule.step()
        total += float(absolute.detach()) * len(index)
    return total / len(examples)


@torch.no_grad()
def _predict(model: Param2Stroke, examples: _Examples) -> Tensor:
    return model(examples.thickness, examples.length, examples.bend)
