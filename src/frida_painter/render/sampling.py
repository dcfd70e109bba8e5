"""Sampling magnitude maps over boxes of pixels in plain PyTorch, many strokes at a time."""

import math
from collections.abc import Iterator, Sequence

import torch
from torch import Tensor
from torch.nn.functional import grid_sample, pad

Box = tuple[int, int, int, int]  # pixel rows [top, bottom), columns [left, right)
BATCH_PIXELS = 2**17


def whole_maps(magnitude: Tensor) -> Tensor:
    """The box of all cells of each map, [n, 4] (top, bottom, left, right)."""
    n, h, w = magnitude.shape
    none = magnitude.new_zeros((), dtype=torch.float64)  # filled where the maps are, not sent there
    return torch.stack((none, none + h, none, none + w)).expand(n, 4)


def painted_boxes(magnitude: Tensor) -> Tensor:
    """The smallest box that holds all cells of each map which are not zero, [n, 4]; NaN where there are none."""
    painted = magnitude != 0
    edges: list[Tensor] = []
    for side in (painted.any(2), painted.any(1)):  # [n, h], [n, w]
        edges += [side.int().argmax(1), side.shape[1] - side.flip(1).int().argmax(1)]
    boxes = torch.stack(edges, 1).double()
    return torch.where(painted.flatten(1).any(1)[:, None], boxes, torch.nan)


def pixel_boxes(affine: Tensor, cells: Tensor, canvas: Tensor) -> list[Box]:
    """`pixel_extents` as numbers of the host, which waits for the device."""
    return [(box[0], box[1], box[2], box[3]) for box in pixel_extents(affine, cells, canvas).tolist()]


def pixel_extents(affine: Tensor, cells: Tensor, canvas: Tensor) -> Tensor:
    """For each stroke the pixels whose samples can touch its box of cells [n, 4], [n, 4]; (0, 0, 0, 0) if none can."""
    _, height, width = canvas.shape
    place = affine.detach().double()
    a, b, c, d, e, f = place.flatten(1).unbind(1)
    determinant = a * e - b * d
    # Rounding in the map's coordinates moves the border by this many cells at most.
    slack = 8 * torch.finfo(affine.dtype).eps * place.abs().sum((1, 2)) * max(height, width)
    top, bottom, left, right = cells.unbind(1)
    above, below = top - 1 - slack - f, bottom + slack - f
    before, past = left - 1 - slack - c, right + slack - c

    def extent(by_column: Tensor, by_row: Tensor, pixels: int) -> tuple[Tensor, Tensor]:
        across = torch.stack((by_column * before, by_column * past))
        down = torch.stack((by_row * above, by_row * below))
        least, most = across.amin(0) + down.amin(0), across.amax(0) + down.amax(0)
        # A map that is squeezed flat has no inverse: then nothing is known, and all is looked at.
        first = torch.where(least.isfinite(), least.floor(), 0).clamp(0, pixels)
        return first, torch.where(most.isfinite(), most.ceil() + 1, pixels).clamp(0, pixels)

    first_column, past_column = extent(e / determinant, -b / determinant, width)
    first_row, past_row = extent(-d / determinant, a / determinant, height)
    visible = (first_row < past_row) & (first_column < past_column) & slack.isfinite() & ~cells.isnan().any(1)
    boxes = torch.stack((first_row, past_row, first_column, past_column), 1)
    return torch.where(visible[:, None], boxes, 0).long()


