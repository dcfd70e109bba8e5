"""Soft strokes, as in digital painting: of any size and opacity, without a brush; planners that earlier work compares.

A stroke is a quadratic Bezier curve whose radius and opacity change from one end to the other: the ten numbers and
the colour of Huang et al. ("Learning to Paint With Model-Based Deep Reinforcement Learning", ICCV 2019, section 3.3).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from frida_painter.brush.kinds import StrokeModel
from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.planning.initialize import round_sizes
from frida_painter.render import composite
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import Strokes
from frida_painter.system import images

_PIECES = 10
_CELLS = 40
_EDGE = 0.15  # share of the radius over which a stroke fades out
_MIN_EDGE = 0.0012  # metres: about a pixel of the planning image


@dataclass(frozen=True)
class SoftStrokes:
    """Soft strokes in painting order.

    points: [n, 3, 2], start, control point and end, canvas metres
    radius: [n, 2], metres at the start and at the end
    opacity: [n, 2] in [0, 1], likewise
    color: [n, 3], sRGB
    """

    points: Tensor
    radius: Tensor
    opacity: Tensor
    color: Tensor

    def __len__(self) -> int:
        return len(self.points)

    def arrays(self) -> dict[str, Tensor]:
        """Returns the groups by name."""
        return {part.name: getattr(self, part.name) for part in fields(self)}

    @classmethod
    def join(cls, first: Self, second: Self) -> Self:
        """Returns the strokes of the first, then those of the second."""
        pairs = ((first.arrays()[name], second.arrays()[name]) for name in first.arrays())
        return cls(*(torch.cat(pair) for pair in pairs))

    def length(self) -> Tensor:
        """Returns the straight distances from start to end, [n] metres."""
        return (self.points[:, 2] - self.points[:, 0]).norm(dim=1)


@dataclass(frozen=True)
class Freedom:
    """Limits of soft strokes: (least, most) length, radius and bow in metres, opacity in [0, 1].

    bow: distance of the control point from the straight line
    tapered: True if the two ends may have different radii and opacities
    """

    length: tuple[float, float]
    radius: tuple[float, float]
    bow: tuple[float, float]
    opacity: tuple[float, float]
    tapered: bool

    def project(self, strokes: SoftStrokes, size: CanvasSize) -> SoftStrokes:
        """Returns the nearest strokes within the limits, with their middles on the canvas."""
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
    """Returns the picture [3, H, W] of the strokes over `canvas` [3, H, W]; differentiable in all parameters.

    Every stroke is drawn on the cells of a rectangle around it. The rectangle itself is constant in the gradient.
    """
    maps, affine = marks(strokes, canvas, size)
    return composite(maps, affine, strokes.color, canvas)


def marks(strokes: SoftStrokes, canvas: Tensor, size: CanvasSize) -> tuple[Tensor, Tensor]:
    """Returns magnitude maps [n, cells, cells] and affine maps [n, 2, 3] of the strokes, for `render.composite`."""
    with torch.no_grad():
        around = strokes.radius.amax(1)[:, None] * (1 + _EDGE) + 2 * _MIN_EDGE
        least, most = strokes.points.amin(1) - around, strokes.points.amax(1) + around  # [n, 2]
        pitch = (most - least) / _CELLS
        grid = PixelGrid(size, *canvas.shape[1:])
        across, down = grid.pitch
        # Pixel (column, row) is at x = (column + 1/2) across, y = height - (row + 1/2) down.
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
    """Returns the opacity of cells: that of the nearest point of the curve, fading out beyond its radius."""
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
        inside = ((radius - off) / (_EDGE * radius + _MIN_EDGE) + 0.5).clamp(0, 1)
        mark = opacity * inside * inside * (3 - 2 * inside)
        deepest = mark if deepest is None else torch.maximum(deepest, mark)
    assert deepest is not None
    return deepest


def _between(ends: Tensor, share: Tensor) -> Tensor:
    """Returns values between the ends [n, 2], at shares [n, cells, cells] of the way."""
    first, last = ends[:, 0, None, None], ends[:, 1, None, None]
    return first + (last - first) * share


# Planning with soft strokes by gradient descent: large ones first, each at a place of large error.

# First steps in metres (points, radii), shares (opacity) and sRGB.
_UNITS = {"points": 0.002, "radius": 0.001, "opacity": 0.04, "color": 0.03}
_FIRST_OPACITY = 0.8
_ROUNDS = 6  # placements of strokes
_SETTLING, _POLISHING = 30, 120  # steps after each placement, and in each of the two final phases


@dataclass(frozen=True, kw_only=True)
class SoftPlanner:
    """Planner of soft strokes on a white canvas, by the mean squared difference.

    target: [3, H, W]
    colors: number of paints; None for a separate colour of each stroke
    effort: factor of the usual number of steps
    notify: hears the share of the work that is done
    """

    target: Tensor
    size: CanvasSize
    freedom: Freedom
    colors: int | None
    effort: float
    seed: int
    notify: Callable[[float], None] = lambda share: None

    def plan(self, count: int) -> tuple[SoftStrokes, Tensor]:
        """Returns `count` strokes, and their simulated picture [3, H, W]."""
        generator = torch.Generator().manual_seed(self.seed)
        settling, polishing = (math.ceil(self.effort * steps) for steps in (_SETTLING, _POLISHING))
        ends = np.cumsum([*[settling] * _ROUNDS, polishing, polishing]) / (_ROUNDS * settling + 2 * polishing)
        done = np.r_[0, ends].tolist()
        strokes = SoftStrokes(torch.zeros(0, 3, 2), torch.zeros(0, 2), torch.zeros(0, 2), torch.zeros(0, 3))
        for number, quota in enumerate(round_sizes(count, _ROUNDS)):
            new = self._place(strokes, quota, number / (_ROUNDS - 1), generator)
            strokes = self._settle(SoftStrokes.join(strokes, new), settling, done[number : number + 2])
        strokes = self._settle(strokes, polishing, done[_ROUNDS : _ROUNDS + 2])
        if self.colors is not None:
            palette = Palette.cluster(strokes.color, strokes.length() * strokes.radius.mean(1), self.colors, self.seed)
            strokes = replace(strokes, color=palette.color[palette.nearest(strokes.color)])
        strokes = self._settle(strokes, polishing, done[_ROUNDS + 1 :], vary_color=self.colors is None)
        with torch.no_grad():
            return strokes, render(strokes, torch.ones_like(self.target), self.size)

    @torch.no_grad()
    def _place(self, strokes: SoftStrokes, count: int, smallness: float, generator: torch.Generator) -> SoftStrokes:
        """Returns new strokes at places of large error, from the largest (smallness 0) to small ones (1)."""
        target, size, bare = self.target, self.size, torch.ones_like(self.target)
        picture = render(strokes, bare, size) if len(strokes) else bare
        least, most = self.freedom.radius
        radius = most * max(least / most, 0.12) ** smallness
        grid = PixelGrid(size, *target.shape[1:])
        width = 2 * round(radius / grid.pitch[1] / 2) + 1
        error = (target - picture).square().sum(0)
        error = functional.avg_pool2d(error[None, None], width, 1, width // 2, count_include_pad=False)[0, 0]
        chosen = torch.multinomial(error.flatten() + 1e-12, count, replacement=True, generator=generator)
        pixel = torch.stack((chosen % error.shape[1], chosen // error.shape[1]), 1)
        middle = grid.to_canvas(pixel.float())
        angle = torch.rand(count, generator=generator) * torch.pi
        length = (2 * radius * (0.5 + 1.5 * torch.rand(count, generator=generator))).clamp(*self.freedom.length)
        half = torch.stack((torch.cos(angle), torch.sin(angle)), 1) * length[:, None] / 2
        smooth = images.fit(target, max(1, target.shape[1] // width), max(1, target.shape[2] // width))
        place = torch.stack((2 * middle[:, 0] / size.width - 1, 1 - 2 * middle[:, 1] / size.height), 1)
        color = functional.grid_sample(smooth[None], place[None, None], align_corners=False, padding_mode="border")
        new = SoftStrokes(
            torch.stack((middle - half, middle, middle + half), 1),
            torch.full((count, 2), radius),
            torch.full((count, 2), _FIRST_OPACITY),
            color[0, :, 0].T,
        )
        return self.freedom.project(new, size)

    def _settle(
        self, strokes: SoftStrokes, steps: int, done: Sequence[float], *, vary_color: bool = True
    ) -> SoftStrokes:
        """Optimises all strokes together by Adam; returns the best ones found.

        done: shares of the work before and after
        """
        bare = torch.ones_like(self.target)
        varied = [name for name in _UNITS if vary_color or name != "color"]
        leaves = {name: (strokes.arrays()[name] / _UNITS[name]).clone().requires_grad_() for name in varied}
        adam = torch.optim.Adam(leaves.values(), lr=1.0, betas=(0.9, 0.98), foreach=True)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, steps, eta_min=0.1)
        best, least = strokes, float("inf")
        for number in range(1, steps + 1):
            current = replace(strokes, **{name: leaf * _UNITS[name] for name, leaf in leaves.items()})
            loss = (render(current, bare, self.size) - self.target).square().mean()
            if loss.item() < least:
                least = loss.item()
                best = SoftStrokes(**{name: part.detach().clone() for name, part in current.arrays().items()})
            adam.zero_grad()
            torch.autograd.backward(loss)
            adam.step()
            schedule.step()
            with torch.no_grad():
                moved = replace(strokes, **{name: leaf * _UNITS[name] for name, leaf in leaves.items()})
                for name, part in self.freedom.project(moved, self.size).arrays().items():
                    if name in leaves:
                        leaves[name].copy_(part / _UNITS[name])
            self.notify(done[0] + (done[1] - done[0]) * number / steps)
        return best


# From soft strokes to the nearest strokes of a robot with its brush.

_THICKNESSES = 33
# The middle of a quadratic Bezier is half of its bow aside, that of a brush stroke three quarters of its bend.
_BOW_OF_BEND = 1.5
# Beyond the curve's end, a round end is half as wide as the stroke at this share of its radius.
_ROUND_END = 3**0.5 / 2


@dataclass(frozen=True)
class MarkSizes:
    """Sizes of a brush's marks by thickness, from a stroke model; all [k], metres.

    thickness: from 0 to 1
    width: in the middle of a long straight stroke
    before, behind: extent of the mark beyond the start and the end of the path, to half its width
    """

    thickness: NDArray[np.float64]
    width: NDArray[np.float64]
    before: NDArray[np.float64]
    behind: NDArray[np.float64]

    @classmethod
    @torch.no_grad()
    def of(cls, model: StrokeModel) -> Self:
        """Returns the sizes, measured on the model's own marks."""
        thickness = torch.linspace(0, 1, _THICKNESSES)
        longest = model.limits.length[1]
        marks = model(thickness, torch.full_like(thickness, longest), torch.zeros_like(thickness))
        across, down = model.frame.pitch
        profile = marks.sum(1).double().numpy() * down  # [k, columns], width along the stroke
        middle = round((longest / 2 - model.frame.left) / across)
        width = profile[:, middle - 1 : middle + 2].mean(1)
        wide = profile >= width[:, None] / 2
        first, last = wide.argmax(1), wide.shape[1] - 1 - wide[:, ::-1].argmax(1)
        return cls(
            thickness.double().numpy(),
            np.maximum.accumulate(width),
            -(model.frame.left + first * across),
            model.frame.left + (last + 1) * across - longest,
        )


