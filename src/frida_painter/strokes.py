"""Strokes of a plan as one struct of arrays, and the limits of a brush."""

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
    """Ranges of lengths and bends that a brush can paint.

    length, bend: (least, most) in metres.
    The thickness is always in [0, 1].
    """

    length: tuple[float, float]
    bend: tuple[float, float]

    def within(self, size: CanvasSize) -> "StrokeLimits":
        """Returns the limits on a canvas of that size.

        No stroke is longer than 0.9 of the shorter side. No bend is larger than a third of that.
        """
        longest = 0.9 * min(size.width, size.height)
        least, most = (min(metres, longest) for metres in self.length)
        bend = min(self.bend[1], longest / 3)
        return StrokeLimits((least, most), (-bend, bend))


@dataclass(frozen=True)
class Strokes:
    """Strokes of a plan: n strokes in painting order, as one struct of arrays.

    position [n, 2]: start of each stroke in canvas metres
    angle [n]: initial direction in radians, counter-clockwise
    length [n]: metres
    bend [n]: sideways bend in metres
    thickness [n]: pressure in [0, 1]
    color [n, 3]: sRGB in [0, 1]

    The path of a stroke is the cubic Bezier (0, 0), (l/3, b), (2l/3, b), (l, 0), with length l and bend b
    (paper, "Brush Stroke Model"). Raises PlanError if the shapes do not fit.
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
        """Returns the strokes that a slice, a list of indices or a mask selects, in that order."""
        return replace(self, **{name: getattr(self, name)[index] for name in GROUPS})

    @classmethod
    def empty(cls, *, dtype: torch.dtype = torch.float32, device: torch.device | str = "cpu") -> Self:
        """Returns zero strokes."""
        shapes = {"position": (0, 2), "color": (0, 3)}
        return cls(**{name: torch.zeros(shapes.get(name, (0,)), dtype=dtype, device=device) for name in GROUPS})

    @classmethod
    def join(cls, *parts: Self) -> Self:
        """Returns the strokes of all parts, one part after another."""
        return cls(**{name: torch.cat([getattr(part, name) for part in parts]) for name in GROUPS})

    def arrays(self) -> dict[str, Tensor]:
        """Returns the arrays by name (`GROUPS`)."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def with_groups(self, **groups: Tensor) -> Self:
        """Returns the same strokes with some arrays replaced."""
        return replace(self, **groups)

    def to(self, target: torch.dtype | torch.device | str) -> Self:
        """Returns the strokes in another precision or on another device."""
        return replace(self, **{name: tensor.to(target) for name, tensor in self.arrays().items()})

    def detach(self) -> Self:
        """Returns the strokes without their autograd graph."""
        return replace(self, **{name: tensor.detach() for name, tensor in self.arrays().items()})

    def path(self, fraction: Tensor) -> Tensor:
        """Returns points on the path of each stroke.

        fraction [t]: parameters of the curve in [0, 1]
        Returns [n, t, 2] in canvas metres.
        """
        return self._points(fraction.expand(len(self), -1))

    def _points(self, fraction: Tensor) -> Tensor:
        """Returns points on each stroke at its own curve parameters [n, t]: [n, t, 2] in metres."""
        along = fraction * self.length[:, None]  # [n, t]; the x of the Bezier is linear in its parameter
        aside = 3 * fraction * (1 - fraction) * self.bend[:, None]  # [n, t]
        cos, sin = torch.cos(self.angle)[:, None], torch.sin(self.angle)[:, None]
        x = self.position[:, 0:1] + cos * along - sin * aside
        y = self.position[:, 1:2] + sin * along + cos * aside
        return torch.stack((x, y), -1)

    def extremes(self) -> Tensor:
        """Returns the points that bound each path: start, end, and turning points in x and y, [n, 4, 2] in metres.

        Along each axis the path is A t + 3 B t (1 - t). It turns at t = (A + 3 B) / (6 B).
        """
        cos, sin = torch.cos(self.angle), torch.sin(self.angle)
        along = torch.stack((cos * self.length, sin * self.length), -1)  # [n, 2], A
        aside = 3 * torch.stack((-sin * self.bend, cos * self.bend), -1)  # [n, 2], 3 B
        straight = aside.abs() < 1e-12
        turn = 0.5 + along / (2 * torch.where(straight, torch.ones_like(aside), aside))
        turn = torch.where(straight, torch.zeros_like(turn), turn).clamp(0, 1)
        start = turn.new_zeros(len(self), 1)  # made on the device of the strokes, without a transfer
        return self._points(torch.cat((start, start + 1, turn), 1))

    def project(self, limits: StrokeLimits, size: CanvasSize) -> Self:
        """Returns the nearest strokes that a machine may paint.

        Clamps lengths, bends, thickness and colours to their limits. Then moves each stroke, without bending
        it, until its whole path lies on the canvas. A second projection changes nothing.
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
        """Raises PlanError if a stroke breaks the limits or leaves the canvas; the message names the first one."""
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