class Batch:
    """A few strokes whose boxes are sampled together, each as large as the largest of them.

    grid_sample counts in [-1, 1]. On a map padded to 2^k + 1 cells the way there and back is a shift
    of the exponent, so that samples on whole cells, where the gradient jumps, stay on them.
    """

    def __init__(self, strokes: Sequence[int], boxes: Sequence[Box], magnitude: Tensor, affine: Tensor) -> None:
        self.strokes = list(strokes)
        self.boxes = [boxes[i] for i in strokes]
        self.rows = max(bottom - top for top, bottom, _, _ in self.boxes)
        self.columns = max(right - left for _, _, left, right in self.boxes)
        self.magnitude = magnitude
        h, w = magnitude.shape[1:]
        self.sides = [2 ** max(1, math.ceil(math.log2(max(cells - 1, 1)))) for cells in (w, h)]
        self.half = affine.new_tensor(self.sides)[:, None] / 2  # [2, 1]
        self.place = affine[self.strokes] / self.half  # [k, 2, 3]
        corner = affine.new_tensor([(left, top) for top, _, left, _ in self.boxes])  # [k, 2]
        count = torch.arange(max(self.rows, self.columns), dtype=affine.dtype, device=affine.device)
        self.column = corner[:, 0:1] + count[: self.columns]  # [k, columns]
        self.row = corner[:, 1:2] + count[: self.rows]  # [k, rows]

    def maps(self) -> Tensor:
        """The strokes' maps, padded, [k, 1, 2^a + 1, 2^b + 1]."""
        h, w = self.magnitude.shape[1:]
        return pad(self.magnitude[self.strokes], (0, self.sides[0] + 1 - w, 0, self.sides[1] + 1 - h))[:, None]

    def grid(self) -> Tensor:
        """Where on the maps each pixel of the boxes lies, [k, rows, columns, 2]."""
        across = self.place[:, :, 0:1] * self.column[:, None]  # [k, 2, columns]
        down = self.place[:, :, 1:2] * self.row[:, None]  # [k, 2, rows]
        grid = across[:, :, None, :] + down[:, :, :, None]  # [k, 2, rows, columns]
        return grid.add_(self.place[:, :, 2, None, None]).sub_(1).permute(0, 2, 3, 1)

    def alpha(self) -> Tensor:
        """Coverage over the boxes, [k, rows, columns]."""
        return grid_sample(self.maps(), self.grid(), padding_mode="zeros", align_corners=True)[:, 0]

    def pull(self, slope: Tensor) -> tuple[Tensor, Tensor]:
        """Gradients to maps [k, h, w] and affine maps [k, 2, 3], from that to the coverage [k, rows, columns]."""
        to_map, to_grid = torch.ops.aten.grid_sampler_2d_backward(
            slope[:, None], self.maps(), self.grid(), 0, 0, True, [True, True]
        )
        by_column, by_row = to_grid.sum(1), to_grid.sum(2)  # [k, columns, 2], [k, rows, 2]
        by_x = (by_column * self.column[..., None]).sum(1)
        by_y = (by_row * self.row[..., None]).sum(1)
        h, w = self.magnitude.shape[1:]
        return to_map[:, 0, :h, :w], torch.stack((by_x, by_y, by_row.sum(1)), -1) / self.half

    def views(self, boxed: Tensor) -> Iterator[tuple[int, Tensor]]:
        """Each stroke with its own part of a tensor [k, rows, columns]."""
        for i, (top, bottom, left, right), one in zip(self.strokes, self.boxes, boxed.unbind(), strict=True):
            yield i, one[: bottom - top, : right - left]


def batches(boxes: list[Box], magnitude: Tensor, affine: Tensor, *, by_shape: bool = False) -> Iterator[Batch]:
    """All strokes with a box, as many at a time as sampling can hold in the cache.

    In order; or by_shape, strokes with boxes alike together, which wastes less.
    """
    visible = [i for i, (top, bottom, _, _) in enumerate(boxes) if top < bottom]
    if by_shape:
        visible.sort(key=lambda i: (boxes[i][1] - boxes[i][0]) / (boxes[i][3] - boxes[i][2]))
    picked: list[int] = []
    rows = columns = 0
    for i in visible:
        top, bottom, left, right = boxes[i]
        taller, wider = max(rows, bottom - top), max(columns, right - left)
        if picked and (len(picked) + 1) * taller * wider > BATCH_PIXELS:
            yield Batch(picked, boxes, magnitude, affine)
            picked, taller, wider = [], bottom - top, right - left
        picked.append(i)
        rows, columns = taller, wider
    if picked:
        yield Batch(picked, boxes, magnitude, affine)