def allow_any_stroke(size: CanvasSize) -> Freedom:
    """Returns the limits of strokes from a hair to half the canvas, of any opacity."""
    return Freedom(
        length=(0.001, size.width + size.height),
        radius=(0.0008, 0.25 * min(size.width, size.height)),
        bow=(-size.width, size.width),
        opacity=(0.0, 1.0),
        tapered=True,
    )


def constrain_to_brush(model: StrokeModel, size: CanvasSize) -> Freedom:
    """Returns the limits of opaque strokes of even width, within the lengths, widths and bends of the brush."""
    limits = model.limits.within(size)
    width = MarkSizes.of(model).width
    return Freedom(
        length=limits.length,
        radius=(float(width[0]) / 2, float(width[-1]) / 2),
        bow=(_BOW_OF_BEND * limits.bend[0], _BOW_OF_BEND * limits.bend[1]),
        opacity=(1.0, 1.0),
        tapered=False,
    )


@torch.no_grad()
def seen_colors(strokes: SoftStrokes, canvas: Tensor, size: CanvasSize) -> Tensor:
    """Returns the colour [n, 3] at each stroke's place when the stroke has been laid on those before it.

    The opacity of the stroke is included.
    """
    maps, affine = marks(strokes, canvas, size)
    found, picture = [], canvas
    ones = torch.ones(1, 3).to(canvas)
    for index in range(len(strokes)):
        one = slice(index, index + 1)
        picture = composite(maps[one], affine[one], strokes.color[one], picture)
        share = composite(maps[one], affine[one], ones, torch.zeros_like(canvas))  # [3, H, W], of this stroke alone
        found.append((picture * share).sum((1, 2)) / share.sum((1, 2)).clamp(min=1e-6))
    return torch.stack(found)


