"""Strokes: one struct of arrays for all strokes of a plan, and the limits that a brush sets them."""

from dataclasses import dataclass, fields, replace
from typing import Self

import torch
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import PlanError

GROUPS = ("position", "angle", "length", "bend", "thickness", "color")
_TOLERANCE = 1e-6


@dataclass(frozen=True)
class StrokeLimits:
    """What a brush can do: lengths and bends in metres, (least, most). Thickness is always in [0, 1]."""

    length: tuple[float, float]
    bend: tuple[float, float]

    def within(self, size: CanvasSize) -> "StrokeLimits":
        """The limits on a canvas of that size: no stroke is longer than nine tenths of the shorter side."""
        longest = 0.9 * min(size.width, size.height)
        least, most = (min(metres, longest) for metres in self.length)
        bend = min(self.bend[1], longest / 3)
        return StrokeLimits((least, most), (-bend, bend))


@dataclass(frozen=True)
class Strokes:
    """n strokes in the order in which they are painted.

    A stroke starts at `position` [n, 2] (metres on the canvas), heads along `angle` [n] (radians,
    counter-clockwise), runs `length` [n] metres while it bends sideways by `bend` [n] metres, is
    pressed by `thickness` [n] in [0, 1] and painted in `color` [n, 3] (sRGB in [0, 1]). Its path is
    the cubic Bezier (0, 0), (l/3, b), (2l/3, b), (l, 0) (paper, "Brush Stroke Model").
    """

    position: Tensor
    angle: Tensor
    length: Tensor
    bend: Tensor
    thickness: Tensor
    color: Tensor

    def __post_init__(self) -> None:
        n = len(self.angle)
        wanted = {"position": (n, 2), "color": (n, 3)}
        for name in GROUPS:
            shape = tuple(getattr(self, name).shape)
            if shape != wanted.get(name, (n,)):
                raise PlanError(
                    f"Strokes were given {name} of shape {shape}; {n} strokes need {wanted.get(name, (n,))}."
                )

    def __len__(self) -> int:
        return len(self.angle)

    def __getitem__(self, index: Tensor | slice | list[int]) -> Self:
        """The strokes that a slice, a list of indices or a mask picks, in that order."""
        return replace(self, **{name: getattr(self, name)[index] for name in GROUPS})

    @classmethod
    def empty(cls, *, dtype: torch.dtype = torch.float32, device: torch.device | str = "cpu") -> Self:
        """No strokes at all."""
        shapes = {"position": (0, 2), "color": (0, 3)}
        return cls(**{name: torch.zeros(shapes.get(name, (0,)), dtype=dtype, device=device) for name in GROUPS})

    @classmethod
    def join(cls, *parts: Self) -> Self:
        """All strokes of the parts, one part after another."""
        return cls(**{name: torch.cat([getattr(part, name) for part in parts]) for name in GROUPS})

    def arrays(self) -> dict[str, Tensor]:
        """The groups by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def with_groups(self, **groups: Tensor) -> Self:
        """The same strokes with some groups replaced."""
        return replace(self, **groups)

    def to(self, target: torch.dtype | torch.device | str) -> Self:
        """The strokes in another precision or on another device."""
        return replace(self, **{name: tensor.to(target) for name, tensor in self.arrays().items()})

    def detach(self) -> Self:
        """The strokes cut off from the graph that made them."""
        return replace(self, **{name: tensor.detach() for name, tensor in self.arrays().items()})

    def path(self, fraction: Tensor) -> Tensor:
        """Points of each stroke's path on the canvas.

        fraction [t] in [0, 1] along the curve's parameter -> [n, t, 2] metres.
        """
        return self._points(fraction.expand(len(self), -1))

    def _points(self, fraction: Tensor) -> Tensor:
        """Points at each stroke's own fractions [n, t] -> [n, t, 2] metres."""
        along = fraction * self.length[:, None]  # [n, t]; the x of the Bezier is linear in its parameter
        aside = 3 * fraction * (1 - fraction) * self.bend[:, None]  # [n, t]
        cos, sin = torch.cos(self.angle)[:, None], torch.sin(self.angle)[:, None]
        x = self.position[:, 0:1] + cos * along - sin * aside
        y = self.position[:, 1:2] + sin * along + cos * aside
        return torch.stack((x, y), -1)

    def extremes(self) -> Tensor:
        """Start, end and the turning points of each path in x and in y, which bound it: [n, 4, 2] metres.

        Along either axis the path is A t + 3 B t (1 - t), which turns at t = (A + 3 B) / (6 B).
        """
        cos, sin = torch.cos(self.angle), torch.sin(self.angle)
        along = torch.stack((cos * self.length, sin * self.length), -1)  # [n, 2], A
        aside = 3 * torch.stack((-sin * self.bend, cos * self.bend), -1)  # [n, 2], 3 B
        straight = aside.abs() < 1e-12
        turn = 0.5 + along / (2 * torch.where(straight, torch.ones_like(aside), aside))
        turn = torch.where(straight, torch.zeros_like(turn), turn).clamp(0, 1)
        start = turn.new_zeros(len(self), 1)  # filled where the strokes are, not sent there
        return self._points(torch.cat((start, start + 1, turn), 1))

    def project(self, limits: StrokeLimits, size: CanvasSize) -> Self:
        """The nearest strokes that a machine may paint.

        Lengths, bends, thickness and colours are brought inside their limits, and each stroke is
        moved, not bent, until its whole path lies on the canvas. Projecting twice changes nothing
        more.
        """
        limits = limits.within(size)
        inside = replace(
            self,
            length=self.length.clamp(*limits.length),
            bend=self.bend.clamp(*limits.bend),
            thickness=self.thickness.clamp(0, 1),
            color=self.color.clamp(0, 1),
        )
        extent = inside.extremes()  # [n, 4, 2]
        least, most = extent.amin(1), extent.amax(1)
        beyond = torch.stack((most[:, 0] - size.width, most[:, 1] - size.height), -1)
        moved = (-least).clamp(min=0) - beyond.clamp(min=0)
        return replace(inside, position=inside.position + moved)

    def check(self, limits: StrokeLimits, size: CanvasSize) -> None:
        """Raises PlanError, naming the first stroke and what is wrong with it, unless all may be painted."""
        limits = limits.within(size)
        ranges = {
            "length": (self.length, *limits.length),
            "bend": (self.bend, *limits.bend),
            "thickness": (self.thickness, 0.0, 1.0),
            "color": (self.color, 0.0, 1.0),
            "x": (self.extremes()[..., 0], 0.0, size.width),
            "y": (self.extremes()[..., 1], 0.0, size.height),
            "angle": (self.angle, -1e4, 1e4),
        }
        for name, (values, least, most) in ranges.items():
            allowed = (values >= least - _TOLERANCE) & (values <= most + _TOLERANCE)
            allowed = allowed[..., None].flatten(1).all(1)
            if not bool(allowed.all()):
                first = int((~allowed).nonzero()[0, 0])
                raise PlanError(
                    f"Stroke {first} has {name} {values[first].flatten().tolist()}; "
                    f"allowed is {least:g} to {most:g} on a canvas of {size}."
                )
