"""A stroke model turned into a table, so that no network is evaluated while a plan is optimised.

The model is sampled once on a grid of (thickness, length, bend). The samples are fitted by a
tensor product of cubic B-splines (smooth, so that its slopes are the model's slopes too), whose
coefficients are written in a low-rank basis of maps. A stroke then costs 4 x 4 x 4 rows of
coefficients and its share of one matrix product over the cells that any stroke ever touches.
docs/stroke-model.md states the error against the trained networks.
"""

from dataclasses import dataclass
from typing import Any, Self

import torch
from torch import Tensor, nn

from frida_painter.brush import spline
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.frames import MapFrame
from frida_painter.strokes import StrokeLimits


@dataclass(frozen=True)
class TableDetail:
    """How finely a model is tabulated.

    spans: pieces of the spline along thickness, length and bend; rank: maps in the basis; floor:
    magnitudes below it are paint that no eye can see: they fade to nothing, so that hundreds of
    strokes do not add up to a haze.
    """

    spans: tuple[int, int, int] = (4, 12, 14)
    rank: int = 256
    floor: float = 0.01


class StrokeTable(nn.Module):
    """The fast stand-in for a stroke model: the same brush, frame and limits.

    Parameters outside the limits count as the nearest ones inside. Differentiable once, in
    thickness, length and bend; its buffers follow `.to()` to another precision or device.
    """

    coefficients: Tensor  # [knots of thickness x length x bend, rank]
    basis: Tensor  # [rank, cells that some stroke touches]
    cells: Tensor  # [cells that some stroke touches], index into rows x columns

    def __init__(
        self, model: StrokeModel, detail: TableDetail, coefficients: Tensor, basis: Tensor, cells: Tensor
    ) -> None:
        super().__init__()
        self.brush: str = model.brush
        self.frame: MapFrame = model.frame
        self.limits: StrokeLimits = model.limits
        self.detail = detail
        self.register_buffer("coefficients", coefficients)
        self.register_buffer("basis", basis)
        self.register_buffer("cells", cells)

    @classmethod
    def of(cls, model: StrokeModel, like: Tensor | None = None, detail: TableDetail | None = None) -> Self:
        """Tabulates a model as it is now, in a second or two; make the table anew when the model changes.

        like: a tensor of the precision and on the device of the model (default: float32, CPU).
        """
        detail = detail or TableDetail()
        knots = _fit(model, detail, torch.zeros(()) if like is None else like)
        cells = (knots.abs().amax(0) > detail.floor).nonzero()[:, 0]
        coefficients, basis = _low_rank(knots[:, cells], detail.rank)
        return cls(model, detail, coefficients, basis, cells)

    def forward(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """thickness [n] in [0, 1], length [n] and bend [n] in metres -> magnitude [n, rows, columns] in [0, 1]."""
        (shortest, longest), (least, most) = self.limits.length, self.limits.bend
        place = torch.stack((thickness, (length - shortest) / (longest - shortest), (bend - least) / (most - least)))
        flat = _Lookup.apply(place.clamp(0, 1), self.coefficients, self.basis, self.cells, self.detail, self._area)
        return flat.view(-1, self.frame.rows, self.frame.columns)

    @property
    def _area(self) -> int:
        return self.frame.rows * self.frame.columns


class _Lookup(torch.autograd.Function):
    """Table lookup with a backward pass that keeps nothing larger than the maps themselves."""

    @staticmethod
    def forward(
        context: Any, place: Tensor, coefficients: Tensor, basis: Tensor, cells: Tensor, detail: TableDetail, area: int
    ) -> Tensor:
        row, weight, slope = spline.local(place, detail.spans)  # [n, 64], 3 x [n, 4], 3 x [n, 4]
        share = torch.nn.functional.embedding_bag(
            row, coefficients, per_sample_weights=spline.outer(*weight), mode="sum"
        )
        value = share @ basis  # [n, touched]
        context.save_for_backward(row, *weight, *slope, value, coefficients, basis, cells)
        context.floor = detail.floor
        flat = value.new_zeros(len(value), area)
        flat[:, cells] = _fade(value, detail.floor)
        return flat

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(context: Any, *upstream: Tensor) -> tuple[Tensor | None, ...]:
        row, w0, w1, w2, s0, s1, s2, value, coefficients, basis, cells = context.saved_tensors
        upon_value = upstream[0][:, cells] * _fade_slope(value, context.floor)
        upon_share = upon_value @ basis.T  # [n, rank]
        upon_weight = torch.bmm(coefficients[row], upon_share[:, :, None])[..., 0]  # [n, 64]
        upon_place = [(upon_weight * spline.outer(*part)).sum(1) for part in ((s0, w1, w2), (w0, s1, w2), (w0, w1, s2))]
        return torch.stack(upon_place), None, None, None, None, None


def _fade(value: Tensor, floor: float) -> Tensor:
    """The identity on [floor, 1], clamped to 1 above, fading to exactly zero below the floor (cubically)."""
    share = (value / floor).clamp(0, 1)
    return value.clamp(max=1) * (share * share * (3 - 2 * share))


def _fade_slope(value: Tensor, floor: float) -> Tensor:
    share = (value / floor).clamp(0, 1)
    return torch.where(value < 1, share * share * (9 - 8 * share), 0)


def _fit(model: StrokeModel, detail: TableDetail, like: Tensor) -> Tensor:
    """Spline coefficients of every cell that fit the model best, [knots, rows x columns]."""
    grids = [spline.sample_grid(spans).to(like) for spans in detail.spans]
    fits = [spline.fit_matrix(grid, spans) for grid, spans in zip(grids, detail.spans, strict=True)]
    (shortest, longest), (least, most) = model.limits.length, model.limits.bend
    length = (shortest + grids[1] * (longest - shortest)).repeat_interleave(len(grids[2]))
    bend = (least + grids[2] * (most - least)).repeat(len(grids[1]))
    knots: Tensor | None = None
    with torch.no_grad():
        for thickness, onto_knots in zip(grids[0], fits[0].T, strict=True):
            maps = model(thickness.expand(len(length)), length, bend)
            maps = maps.reshape(len(grids[1]), len(grids[2]), -1)
            fitted = torch.tensordot(fits[1], maps, dims=1)  # [knots of length, grid of bend, cells]
            fitted = torch.matmul(fits[2], fitted)  # [knots of length, knots of bend, cells]
            grown = onto_knots[:, None, None, None] * fitted
            knots = grown if knots is None else knots.add_(grown)
    assert knots is not None
    return knots.reshape(-1, model.frame.rows * model.frame.columns)


def _low_rank(matrix: Tensor, rank: int) -> tuple[Tensor, Tensor]:
    """Two factors [n, rank] and [rank, m] whose product is nearest to the matrix (randomised, from a fixed seed)."""
    rank = min(rank, *matrix.shape)
    chance = torch.Generator().manual_seed(0)
    probe = torch.randn(matrix.shape[1], min(rank + 16, *matrix.shape), generator=chance).to(matrix)
    span = torch.linalg.qr(matrix @ probe)[0]
    for _ in range(3):
        span = torch.linalg.qr(matrix @ (matrix.T @ span))[0]
    left, strength, basis = torch.linalg.svd(span.T @ matrix, full_matrices=False)
    return (span @ left[:, :rank] * strength[:rank]).contiguous(), basis[:rank].contiguous()
