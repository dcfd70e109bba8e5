"""A stroke model turned into a table, so that no network is evaluated while a plan is optimised.

The model is sampled once on a grid of (thickness, length, bend). The logits of its maps, which are
much smoother than the maps (see squash.py), are written in a low-rank basis, and the coordinates
in that basis are fitted by a tensor product of cubic B-splines, whose slopes are the model's slopes
too. A stroke then costs 4 x 4 x 4 rows of coefficients and its share of one matrix product over
those cells that any stroke ever touches. docs/stroke-model.md states error and speed.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import torch
from torch import Tensor, nn

from frida_painter.brush import spline
from frida_painter.brush.spread import CoverageSpread, spread_of
from frida_painter.brush.squash import squash, squash_slope, unsquash
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.frames import MapFrame
from frida_painter.strokes import StrokeLimits

_BATCH = 256
_NOTHING = -20.0
_DEEPER = 0.5


@dataclass(frozen=True)
class TableDetail:
    """How finely a model is tabulated.

    spans: pieces of the spline along thickness, length and bend; rank: maps in the basis; faint:
    cells whose magnitude never gets above it stay empty.
    """

    spans: tuple[int, int, int] = (5, 12, 12)
    rank: int = 96
    faint: float = 0.01


class StrokeTable(nn.Module):
    """The fast stand-in for a stroke model: the same brush, frame and limits.

    Magnitudes are in [0, 1], and exactly zero away from the mark. Parameters outside the limits
    count as the nearest ones inside. Differentiable once, in thickness, length and bend. The
    buffers follow `.to()` to another precision or device.
    """

    coefficients: Tensor  # [knots of thickness x length x bend, rank]
    basis: Tensor  # [rank, touched + 1]: maps of logits over those cells that some stroke touches, and one empty cell
    mean: Tensor  # [touched + 1], the mean of the logits
    cells: Tensor  # [touched], index of the touched cells in rows x columns
    source: Tensor  # [rows x columns], where each cell is found among the touched ones, or the empty one

    def __init__(
        self,
        model: StrokeModel,
        detail: TableDetail,
        coefficients: Tensor,
        basis: Tensor,
        mean: Tensor,
        touched: Tensor,
    ) -> None:
        super().__init__()
        self.brush: str = model.brush
        self.frame: MapFrame = model.frame
        self.limits: StrokeLimits = model.limits
        self.spread: CoverageSpread = spread_of(model)
        self.detail = detail
        cells = touched.nonzero()[:, 0]
        source = torch.full_like(touched, len(cells), dtype=torch.long)
        source[cells] = torch.arange(len(cells), device=cells.device)
        for name, buffer in {
            "coefficients": coefficients,
            "basis": nn.functional.pad(basis, (0, 1)),
            "mean": nn.functional.pad(mean, (0, 1), value=_NOTHING),
            "cells": cells,
            "source": source,
        }.items():
            self.register_buffer(name, buffer)

    @classmethod
    def of(cls, model: StrokeModel, like: Tensor | None = None, detail: TableDetail | None = None) -> Self:
        """Tabulates a model as it is now, in some seconds; make the table anew when the model changes.

        like: a tensor of the precision and on the device of the model (default: float32, CPU).
        """
        detail = detail or TableDetail()
        return cls.fitted(model, detail, sample(model, detail, torch.zeros(()) if like is None else like))

    @classmethod
    def fitted(cls, model: StrokeModel, detail: TableDetail, samples: Tensor) -> Self:
        """The table of a model from its maps [grid, rows x columns], as `sample` gives them for that detail."""
        grids = [spline.sample_grid(spans).to(samples) for spans in detail.spans]
        touched = samples.amax(0) > detail.faint
        logits = unsquash(samples[:, touched])
        logits -= _DEEPER * (samples[:, touched] == 0)  # so that small errors of the fit stay below the cut
        mean = logits.mean(0)
        logits -= mean
        basis = _best_basis(logits, detail.rank)
        return cls(model, detail, _fit(logits @ basis.T, grids, detail.spans), basis, mean, touched)

    def kept(self) -> dict[str, Tensor]:
        """What a table is made of again, by `restored`."""
        touched = torch.zeros(len(self.source), dtype=torch.bool, device=self.cells.device)
        touched[self.cells] = True
        return {
            "coefficients": self.coefficients,
            "basis": self.basis[:, :-1],
            "mean": self.mean[:-1],
            "touched": touched,
        }

    @classmethod
    def restored(cls, model: StrokeModel, detail: TableDetail, kept: Mapping[str, Tensor]) -> Self:
        """The table of that model and detail from what it kept. Raises KeyError, ValueError where that does not fit."""
        coefficients, basis, mean, touched = (kept[name] for name in ("coefficients", "basis", "mean", "touched"))
        rank, cells = len(basis), int(touched.sum())
        knots = math.prod(spans + 3 for spans in detail.spans)
        shapes = ((knots, rank), (rank, cells), (cells,), (model.frame.rows * model.frame.columns,))
        if (
            tuple(tuple(one.shape) for one in (coefficients, basis, mean, touched)) != shapes
            or touched.dtype != torch.bool
        ):
            raise ValueError(f"the parts of a table have the shapes {shapes}, the last one of booleans")
        return cls(model, detail, coefficients, basis, mean, touched)

    def forward(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """thickness [n] in [0, 1], length [n] and bend [n] in metres -> magnitude [n, rows, columns] in [0, 1]."""
        (shortest, longest), (least, most) = self.limits.length, self.limits.bend
        place = torch.stack((thickness, (length - shortest) / (longest - shortest), (bend - least) / (most - least)))
        maps: Tensor = _Lookup.apply(place.clamp(0, 1), self)  # type: ignore[no-untyped-call]
        return maps.view(-1, self.frame.rows, self.frame.columns)


class _Lookup(torch.autograd.Function):
    """Looks places up in a table: [3, n] in [0, 1] -> [n, rows x columns]. Keeps only what lies on touched cells."""

    @staticmethod
    def forward(context: Any, place: Tensor, table: StrokeTable) -> Tensor:
        row, weight, slope = spline.local(place, table.detail.spans)  # [n, 64], 3 x [n, 4], 3 x [n, 4]
        magnitude = squash(torch.addmm(table.mean, _summed(table, row, *weight), table.basis))  # [n, touched + 1]
        context.save_for_backward(row, *weight, *slope, magnitude)
        context.table = table
        return magnitude.index_select(1, table.source)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(context: Any, *upstream: Tensor) -> tuple[Tensor | None, ...]:
        row, w0, w1, w2, s0, s1, s2, magnitude = context.saved_tensors
        table = context.table
        upon_logits = upstream[0].index_select(1, table.cells).mul_(squash_slope(magnitude[:, :-1]))
        upon_coordinates = upon_logits @ table.basis[:, :-1].T  # [n, rank]
        along = (_summed(table, row, *weight) for weight in ((s0, w1, w2), (w0, s1, w2), (w0, w1, s2)))
        return torch.stack([(upon_coordinates * slope).sum(1) for slope in along]), None


def _summed(table: StrokeTable, row: Tensor, first: Tensor, second: Tensor, third: Tensor) -> Tensor:
    """Coefficients of the rows [n, 64] weighted by the products of three axes' weights [n, 4], summed: [n, rank]."""
    share = spline.outer(first, second, third)
    return nn.functional.embedding_bag(row, table.coefficients, per_sample_weights=share, mode="sum")


