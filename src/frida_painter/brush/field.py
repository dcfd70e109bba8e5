"""Stroke field, this project's stroke model: amount of paint at a place, seen from the path of the stroke.

param2stroke draws a whole map. The field is evaluated place by place. A place is described by its position
along the path and beside it. So the model contains what is known: a mark follows the Bezier, looks alike for
strokes of all lengths, and is nearly symmetric in left and right bends. A network of a few thousand weights
learns the rest from as few as ten strokes.

It predicts two marks of a stroke. The mean over repeated strokes is used for planning. The median shows the
typical stroke, with sharper edges. `spread` describes the variation.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import torch
from torch import Tensor, nn

from frida_painter.brush.kinds import CERTAIN, BrushKind, CoverageSpread, StrokeModel
from frida_painter.brush.table import squash
from frida_painter.errors import WeightsError
from frida_painter.frames import MapFrame
from frida_painter.strokes.strokes import StrokeLimits
from frida_painter.system import tensor_file

if TYPE_CHECKING:
    from frida_painter.brush.library import StrokeLibrary

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


_ABOUT = "stroke_model"
_LARGEST_MAP = 4096
_FARTHEST = 10.0


@dataclass(frozen=True)
class ModelFile:
    """Content of a file of weights: tensors and metadata of a stroke model, checked when they are read.

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
        try:
            about = json.loads(metadata.get(_ABOUT, ""))
        except (ValueError, RecursionError):
            about = None
        about = about if isinstance(about, dict) else {}
        if not isinstance(about.get("format"), str) or not isinstance(about.get("version"), int):
            raise _foreign(path)
        try:
            family = str(about.get("family", ""))
            return cls(path, about["format"], about["version"], str(about["brush"]), *_geometry(about), tensors, family)
        except (KeyError, TypeError, ValueError, OverflowError) as cause:
            raise _misfit(path, cause) from cause

    def require(self, format: str, version: int) -> None:
        """Raises WeightsError unless the file has that format and version."""
        if (self.format, self.version) != (format, version):
            raise _foreign(self.path)

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


def _foreign(path: Path) -> WeightsError:
    return WeightsError(
        f"{path} does not hold weights of a stroke model of this version; "
        "give a file that `frida-painter strokes train` wrote."
    )


def _misfit(path: Path, cause: Exception) -> WeightsError:
    return WeightsError(
        f"{path} holds weights of a stroke model with a part missing, out of range or of the wrong shape "
        f"({str(cause).splitlines()[0]}); train them anew."
    )


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
        self.brush, self.frame, self.limits = brush, frame, limits
        self.unit = limits.length[1] / 5
        self.register_buffer("reach", torch.tensor(max(frame.top, frame.right)))
        self.register_buffer("varies", torch.tensor(CERTAIN))
        hidden = (nn.Linear(self.features, HIDDEN), nn.Linear(HIDDEN, HIDDEN), nn.Linear(HIDDEN, HIDDEN))
        parts = [part for layer in hidden for part in (layer, nn.SiLU())]
        self.layers = nn.Sequential(*parts, nn.Linear(HIDDEN, 2))
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
        """Returns mean magnitudes [n, rows, columns] in [0, 1]; arguments as in `StrokeModel`."""
        return self._in_batches(thickness, length, bend, MEAN)

    def median(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns median magnitudes [n, rows, columns] in [0, 1]; arguments as in `StrokeModel`."""
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

    def recorded_maps(self, library: "StrokeLibrary") -> Tensor:
        """Returns the marks of a library on the cells of the strokes' frames, [n, rows, columns] in [0, 1]."""
        return library.maps(self.frame)

    def near(self, length: Tensor, bend: Tensor) -> Tensor:
        """Returns the mask of cells that may hold paint: [n, rows x columns]."""
        return self.outside(length, bend) < self.reach

    @torch.no_grad()
    def outside(self, length: Tensor, bend: Tensor) -> Tensor:
        """Returns the distance of cells from the rectangle around the path, [n, rows x columns] m, negative inside."""
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


def _paths(length: Tensor, bend: Tensor) -> tuple[tuple[Tensor, Tensor], Tensor]:
    """Returns length and bend of the distinct paths [k] of n strokes, and the index of each stroke's path [n].

    If gradients are needed, each stroke has a separate path.
    """
    if torch.is_grad_enabled() and (length.requires_grad or bend.requires_grad):
        return (length, bend), torch.arange(len(length), device=length.device)
    shape = bend if bend.dim() == 2 else bend[:, None]  # codes of a family, or bends
    path, owner = torch.unique(torch.cat((length[:, None], shape), 1), dim=0, return_inverse=True)
    return (path[:, 0], path[:, 1:] if bend.dim() == 2 else path[:, 1]), owner
