"""Strokes as painting programs of the screen have them: of any size and opacity, and with no brush behind them.

A stroke is a quadratic Bezier whose radius and opacity run from one end to the other, the ten
numbers and the colour that Huang et al. paint with ("Learning to Paint With Model-Based Deep
Reinforcement Learning", ICCV 2019, section 3.3). The comparators of the sim2real experiment.
"""

from dataclasses import dataclass, fields, replace
from typing import Self

import torch
from torch import Tensor

from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.render import composite

_PIECES = 10
_CELLS = 40
_EDGE = 0.15  # share of the radius over which a stroke fades out
_LEAST_EDGE = 0.0012  # metres: about a pixel of the picture in which is planned


@dataclass(frozen=True)
class SoftStrokes:
    """n strokes in painting order.

    points [n, 3, 2]: start, control point and end, canvas metres; radius [n, 2] in metres and
    opacity [n, 2] in [0, 1]: at the start and at the end; color [n, 3] sRGB.
    """

    points: Tensor
    radius: Tensor
    opacity: Tensor
    color: Tensor

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, index: Tensor | slice) -> Self:
        return replace(self, **{name: tensor[index] for name, tensor in self.arrays().items()})

    def arrays(self) -> dict[str, Tensor]:
        """The groups by name."""
        return {part.name: getattr(self, part.name) for part in fields(self)}

    @classmethod
    def join(cls, first: Self, second: Self) -> Self:
        """All strokes of the first, then those of the second."""
        pairs = ((first.arrays()[name], second.arrays()[name]) for name in first.arrays())
        return cls(*(torch.cat(pair) for pair in pairs))

    def length(self) -> Tensor:
        """From start to end, straight, [n] metres."""
        return (self.points[:, 2] - self.points[:, 0]).norm(dim=1)


@dataclass(frozen=True)
class Freedom:
    """What strokes may be: (least, most) length, radius, bow and opacity; metres, and opacity in [0, 1].

    bow: how far the control point lies off the straight line; tapered: whether the two ends may
    have different radii and opacities.
    """

    length: tuple[float, float]
    radius: tuple[float, float]
    bow: tuple[float, float]
    opacity: tuple[float, float]
    tapered: bool

    def project(self, strokes: SoftStrokes, size: CanvasSize) -> SoftStrokes:
        """The nearest strokes that may be, their middles on the canvas."""
        start, control, end = strokes.points.unbind(1)
        middle, chord = (start + end) / 2, end - start
        along = chord / chord.norm(dim=1, keepdim=True).clamp(min=1e-6)  # [n, 2]
        across = torch.stack((-along[:, 1], along[:, 0]), 1)
        half = along * (chord.norm(dim=1).clamp(*self.length) / 2)[:, None]
        bow = ((control - middle) * across).sum(1).clamp(*self.bow)
        shift = ((control - middle) * along).sum(1)
        shift = torch.minimum(torch.maximum(shift, -half.norm(dim=1)), half.norm(dim=1))
        middle = middle.clamp(min=0).minimum(middle.new_tensor([size.width, size.height]))
        control = middle + along * shift[:, None] + across * bow[:, None]
        radius, opacity = strokes.radius, strokes.opacity
        if not self.tapered:
            radius, opacity = (part.mean(1, keepdim=True).expand(-1, 2) for part in (radius, opacity))
        return SoftStrokes(
            torch.stack((middle - half, control, middle + half), 1),
            radius.clamp(*self.radius),
            opacity.clamp(*self.opacity),
            strokes.color.clamp(0, 1),
        )


def render(strokes: SoftStrokes, canvas: Tensor, size: CanvasSize) -> Tensor:
    """The picture [3, H, W] of the strokes over `canvas` [3, H, W]; differentiable in all that a stroke has.

    Every stroke is drawn on cells of a rectangle around it. The rectangle itself is not varied:
    whatever moves, moves inside of it.
    """
    maps, affine = marks(strokes, canvas, size)
    return composite(maps, affine, strokes.color, canvas)


def marks(strokes: SoftStrokes, canvas: Tensor, size: CanvasSize) -> tuple[Tensor, Tensor]:
    """The strokes' magnitude maps [n, cells, cells] and their places [n, 2, 3], as `render.composite` takes them."""
    with torch.no_grad():
        around = strokes.radius.amax(1)[:, None] * (1 + _EDGE) + 2 * _LEAST_EDGE
        least, most = strokes.points.amin(1) - around, strokes.points.amax(1) + around  # [n, 2]
        pitch = (most - least) / _CELLS
        grid = PixelGrid(size, *canvas.shape[1:])
        across, down = grid.pitch
        # Pixel (column, row) lies at x = (column + 1/2) across, y = height - (row + 1/2) down.
        affine = torch.zeros(len(strokes), 2, 3).to(canvas)
        affine[:, 0, 0] = across / pitch[:, 0]
        affine[:, 0, 2] = (across / 2 - least[:, 0]) / pitch[:, 0] - 0.5
        affine[:, 1, 1] = down / pitch[:, 1]
        affine[:, 1, 2] = (most[:, 1] - size.height + down / 2) / pitch[:, 1] - 0.5
        step = torch.arange(_CELLS).to(canvas) + 0.5
        x = least[:, 0, None, None] + step * pitch[:, 0, None, None]  # [n, 1, cells]
        y = most[:, 1, None, None] - step[:, None] * pitch[:, 1, None, None]  # [n, cells, 1]
    return _magnitude(strokes, x, y), affine


def _magnitude(strokes: SoftStrokes, x: Tensor, y: Tensor) -> Tensor:
    """Opacity at cells: fades out beyond the radius, both as they are at the nearest point of the curve."""
    fraction = torch.linspace(0, 1, _PIECES + 1).to(x)
    weight = torch.stack(((1 - fraction) ** 2, 2 * fraction * (1 - fraction), fraction**2))  # [3, pieces + 1]
    path = torch.einsum("nkd,kt->ntd", strokes.points, weight)  # [n, pieces + 1, 2]
    deepest: Tensor | None = None
    for piece in range(_PIECES):
        start, run = path[:, piece, :, None, None], (path[:, piece + 1] - path[:, piece])[:, :, None, None]
        from_x, from_y = x - start[:, 0], y - start[:, 1]
        share = ((from_x * run[:, 0] + from_y * run[:, 1]) / (run.square().sum(1) + 1e-12)).clamp(0, 1)
        place = (piece + share) / _PIECES
        off_x, off_y = from_x - share * run[:, 0], from_y - share * run[:, 1]
        off = torch.sqrt(off_x * off_x + off_y * off_y + 1e-12)
        radius, opacity = (_between(part, place) for part in (strokes.radius, strokes.opacity))
        inside = ((radius - off) / (_EDGE * radius + _LEAST_EDGE) + 0.5).clamp(0, 1)
        mark = opacity * inside * inside * (3 - 2 * inside)
        deepest = mark if deepest is None else torch.maximum(deepest, mark)
    assert deepest is not None
    return deepest


def _between(ends: Tensor, share: Tensor) -> Tensor:
    """Values [n, 2] at the ends, at shares [n, cells, cells] of the way."""
    first, last = ends[:, 0, None, None], ends[:, 1, None, None]
    return first + (last - first) * share