def as_plan(soft: SoftStrokes, model: StrokeModel, size: CanvasSize, colors: int, canvas: Tensor, seed: int) -> Plan:
    """Returns the robot's nearest plan to soft strokes: the same number and order of strokes, in `colors` paints.

    The radius becomes the thickness whose mark has the same width. Length and position are chosen so that the mark
    with its ends covers the area of the stroke with its round ends. Lengths and bends are limited to those of the
    brush, around the middle.
    Opacity is mixed into the colour: a stroke gets the colour of its place after it is laid on `canvas` [3, H, W]
    and the strokes before it. The colours are then clustered, with the areas of the strokes as weights.
    """
    limits = model.limits.within(size)
    start, control, end = soft.points.unbind(1)
    middle, chord = (start + end) / 2, end - start
    angle = torch.atan2(chord[:, 1], chord[:, 0])
    along = torch.stack((torch.cos(angle), torch.sin(angle)), 1)  # [n, 2]
    off = control - middle
    bend = ((along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0]) / _BOW_OF_BEND).clamp(*limits.bend)
    marks, radius = MarkSizes.of(model), soft.radius.mean(1)
    thickness = np.interp(2 * radius.numpy(), marks.width, marks.thickness)
    before, behind = (
        torch.from_numpy(np.interp(thickness, marks.thickness, reach)).to(radius)
        for reach in (marks.before, marks.behind)
    )
    covered = chord.norm(dim=1) + 2 * _ROUND_END * radius
    length = (covered - before - behind).clamp(*limits.length)
    middle = middle + along * (before - behind)[:, None] / 2
    color = seen_colors(soft, canvas, size)
    palette = Palette.cluster(color, length * radius, colors, seed)
    paint = palette.nearest(color)
    strokes = Strokes(
        middle - along * length[:, None] / 2,
        angle,
        length,
        bend,
        torch.from_numpy(thickness).to(radius),
        palette.color[paint],
    ).project(limits, size)
    return Plan.of(strokes, palette, paint, canvas=size, brush=model.brush, limits=limits)
