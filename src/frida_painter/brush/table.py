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

_BATCH = 256


@dataclass(frozen=True)
class TableDetail:
    """How finely a model is tabulated.

    spans: pieces of the spline along thickness, length and bend; rank: maps in the basis; floor:
    magnitudes below it are paint that no eye can see: they fade to nothing, so that hundreds of
    strokes do not add up to a haze.
    """

    spans: tuple[int, int, int] = (4, 10, 10)
    rank: int = 96
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
        samples, grids = _sample(model, detail, torch.zeros(()) if like is None else like)
        cells = (samples.amax(0) > detail.floor / 2).nonzero()[:, 0]
        touched = samples[:, cells]
        basis = _best_basis(touched, detail.rank)
        return cls(model, detail, _fit(touched @ basis.T, grids, detail.spans), basis, cells)

    def forward(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """thickness [n] in [0, 1], length [n] and bend [n] in metres -> magnitude [n, rows, columns] in [0, 1]."""
        (shortest, longest), (least, most) = self.limits.length, self.limits.bend
        place = torch.stack((thickness, (length - shortest) / (longest - shortest), (bend - least) / (most - least)))
        flat: Tensor = _Lookup.apply(  # type: ignore[no-untyped-call]
            place.clamp(0, 1), self.coefficients, self.basis, self.cells, self.detail, self._area
        )
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


def _sample(model: StrokeModel, detail: TableDetail, like: Tensor) -> tuple[Tensor, list[Tensor]]:
    """The model's maps on a grid of all three parameters, [grid, rows x columns], and the places along each axis."""
    grids = [spline.sample_grid(spans).to(like) for spans in detail.spans]
    (shortest, longest), (least, most) = model.limits.length, model.limits.bend
    thickness, length, bend = (part.flatten() for part in torch.meshgrid(*grids, indexing="ij"))
    length, bend = shortest + length * (longest - shortest), least + bend * (most - least)
    parts = zip(*(torch.split(part, _BATCH) for part in (thickness, length, bend)), strict=True)
    with torch.no_grad():
        return torch.cat([model(*part).flatten(1) for part in parts]), grids


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
