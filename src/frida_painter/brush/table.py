"""Table of a stroke model, so that planning evaluates no network.

The model is sampled once on a grid of (thickness, length, bend). A tensor product of cubic B-splines is fitted
to the logits of its maps, which are much smoother than the maps (see `squash`). The gradients of the splines
follow those of the model. Lengths and bends are divided into parts. Strokes of one part touch fewer cells and
are more alike, so each part stores its coefficients in a separate small basis. A stroke then costs 4 x 4 x 4
rows of coefficients and one product with that basis. docs/lab/stroke-models.md gives error and speed.
"""

import contextlib
import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import platformdirs
import torch
from torch import Tensor, nn

from frida_painter.brush.kinds import CoverageSpread, StrokeModel, spread_of
from frida_painter.errors import StorageError
from frida_painter.frames import MapFrame
from frida_painter.strokes.family import CODE_REACH
from frida_painter.strokes.strokes import StrokeLimits
from frida_painter.system import tensor_file
from frida_painter.system.devices import array, compiles_for

# Squash: conversion of smooth logits to magnitudes
#
# It is a sigmoid, stretched slightly beyond [0, 1] and clipped there. Away from a mark the magnitude is exactly
# zero, so hundreds of strokes leave no haze.

BEYOND = 0.005
"""Overshoot of the stretched sigmoid below 0 and above 1."""


def stretch_sigmoid(logits: Tensor) -> Tensor:
    """Returns the sigmoid before clipping, in [-BEYOND, 1 + BEYOND].

    Training uses it, because its gradient is never zero.
    """
    return torch.sigmoid(logits).mul(1 + 2 * BEYOND).sub(BEYOND)


def squash(logits: Tensor) -> Tensor:
    """Converts logits of any shape to magnitudes in [0, 1]."""
    return stretch_sigmoid(logits).clamp(0, 1)


def unsquash(magnitude: Tensor) -> Tensor:
    """Returns the logits of magnitudes; for 0 and 1 those at which the clipping begins."""
    return torch.logit((magnitude + BEYOND) / (1 + 2 * BEYOND))


# Uniform cubic B-splines on [0, 1]
#
# A spline with m spans has m + 3 coefficients; four of them count at each place.

_SAMPLES_PER_SPAN = 1.5


def weights(place: Tensor, spans: int) -> tuple[Tensor, Tensor]:
    """Returns the index of the first of the four coefficients that count [n], and their weights [n, 4].

    place [n]: in [0, 1]
    The weights are differentiable.
    """
    at = place * spans
    first = at.detach().floor().clamp(0, spans - 1)
    t = at - first
    s = 1 - t
    weight = torch.stack((s**3, 4 - 6 * t**2 + 3 * t**3, 4 - 6 * s**2 + 3 * s**3, t**3), -1) / 6
    return first.long(), weight


def rows(first: Sequence[Tensor], knots: Sequence[int]) -> Tensor:
    """Returns the indices of the 4^axes rows around each point: [n, 64] for three axes.

    first: first coefficient along each axis, axes x [n]
    knots: size of the cube of coefficients along each axis
    """
    step = torch.arange(4, device=first[0].device)
    row = first[0][:, None] + step  # [n, 4]
    for axis, size in zip(first[1:], knots[1:], strict=True):
        row = (row[:, :, None] * size + (axis[:, None] + step)[:, None, :]).flatten(1)
    return row


def outer(*axes: Tensor) -> Tensor:
    """Returns the products of the weights of the axes: axes x [n, 4] -> [n, 4^axes]."""
    product = axes[0]
    for axis in axes[1:]:
        product = (product[:, :, None] * axis[:, None, :]).flatten(1)
    return product


def sample_grid(spans: int) -> Tensor:
    """Returns the places in [0, 1] at which a function is sampled for a spline with `spans` spans."""
    return torch.linspace(0, 1, round(_SAMPLES_PER_SPAN * spans) + 4, dtype=torch.float64)


