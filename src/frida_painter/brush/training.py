"""Shared parts of the training of stroke models: held-out strokes, progress, reports, files of weights."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from frida_painter import tensor_file
from frida_painter.brush import FEWEST_STROKES
from frida_painter.brush.kinds import StrokeModel
from frida_painter.brush.library import StrokeLibrary
from frida_painter.errors import LibraryError, WeightsError
from frida_painter.frames import MapFrame
from frida_painter.strokes import StrokeLimits

# Files of weights: tensors and metadata of a stroke model, checked when they are read

_ABOUT = "stroke_model"
_LARGEST_MAP = 4096
_FARTHEST = 10.0


@dataclass(frozen=True)
class ModelFile:
    """Content of a file of weights.

    format: kind of the stroke model
    version: version of that format
    brush, frame, limits: as in StrokeModel
    tensors: weights by name
    family: name of the stroke family; "" for a brush's own strokes
    """

    path: Path
    format: str
    version: int
    brush: str
    frame: MapFrame
    limits: StrokeLimits
    tensors: dict[str, Tensor]
    family: str = ""

    @classmethod
    def read(cls, path: Path) -> "ModelFile":
        """Reads weights of any kind of stroke model. Raises WeightsError if they are missing, damaged or foreign."""
        tensors, metadata = tensor_file.read_tensors(path, "weights of a stroke model", WeightsError)
        about = _about(metadata)
        if not isinstance(about.get("format"), str) or not isinstance(about.get("version"), int):
            raise WeightsError(_foreign(path))
        try:
            family = str(about.get("family", ""))
            return cls(path, about["format"], about["version"], str(about["brush"]), *_geometry(about), tensors, family)
        except (KeyError, TypeError, ValueError, OverflowError) as cause:
            raise _misfit(path, cause) from cause

    def require(self, format: str, version: int) -> None:
        """Raises WeightsError unless the file has that format and version."""
        if (self.format, self.version) != (format, version):
            raise WeightsError(_foreign(self.path))

    def fill(self, model: nn.Module) -> None:
        """Loads the weights into a model and freezes it. Raises WeightsError if they do not fit."""
        try:
            model.load_state_dict(self.tensors)
        except (RuntimeError, ValueError) as cause:
            raise _misfit(self.path, cause) from cause
        model.eval().requires_grad_(False)

    def misfit(self, cause: Exception) -> WeightsError:
        """Returns the error for a file from which no model can be built."""
        return _misfit(self.path, cause)


def write_model(path: Path, format: str, version: int, model: StrokeModel, tensors: Mapping[str, Tensor]) -> str:
    """Writes weights with their metadata and returns the file's sha256. Raises StorageError."""
    frame, limits = model.frame, model.limits
    about = {
        "format": format,
        "version": version,
        "brush": model.brush,
        "frame": [frame.left, frame.right, frame.bottom, frame.top],
        "cells": [frame.rows, frame.columns],
        "limits": [*limits.length, *limits.bend],
        **({} if limits.family is None else {"family": limits.family.name}),
    }
    # A single entry, because the order of several entries would change from run to run.
    return tensor_file.write_tensors(path, tensors, {_ABOUT: json.dumps(about)})


def _foreign(path: Path) -> str:
    return (
        f"{path} does not hold weights of a stroke model of this version; "
        "give a file that `frida-painter strokes train` wrote."
    )


def _misfit(path: Path, cause: Exception) -> WeightsError:
    return WeightsError(
        f"{path} holds weights of a stroke model with a part missing, out of range or of the wrong shape "
        f"({str(cause).splitlines()[0]}); train them anew."
    )


def _about(metadata: dict[str, str]) -> dict[str, Any]:
    """Returns the metadata of a file of weights; empty if it cannot be read."""
    try:
        about = json.loads(metadata.get(_ABOUT, ""))
    except (ValueError, RecursionError):
        return {}
    return about if isinstance(about, dict) else {}


def _geometry(about: dict[str, Any]) -> tuple[MapFrame, StrokeLimits]:
    """Returns frame and limits from the metadata. Raises KeyError, TypeError, ValueError or OverflowError."""
    left, right, bottom, top = (float(number) for number in about["frame"])
    rows, columns = about["cells"]
    shortest, longest, least, most = (float(number) for number in about["limits"])
    metres = (left, right, bottom, top, shortest, longest, least, most)
    if not all(math.isfinite(number) and abs(number) < _FARTHEST for number in metres):
        raise ValueError(f"a measure that is not finite or above {_FARTHEST:g} m")
    bends = least < most or "family" in about  # a stroke of a family has codes and no bend
    if not (left < 0 < right and bottom < 0 < top and 0 < shortest < longest and bends):
        raise ValueError("a rectangle or limits without extent")
    if not (isinstance(rows, int) and isinstance(columns, int)):
        raise TypeError("a map with broken cells")
    if not (0 < rows <= _LARGEST_MAP and 0 < columns <= _LARGEST_MAP and rows * columns <= _LARGEST_MAP**2 // 16):
        raise ValueError(f"a map of {rows} x {columns} cells")
    return MapFrame(left, right, bottom, top, rows, columns), StrokeLimits((shortest, longest), (least, most))


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