def sample(model: StrokeModel, detail: TableDetail, like: Tensor) -> Tensor:
    """The model's maps on the table's grid of all three parameters, [grid, rows x columns], precise as `like`."""
    grids = [spline.sample_grid(spans).to(like) for spans in detail.spans]
    (shortest, longest), (least, most) = model.limits.length, model.limits.bend
    thickness, length, bend = (part.flatten() for part in torch.meshgrid(*grids, indexing="ij"))
    length, bend = shortest + length * (longest - shortest), least + bend * (most - least)
    # Strokes that differ in thickness only are sampled together: some models see them from one path.
    order = torch.arange(len(length), device=like.device).view([len(grid) for grid in grids]).permute(1, 2, 0).flatten()
    samples = like.new_empty(len(order), model.frame.rows * model.frame.columns)
    with torch.no_grad():
        for part in torch.split(order, _BATCH):
            samples[part] = model(thickness[part], length[part], bend[part]).flatten(1)
    return samples


def _fit(coordinates: Tensor, grids: list[Tensor], spans: tuple[int, int, int]) -> Tensor:
    """Coefficients [knots, rank] of the splines that follow the basis coordinates [grid, rank] best."""
    fits = [spline.fit_matrix(grid, pieces) for grid, pieces in zip(grids, spans, strict=True)]
    cube = coordinates.reshape(*(len(grid) for grid in grids), -1)
    return torch.einsum("ai,bj,ck,ijkr->abcr", *fits, cube).flatten(0, 2).contiguous()


def _best_basis(samples: Tensor, rank: int) -> Tensor:
    """Orthonormal maps [rank, cells] that span the samples best (randomised subspace iteration, fixed seed)."""
    rank = min(rank, *samples.shape)
    wider = min(rank + 16, *samples.shape)
    probe = torch.randn(wider, len(samples), generator=torch.Generator().manual_seed(0)).to(samples)
    span = probe @ samples
    for _ in range(2):
        span = (samples @ torch.linalg.qr(span.T)[0]).T @ samples
    span = torch.linalg.qr(span.T)[0].T  # [wider, cells]
    return (torch.linalg.svd(samples @ span.T, full_matrices=False)[2] @ span)[:rank].contiguous()