def fit_matrix(grid: Tensor, spans: int) -> Tensor:
    """Returns the matrix [spans + 3, samples] that converts samples on the grid to coefficients, by least squares."""
    first, weight = weights(grid.double(), spans)
    design = torch.zeros(len(grid), spans + 3, dtype=torch.float64, device=grid.device)
    design.scatter_(1, first[:, None] + torch.arange(4, device=grid.device), weight)
    return torch.linalg.pinv(design).to(grid)


_BATCH = 256
_DEEPER = 0.5
_FAMILY_SPANS = {1: (4, 4, 8), 2: (3, 3, 4, 4)}  # by the number of codes


@dataclass(frozen=True)
class TableDetail:
    """Resolution of a table.

    spans: spans of the splines along thickness, length and bend, or along thickness, length and each code of a family
    rank: number of maps in each basis
    faint: cells with no magnitude above this stay empty
    parts: number of parts of lengths and of bends (or first codes), each with a separate basis
    """

    spans: tuple[int, ...] = (5, 12, 12)
    rank: int = 32
    faint: float = 0.01
    parts: tuple[int, int] = (4, 3)

    @classmethod
    def of(cls, model: StrokeModel) -> Self:
        """Returns the usual resolution for a model."""
        family = model.limits.family
        return cls() if family is None else cls(_FAMILY_SPANS[family.codes], parts=(3, 2))


