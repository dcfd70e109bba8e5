"""Stroke model of the paper: a small network from the shape of a stroke to its mark."""

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Self

import torch
from torch import Tensor, nn

from frida_painter.brush import FEWEST_STROKES
from frida_painter.brush.field import ModelFile, StrokeField, write_model
from frida_painter.brush.library import StrokeLibrary
from frida_painter.brush.table import squash, stretch_sigmoid
from frida_painter.frames import MapFrame
from frida_painter.strokes.strokes import StrokeLimits
from frida_painter_calibration.teaching.training import (
    Hearing,
    TrainingReport,
    hold_out,
    make_fresh,
    train_field,
    train_until_best,
)

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
        self.brush, self.frame, self.limits = brush, frame, limits
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

    def forward(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns magnitudes [n, rows, columns] in [0, 1].

        thickness [n]: in [0, 1]
        length [n], bend [n]: in metres
        """
        return squash(self.logits(thickness, length, bend))

    def logits(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns the maps before the squash: [n, rows, columns]."""
        (shortest, longest), (least, most) = self.limits.length, self.limits.bend
        shape = torch.stack(
            (thickness, (length - shortest) / (longest - shortest), (bend - least) / (most - least)), -1
        )
        hidden = nn.functional.silu(self.widen(2 * shape - 1))  # [n, hidden]
        drawing = self.draw(hidden).unflatten(1, (1, *self.coarse))  # [n, 1, rows / 2, columns / 2]
        refined = self.gather(nn.functional.silu(self.refine(drawing)))
        return nn.functional.interpolate(refined, scale_factor=_UPSCALE, mode="bilinear", align_corners=False)[:, 0]

    def save(self, path: Path) -> str:
        """Writes the weights with their metadata and returns the file's sha256. Raises StorageError."""
        return write_model(path, FORMAT, VERSION, self, self.state_dict())

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


def train_param2stroke(
    model: Param2Stroke,
    library: StrokeLibrary,
    *,
    seed: int = 0,
    rehearsals: int = 20,
    epochs: int = 60,
    patience: int = 30,
    notify: Hearing | None = None,
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
    training, held_out = hold_out(library, chance)
    untrained = {name: tensor.clone() for name, tensor in model.state_dict().items()}
    rehearsals = rehearsals if len(training) >= FEWEST_STROKES else 0  # fewer are too few for a field
    shapes, wanted = library[held_out].shapes(), library[held_out].maps(model.frame)

    @torch.no_grad()
    def validate() -> float:
        return float((model(*shapes) - wanted).abs().mean())

    course = _train(model, library[training], rehearsals, epochs, seed, chance)
    total = rehearsals + epochs
    curve = train_until_best(model, course, validate, total, patience, notify, unjudged=rehearsals)
    with torch.no_grad():
        report = TrainingReport(held_out, model(*shapes), curve)
    model.load_state_dict(untrained)
    for _ in itertools.islice(_train(model, library, rehearsals, epochs, seed, chance), report.best_epoch):
        pass
    return report


def _train(
    model: Param2Stroke, library: StrokeLibrary, rehearsals: int, epochs: int, seed: int, chance: torch.Generator
) -> Iterator[float]:
    """Yields the training error of each epoch: first those of rehearsal, then those on the library."""
    lessons: list[tuple[tuple[Tensor, ...], float, int]] = [
        ((*library.shapes(), library.maps(model.frame)), _RATE, epochs)
    ]
    if rehearsals > 0:
        lessons.insert(0, (_rehearse(model, library, seed, chance), _REHEARSAL_RATE, rehearsals))
    for examples, rate, count in lessons:
        total = len(examples[0])
        optimizer = torch.optim.Adam(model.parameters(), lr=rate)
        steps = count * -(-total // _BATCH)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, max_lr=rate, total_steps=steps, pct_start=0.1)
        for _ in range(count):
            missed = 0.0
            for index in torch.split(torch.randperm(total, generator=chance), _BATCH):
                *shape, wanted = (part[index] for part in examples)
                error = (stretch_sigmoid(model.logits(*shape)) - wanted).abs().mean()
                optimizer.zero_grad()
                error.backward()  # type: ignore[no-untyped-call]
                optimizer.step()
                schedule.step()
                missed += float(error.detach()) * len(index)
            yield missed / total


def _rehearse(model: Param2Stroke, library: StrokeLibrary, seed: int, chance: torch.Generator) -> tuple[Tensor, ...]:
    """Returns shapes of random strokes, and their median maps by a field that was trained on the library."""
    limits = model.limits
    teacher = make_fresh(StrokeField, model.brush, model.frame, limits, seed)
    train_field(teacher, library, seed=seed)
    thickness, along, aside = torch.rand(3, _REHEARSED, generator=chance)
    length = limits.length[0] + along * (limits.length[1] - limits.length[0])
    bend = limits.bend[0] + aside * (limits.bend[1] - limits.bend[0])
    with torch.no_grad():
        return thickness, length, bend, teacher.median(thickness, length, bend)