class StrokeTable(nn.Module):
    """Fast replacement of a stroke model with the same brush, frame and limits.

    Magnitudes are in [0, 1], and exactly zero away from the mark. Parameters outside the limits are clamped.
    Differentiable once in thickness, length and bend. The buffers follow `.to()`. Compiled loops work in
    float32 on the CPU (table_kernels.py); otherwise PyTorch computes the same.

    window: rows and columns of the smallest window that holds the marks of any part. Each part has its own
    position of the window in the frame. Renderers draw windows, because a frame is mostly empty.
    """

    coefficients: Tensor  # [parts, knots of thickness, of length, of bend (or of each code), rank]
    basis: Tensor  # [parts, rank, most]: maps of logits over the cells that strokes of the part touch
    mean: Tensor  # [parts, most], mean of the logits
    cells: Tensor  # [parts, most], index of these cells in rows x columns; padded with rows x columns
    counts: Tensor  # [parts], number of these cells
    part_of: Tensor  # [axes, spans], contribution of each span of each axis to the number of the part
    first_of: Tensor  # [axes, spans], first knot of each span inside its part
    corners: Tensor  # [parts, 2], column and row of each part's window in the frame
    inside: Tensor  # [parts, most], `cells` as indices into the window; padded with the window's size

    def __init__(self, model: StrokeModel, detail: TableDetail, kept: Mapping[str, Tensor]) -> None:
        """Makes a table from its buffers by name (`kept`)."""
        super().__init__()
        self.brush: str = model.brush
        self.frame: MapFrame = model.frame
        self.limits: StrokeLimits = model.limits
        self.spread: CoverageSpread = spread_of(model)
        self.detail = detail
        part_of, first_of = _places_of_spans(detail)
        self.window, corners, inside = _windows(kept["cells"], kept["counts"], model.frame)
        derived = {"part_of": part_of, "first_of": first_of, "corners": corners, "inside": inside}
        for name, buffer in {**kept, **derived}.items():
            self.register_buffer(name, buffer, persistent=name in kept)

    @classmethod
    def of(cls, model: StrokeModel, like: Tensor | None = None, detail: TableDetail | None = None) -> Self:
        """Tabulates a model in some seconds. Make a new table if the model changes.

        like: a tensor with the precision and the device of the model; default float32, CPU
        """
        detail = detail or TableDetail.of(model)
        return cls.from_samples(model, detail, sample(model, detail, torch.zeros(()) if like is None else like))

    @classmethod
    def from_samples(cls, model: StrokeModel, detail: TableDetail, samples: Tensor) -> Self:
        """Returns the table of a model from its maps [grid, rows x columns], as returned by `sample`."""
        grids = [sample_grid(spans).to(samples) for spans in detail.spans]
        touched = (samples.amax(0) > detail.faint).nonzero()[:, 0]
        marks = samples[:, touched]
        logits = unsquash(marks)
        logits -= _DEEPER * (marks == 0)  # keeps small errors of the fit below the clipping
        knots = _fit(logits, grids, detail.spans)
        shape = [len(grid) for grid in grids]
        marks, logits = marks.view(*shape, -1), logits.view(*shape, -1)
        found = []
        for lengths in _edges(detail, 0):
            for bends in _edges(detail, 1):
                rows, columns = _between(grids[1], detail.spans[1], lengths), _between(grids[2], detail.spans[2], bends)
                mine = (marks[:, rows][:, :, columns].flatten(0, -2).amax(0) > detail.faint).nonzero()[:, 0]
                near = logits[:, rows][:, :, columns][..., mine].flatten(0, -2)
                mean = near.mean(0)
                basis = _best_basis(near - mean, detail.rank)
                block = knots[:, lengths[0] : lengths[1] + 3, bends[0] : bends[1] + 3][..., mine]
                found.append(((block - mean) @ basis.T, basis, mean, touched[mine]))
        parts, sizes, rank = _sizes(detail)
        most = max(1, *(len(cells) for *_, cells in found))
        kept = {
            "coefficients": samples.new_zeros(parts, *sizes, rank),
            "basis": samples.new_zeros(parts, rank, most),
            "mean": samples.new_zeros(parts, most),
            "cells": torch.full((parts, most), samples.shape[1], device=samples.device),
            "counts": torch.tensor([len(cells) for *_, cells in found], device=samples.device),
        }
        for part, (coefficients, basis, mean, cells) in enumerate(found):
            _, along, aside, *_, used = coefficients.shape
            kept["coefficients"][part, :, :along, :aside, ..., :used] = coefficients
            kept["basis"][part, :used, : len(cells)] = basis
            kept["mean"][part, : len(cells)] = mean
            kept["cells"][part, : len(cells)] = cells
        return cls(model, detail, kept)

    def to_tensors(self) -> dict[str, Tensor]:
        """Returns the buffers from which `restore` makes the table again."""
        return {name: self.get_buffer(name) for name in _KEPT}

    @classmethod
    def restore(cls, model: StrokeModel, detail: TableDetail, kept: Mapping[str, Tensor]) -> Self:
        """Returns the table from the buffers of `kept`. Raises KeyError or ValueError if they do not fit."""
        kept = {name: kept[name] for name in _KEPT}
        parts, knots, rank = _sizes(detail)
        most, whole = kept["mean"].shape[-1] if kept["mean"].dim() else 0, model.frame.rows * model.frame.columns
        shapes = ((parts, *knots, rank), (parts, rank, most), (parts, most), (parts, most), (parts,))
        counts, cells = kept["counts"], kept["cells"]
        if (
            tuple(tuple(one.shape) for one in kept.values()) != shapes
            or (counts.dtype, cells.dtype) != (torch.int64, torch.int64)
            or not bool(((counts >= 0) & (counts <= most)).all())
            or not bool(((cells >= 0) & (cells <= whole)).all())
            or not bool(((cells < whole).sum(1) == counts).all())
        ):
            raise ValueError(f"the parts of a table have the shapes {shapes}, and count cells of {whole}")
        return cls(model, detail, kept)

    def forward(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns magnitudes [n, rows, columns] in [0, 1].

        thickness [n]: in [0, 1]
        length [n], bend [n]: in metres; codes [n, k] of a family in the place of bend
        """
        maps, shift = self.windows(thickness, length, bend)
        left, top = shift[:, :, 2].long().unbind(1)
        row, column = (torch.arange(side, device=maps.device) for side in self.window)
        cell = (top[:, None, None] + row[:, None]) * self.frame.columns + left[:, None, None] + column  # [n, h, w]
        whole = maps.new_zeros(len(maps), self.frame.rows * self.frame.columns)
        return whole.scatter(1, cell.flatten(1), maps.flatten(1)).view(-1, self.frame.rows, self.frame.columns)

    def windows(self, thickness: Tensor, length: Tensor, bend: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the magnitudes of `forward` in each stroke's window alone, [n, h, w], and shifts [n, 2, 3].

        The affine maps of the windows are those of `frames.pixel_to_map` for the frame, minus the shifts.
        """
        at = thickness, length, bend
        three_axes = len(self.detail.spans) == 3
        if three_axes and compiles_for(length) and length.dtype == self.basis.dtype == torch.float32:
            found: tuple[Tensor, Tensor] = _Lookup.apply(*at, self)  # type: ignore[no-untyped-call]
            return found
        return self.plainly(self.places(*at).clamp(0, 1))

    def places(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns the coordinates of strokes in the table: [axes, n], in [0, 1] inside the limits."""
        (shortest, longest), (least, most) = self.limits.length, self.limits.bend
        if self.limits.family is not None:
            codes = (bend / CODE_REACH + 1) / 2  # [n, k]
            return torch.stack((thickness, (length - shortest) / (longest - shortest), *codes.unbind(1)))
        return torch.stack((thickness, (length - shortest) / (longest - shortest), (bend - least) / (most - least)))

    def plainly(self, place: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the windows and shifts at coordinates [axes, n] in [0, 1], by PyTorch on any device."""
        looked = [weights(axis, pieces) for axis, pieces in zip(place, self.detail.spans, strict=True)]
        part = self.part_of[1, looked[1][0]] + self.part_of[2, looked[2][0]]
        first = [self.first_of[axis, span] for axis, (span, _) in enumerate(looked)]
        knots = self.coefficients.shape[1:-1]
        row = rows(first, knots) + part[:, None] * math.prod(knots)
        share = outer(*(weight for _, weight in looked))
        coordinates = nn.functional.embedding_bag(
            row, self.coefficients.flatten(0, -2), per_sample_weights=share, mode="sum"
        )
        logits = torch.baddbmm(self.mean[part][:, None], coordinates[:, None], self.basis[part])[:, 0]
        maps = logits.new_zeros(len(part), math.prod(self.window) + 1)
        maps = maps.scatter(1, self.inside[part], squash(logits))[:, :-1].view(-1, *self.window)
        return maps, nn.functional.pad(self.corners[part].to(maps)[:, :, None], (2, 0))

    def arrays(self) -> Any:
        """Returns the buffers for the compiled loops."""
        from frida_painter.brush.table_kernels import TableArrays

        names = ("coefficients", "basis", "mean", "counts", "part_of", "first_of", "corners", "inside")
        return TableArrays(**{name: self.get_buffer(name).numpy() for name in names}, beyond=np.float32(BEYOND))


_KEPT = ("coefficients", "basis", "mean", "cells", "counts")


class _Lookup(torch.autograd.Function):
    """`StrokeTable.plainly` with compiled loops, which touch only the cells of a stroke's part."""

    @staticmethod
    def forward(
        context: Any, thickness: Tensor, length: Tensor, bend: Tensor, table: StrokeTable
    ) -> tuple[Tensor, Tensor]:
        from frida_painter.brush import table_kernels

        asked = table.places(thickness, length, bend)
        place = asked.clamp(0, 1)
        maps, shift = place.new_empty(place.shape[1], *table.window), place.new_zeros(place.shape[1], 2, 3)
        arrays = table.arrays()
        flat = maps.view(len(maps), math.prod(table.window))
        table_kernels.look_up(place.numpy(), table.detail.spans, arrays, flat.numpy(), shift.numpy())
        context.save_for_backward(place, flat, asked == place)
        context.mark_non_differentiable(shift)
        context.table, context.arrays, context.shape = table, arrays, bend.shape
        return maps, shift

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(context: Any, *upstream: Tensor) -> tuple[Tensor | None, ...]:
        from frida_painter.brush import table_kernels

        place, maps, inside = context.saved_tensors
        table, to_place = context.table, torch.empty_like(place)
        arrays = map(array, (maps, upstream[0].view_as(maps), to_place))
        table_kernels.pull_back(place.numpy(), table.detail.spans, context.arrays, *arrays)
        to_thickness, to_length, to_bend = (to_place * inside).unbind()
        (shortest, longest), (least, most) = table.limits.length, table.limits.bend
        extent = most - least if table.limits.family is None else 2 * CODE_REACH
        return to_thickness, to_length / (longest - shortest), (to_bend / extent).view(context.shape), None


def _edges(detail: TableDetail, axis: int) -> list[tuple[int, int]]:
    """Returns the first span of each part of lengths (0) or bends (1), and the span after its last."""
    spans, parts = detail.spans[axis + 1], min(detail.parts[axis], detail.spans[axis + 1])
    return [(spans * part // parts, spans * (part + 1) // parts) for part in range(parts)]


def _sizes(detail: TableDetail) -> tuple[int, tuple[int, ...], int]:
    """Returns the number of parts, the most knots of one along each axis, and the rank.

    The rank is rounded up to a multiple of four for the loops.
    """
    edges = [_edges(detail, axis) for axis in (0, 1)]
    divided = (max(last - first for first, last in axis) + 3 for axis in edges)
    knots = (detail.spans[0] + 3, *divided, *(spans + 3 for spans in detail.spans[3:]))
    return len(edges[0]) * len(edges[1]), knots, -(-detail.rank // 4) * 4


def _windows(cells: Tensor, counts: Tensor, frame: MapFrame) -> tuple[tuple[int, int], Tensor, Tensor]:
    """Returns size, corners [parts, 2] and cells [parts, most] of the windows that hold these cells of a frame."""
    used = cells < frame.rows * frame.columns
    ends = []  # first and last row or column of each part
    for place, beyond in ((cells // frame.columns, frame.rows), (cells % frame.columns, frame.columns)):
        first, last = place.masked_fill(~used, beyond), place.masked_fill(~used, -1)
        ends.append((first.amin(1).where(counts > 0, 0), last.amax(1).where(counts > 0, 0)))
    rows, columns = (int((last - first).max()) + 1 for first, last in ends)
    top, left = ends[0][0].clamp(max=frame.rows - rows), ends[1][0].clamp(max=frame.columns - columns)
    inside = (cells // frame.columns - top[:, None]) * columns + cells % frame.columns - left[:, None]
    return (rows, columns), torch.stack((left, top), 1), inside.where(used, rows * columns)


def _places_of_spans(detail: TableDetail) -> tuple[Tensor, Tensor]:
    """Returns each span's contribution to the number of the part, and its first knot there, both [axes, most spans]."""
    part_of, first_of = torch.zeros(2, len(detail.spans), max(detail.spans), dtype=torch.long)
    first_of[:] = torch.arange(max(detail.spans))  # axes of bend and length are overwritten
    for axis, step in ((0, len(_edges(detail, 1))), (1, 1)):
        for number, (first, last) in enumerate(_edges(detail, axis)):
            part_of[axis + 1, first:last] = number * step
            first_of[axis + 1, first:last] = torch.arange(last - first)
    return part_of, first_of


def _between(grid: Tensor, spans: int, edges: tuple[int, int]) -> Tensor:
    """Returns the mask of samples [grid] that lie in these spans or next to them."""
    margin = spans / (len(grid) - 1)
    return (grid * spans >= edges[0] - margin) & (grid * spans <= edges[1] + margin)


def sample(model: StrokeModel, detail: TableDetail, like: Tensor) -> Tensor:
    """Returns the model's maps on the table's grid, [grid, rows x columns], in the precision of `like`."""
    grids = [sample_grid(spans).to(like) for spans in detail.spans]
    (shortest, longest), (least, most) = model.limits.length, model.limits.bend
    thickness, length, *shape = (part.flatten() for part in torch.meshgrid(*grids, indexing="ij"))
    length = shortest + length * (longest - shortest)
    if model.limits.family is None:
        bend = least + shape[0] * (most - least)
    else:
        bend = CODE_REACH * (2 * torch.stack(shape, 1) - 1)
    # Strokes with equal paths are sampled together, because some models compute each path only once.
    sides = [len(grid) for grid in grids]
    order = torch.arange(len(length), device=like.device).view(sides).movedim(0, -1).flatten()
    samples = like.new_empty(len(order), model.frame.rows * model.frame.columns)
    with torch.no_grad():
        for part in torch.split(order, _BATCH):
            samples[part] = model(thickness[part], length[part], bend[part]).flatten(1)
    return samples


def _fit(samples: Tensor, grids: list[Tensor], spans: tuple[int, ...]) -> Tensor:
    """Returns the coefficients [knots, knots, ..., cells] of the best splines for samples [grid, cells]."""
    fits = [fit_matrix(grid, pieces) for grid, pieces in zip(grids, spans, strict=True)]
    cube = samples.view(*(len(grid) for grid in grids), -1)
    # One axis of knots for each axis of samples: "ai,bj,ck,ijkr->abcr" for three axes.
    knots, sides = "abcd"[: len(fits)], "ijkl"[: len(fits)]
    return torch.einsum(f"{','.join(map(''.join, zip(knots, sides, strict=True)))},{sides}r->{knots}r", *fits, cube)


def _best_basis(samples: Tensor, rank: int) -> Tensor:
    """Returns orthonormal maps [rank, cells] that span the samples best (randomised subspace iteration, fixed seed)."""
    rank = min(rank, *samples.shape)
    wider = min(rank + 16, *samples.shape)
    probe = torch.randn(wider, len(samples), generator=torch.Generator().manual_seed(0)).to(samples)
    span = probe @ samples
    for _ in range(2):
        span = (samples @ torch.linalg.qr(span.T)[0]).T @ samples
    span = torch.linalg.qr(span.T)[0].T  # [wider, cells]
    return (torch.linalg.svd(samples @ span.T, full_matrices=False)[2] @ span)[:rank].contiguous()


# Tables of stroke models in the system's cache folder
#
# It takes some seconds to tabulate a network and milliseconds to read a table. The name of a file is a hash of all
# facts that determine its table, so a table is never out of date. A damaged file is replaced. A model of this
# project is identified by its weights. Any other model is sampled each time, and only the fit is saved.

# Raise this number if the computation of a table, or of a stroke model from its weights, changes.
VERSION = 3
# Number of tables that are kept, about 1.5 MB each.
_MAX_KEPT = 16
_NAME = re.compile("[0-9a-f]{32}")


def cached_table(model: StrokeModel, detail: TableDetail | None = None, folder: Path | None = None) -> StrokeTable:
    """Returns the table of a model (float32, CPU) from the cache, or makes and saves it.

    folder: folder of tables; by default in the system's cache folder. If it cannot be written, tables are made
    each time.
    """
    detail = detail or TableDetail.of(model)
    folder = folder or platformdirs.user_cache_path("frida-painter", appauthor=False) / "tables"
    samples = None if isinstance(model, nn.Module) and _is_ours(model) else sample(model, detail, torch.zeros(()))
    path = folder / f"{_identity(model, detail, samples)}.safetensors"
    # A table that is missing, damaged or of the wrong shapes is made again.
    with contextlib.suppress(StorageError, KeyError, ValueError):
        return StrokeTable.restore(model, detail, tensor_file.read_tensors(path, "a table of a stroke model")[0])
    if samples is None:
        samples = sample(model, detail, torch.zeros(()))
    table = StrokeTable.from_samples(model, detail, samples)
    with contextlib.suppress(StorageError, OSError):
        tensor_file.write_tensors(path, table.to_tensors())
        tables = [one for one in folder.glob("*.safetensors") if _NAME.fullmatch(one.stem)]
        for old in sorted(tables, key=lambda one: one.stat().st_mtime)[:-_MAX_KEPT]:
            old.unlink(missing_ok=True)
    return table


def _is_ours(model: nn.Module) -> bool:
    """Returns True if the model belongs to this project, so that its weights and `VERSION` determine its result."""
    return type(model).__module__.startswith(("frida_painter.", "frida_painter_calibration."))


def _identity(model: StrokeModel, detail: TableDetail, samples: Tensor | None) -> str:
    """Returns a hash of model and detail, which includes the samples, or else the weights."""
    limits, family = (model.limits.length, model.limits.bend), model.limits.family
    about = (VERSION, type(model).__name__, torch.__version__, model.brush, astuple(model.frame), limits)
    told = hashlib.sha256(repr((*about, astuple(detail))).encode())
    told.update(b"" if family is None else family.digest.encode())
    weights = model.state_dict() if samples is None and isinstance(model, nn.Module) else {"samples": samples}
    for name, tensor in sorted(weights.items()):
        told.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        told.update(tensor.detach().cpu().contiguous().numpy().tobytes())
    return told.hexdigest()[:32]
