"""Strokes of a plan as one struct of arrays, and the limits of a brush."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.canvas_size import AnyCanvas, CanvasSize
from frida_painter.errors import PlanError
from frida_painter.registry import require
from frida_painter.strokes.family import CODE_REACH, StrokeFamily, Taught, describe_families

GROUPS = ("position", "angle", "length", "bend", "thickness", "color")
COLUMNS = ("x", "y", "angle", "length", "bend", "thickness", "red", "green", "blue")
"""Columns of strokes as an array: metres, radians, and colours in [0, 1]."""
_SIZES = {**dict.fromkeys(GROUPS, 1), "position": 2, "color": 3}  # columns of each array
_TOLERANCE = 1e-6
_SAMPLES = 65  # points of a taught path that bound it


@dataclass(frozen=True)
class StrokeLimits:
    """Ranges of lengths and bends that a brush can paint, and the family of its strokes.

    length, bend: (least, most) in metres. The length of a family's stroke is its size; its bend is 0.
    family: family of the strokes. None: strokes of the brush itself.
    The thickness is always in [0, 1], a code in [-CODE_REACH, CODE_REACH].
    """

    length: tuple[float, float]
    bend: tuple[float, float]
    family: StrokeFamily | None = field(default=None, repr=False)

    def within(self, size: AnyCanvas) -> "StrokeLimits":
        """Returns the limits on a canvas of that size.

        No stroke is longer than 0.9 of the shorter side. No bend is larger than a third of that.
        """
        size = CanvasSize.of(size)
        longest = 0.9 * min(size.width, size.height)
        least, most = (min(metres, longest) for metres in self.length)
        bend = min(self.bend[1], longest / 3)
        return StrokeLimits((least, most), (-bend, bend), self.family)


@dataclass(frozen=True)
class Strokes:
    """Strokes of a plan: n strokes in painting order, as one struct of arrays.

    position [n, 2]: start of each stroke in canvas metres
    angle [n]: initial direction in radians, counter-clockwise
    length [n]: metres
    bend [n]: sideways bend in metres
    thickness [n]: pressure in [0, 1]
    color [n, 3]: sRGB in [0, 1]
    taught: families and codes of strokes that a person taught; None if there are none

    The path of a stroke is the cubic Bezier (0, 0), (l/3, b), (2l/3, b), (l, 0), with length l and bend b
    (paper, "Brush Stroke Model"), or the trajectory of its family. Raises PlanError if the shapes do not fit.

    Strokes are a sequence, an array and a table: `strokes[0]`, `for stroke in strokes`, `numpy.asarray(strokes)`,
    `strokes.to_frame()`.

        >>> import frida_painter as fp, torch
        >>> one = torch.ones(1)
        >>> strokes = fp.Strokes(torch.tensor([[0.02, 0.05]]), 0 * one, 0.04 * one, 0 * one, one / 2, torch.ones(1, 3))
        >>> strokes.path(fraction=one)  # the end
        tensor([[[0.0600, 0.0500]]])
    """

    position: Tensor
    angle: Tensor
    length: Tensor
    bend: Tensor
    thickness: Tensor
    color: Tensor
    taught: Taught | None = None

    def __post_init__(self) -> None:
        n = len(self.angle)
        wanted = {"position": (n, 2), "color": (n, 3)}
        for name in GROUPS:
            shape = tuple(getattr(self, name).shape)
            if shape != wanted.get(name, (n,)):
                raise PlanError(
                    f"Strokes were given {name} of shape {shape}; {n} strokes need {wanted.get(name, (n,))}."
                )
        if self.taught is not None and len(self.taught.number) != n:
            raise PlanError(f"Strokes were given codes of {len(self.taught.number)} strokes; there are {n} strokes.")

    def __len__(self) -> int:
        return len(self.angle)

    @property
    def shape(self) -> Tensor:
        """Shape of each path, as a stroke model takes it: bends [n] in metres, or the codes [n, k] of a family."""
        return self.bend if self.taught is None else self.taught.code

    def __repr__(self) -> str:
        if not len(self):
            return "Strokes(0)"
        short, long = (1000 * float(edge) for edge in self.length.detach().aminmax())
        taught = "" if self.taught is None else f", of {describe_families(self.taught.families)}"
        kind, place = str(self.length.dtype).removeprefix("torch."), self.length.device.type
        return f"Strokes({len(self)}, {short:.0f} to {long:.0f} mm long{taught}, {kind} on {place})"

    def __getitem__(self, index: Tensor | NDArray[Any] | slice | list[int] | int) -> Self:
        """Returns the strokes that an index, a slice, a list of indices or a mask selects, in that order.

        `strokes[0]` holds one stroke, so that iteration gives one stroke after another. Raises IndexError.
        """
        if isinstance(index, np.ndarray):
            index = torch.from_numpy(index)
        if isinstance(index, int | np.integer) or (isinstance(index, Tensor) and index.dim() == 0):
            number = int(index)
            if not -len(self) <= number < len(self):
                raise IndexError(f"Stroke {number} was asked for; there are {len(self)}, counted from 0.")
            index = slice(number, number + 1 or None)
        taught = None if self.taught is None else self.taught[index]
        return replace(self, **{name: getattr(self, name)[index] for name in GROUPS}, taught=taught)

    def __iter__(self) -> Iterator[Self]:
        """Yields one stroke after another, each as strokes of length 1."""
        return (self[number] for number in range(len(self)))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Returns a row for each stroke, as `numpy.asarray` wants it: [n, 9], in the order of `COLUMNS`."""
        columns = [getattr(self, name).detach().cpu().reshape(len(self), size) for name, size in _SIZES.items()]
        return np.asarray(torch.cat(columns, 1).numpy(), dtype)

    @classmethod
    def from_array(cls, array: Any) -> Self:
        """Returns the strokes of rows [n, 9] in the order of `COLUMNS`, as `numpy.asarray` gives them.

        array: whatever `numpy.asarray` takes, for example a pandas table with these nine columns
        Raises PlanError if it has another shape, or a number that is not finite.
        """
        rows = np.array(array, np.float32)
        if rows.ndim != 2 or rows.shape[1] != len(COLUMNS) or not np.isfinite(rows).all():
            raise PlanError(
                f"Strokes were given as an array of shape {rows.shape}; it is [n, {len(COLUMNS)}] finite numbers: "
                f"{', '.join(COLUMNS)}."
            )
        columns = torch.from_numpy(rows)
        angle, length, bend, thickness = columns[:, 2:6].unbind(1)
        return cls(columns[:, :2], angle, length, bend, thickness, columns[:, 6:])

    def to_frame(self) -> Any:
        """Returns the strokes as a pandas table with the columns `COLUMNS`; families and codes follow, if any.

        Raises ConfigError if pandas is not installed.
        """
        require("table", "pandas", "A table of strokes")
        import pandas

        frame = pandas.DataFrame(np.asarray(self), columns=list(COLUMNS))
        if self.taught is not None:
            frame["family"] = [self.taught.families[number].name for number in self.taught.number.tolist()]
            for number, code in enumerate(self.taught.code.detach().cpu().unbind(1)):
                frame[f"code_{number}"] = code.numpy()
        return frame

    @classmethod
    def empty(cls, *, dtype: torch.dtype = torch.float32, device: torch.device | str = "cpu") -> Self:
        """Returns zero strokes."""
        nothing = torch.zeros(0, dtype=dtype, device=device)
        return cls(nothing[:, None].expand(0, 2), *4 * (nothing,), nothing[:, None].expand(0, 3))

    @classmethod
    def join(cls, *parts: Self) -> Self:
        """Returns the strokes of all parts, one part after another."""
        groups = {name: torch.cat([getattr(part, name) for part in parts]) for name in GROUPS}
        taught = Taught.join([(len(part), part.taught) for part in parts], groups["angle"])
        return cls(**groups, taught=taught)

    def arrays(self) -> dict[str, Tensor]:
        """Returns the arrays by name (`GROUPS`)."""
        return {name: getattr(self, name) for name in GROUPS}

    def with_groups(self, *, taught: Taught | None = None, **groups: Tensor) -> Self:
        """Returns the same strokes with some arrays replaced; without `taught`, of the same families and codes."""
        return replace(self, **groups, taught=taught or self.taught)

    def to(self, target: torch.dtype | torch.device | str) -> Self:
        """Returns the strokes in another precision or on another device."""
        return self._each(lambda tensors: tensors.to(target))

    def detach(self) -> Self:
        """Returns the strokes without their autograd graph."""
        return self._each(lambda tensors: tensors.detach())

    def _each(self, change: Callable[[Any], Any]) -> Self:
        """Returns the strokes with `change` made to each array, and to families and codes."""
        changed: dict[str, Any] = {name: change(part) for name, part in self.arrays().items()}
        return replace(self, **changed, taught=self.taught and change(self.taught))

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
        for family, which in () if self.taught is None else self.taught.groups():
            place, _ = family.trace(fraction[which], self.length[which], self.shape[which])
            along = along.index_copy(0, which, place[..., 0].to(along))
            aside = aside.index_copy(0, which, place[..., 1].to(aside))
        cos, sin = torch.cos(self.angle)[:, None], torch.sin(self.angle)[:, None]
        x = self.position[:, 0:1] + cos * along - sin * aside
        y = self.position[:, 1:2] + sin * along + cos * aside
        return torch.stack((x, y), -1)

    def way(self) -> Tensor:
        """Returns the length of each stroke on the canvas: [n] in metres.

        It is the length between the ends of a brush's own stroke, and that of the whole path of a taught stroke.
        """
        way = self.length
        for family, which in () if self.taught is None else self.taught.groups():
            way = way.index_copy(0, which, self.length[which] * family.way)
        return way

    def extremes(self) -> Tensor:
        """Returns the points that bound each path: start, end, and turning points in x and y, [n, 4, 2] in metres.

        Along each axis the path is A t + 3 B t (1 - t). It turns at t = (A + 3 B) / (6 B). With taught strokes
        there are 65 points of each path.
        """
        if self.taught is not None:
            fraction = torch.linspace(0, 1, _SAMPLES, dtype=self.length.dtype, device=self.length.device)
            return self._points(fraction.expand(len(self), -1))
        cos, sin = torch.cos(self.angle), torch.sin(self.angle)
        along = torch.stack((cos * self.length, sin * self.length), -1)  # [n, 2], A
        aside = 3 * torch.stack((-sin * self.bend, cos * self.bend), -1)  # [n, 2], 3 B
        straight = aside.abs() < 1e-12
        turn = 0.5 + along / (2 * torch.where(straight, torch.ones_like(aside), aside))
        turn = torch.where(straight, torch.zeros_like(turn), turn).clamp(0, 1)
        start = turn.new_zeros(len(self), 1)  # made on the device of the strokes, without a transfer
        return self._points(torch.cat((start, start + 1, turn), 1))

    def project(self, limits: StrokeLimits, size: AnyCanvas) -> Self:
        """Returns the nearest strokes that a machine may paint.

        Clamps lengths, bends, thickness and colours to their limits. Then moves each stroke, without bending
        it, until its whole path lies on the canvas. A second projection changes nothing.
        """
        size = CanvasSize.of(size)
        limits = limits.within(size)
        inside = self.with_groups(
            length=self.length.clamp(*limits.length),
            bend=self.bend.clamp(*limits.bend),
            thickness=self.thickness.clamp(0, 1),
            color=self.color.clamp(0, 1),
            taught=self.taught and replace(self.taught, code=self.taught.code.clamp(-CODE_REACH, CODE_REACH)),
        )
        extent = inside.extremes()  # [n, 4, 2]
        least, most = extent.amin(1), extent.amax(1)
        beyond = torch.stack((most[:, 0] - size.width, most[:, 1] - size.height), -1)
        moved = (-least).clamp(min=0) - beyond.clamp(min=0)
        return replace(inside, position=inside.position + moved)

    def check(self, limits: StrokeLimits, size: AnyCanvas) -> None:
        """Raises PlanError if a stroke breaks the limits or leaves the canvas; the message names the first one."""
        size = CanvasSize.of(size)
        limits = limits.within(size)
        families = () if self.taught is None else self.taught.families
        if len(self) and families != (() if limits.family is None else (limits.family,)):
            names = ", ".join(family.name for family in families) or "none"
            wanted = "none" if limits.family is None else limits.family.name
            raise PlanError(f"Strokes of the families {names} are in a layer of the family {wanted}; plan anew.")
        x, y = self.extremes().unbind(-1)
        ranges = {
            "length": (self.length, *limits.length), "bend": (self.bend, *limits.bend),
            "thickness": (self.thickness, 0.0, 1.0), "color": (self.color, 0.0, 1.0),
            "x": (x, 0.0, size.width), "y": (y, 0.0, size.height), "angle": (self.angle, -1e4, 1e4),
        }  # fmt: skip
        if self.taught is not None:
            ranges["code"] = self.taught.code, -CODE_REACH, CODE_REACH
        for name, (values, least, most) in ranges.items():
            allowed = (values >= least - _TOLERANCE) & (values <= most + _TOLERANCE)
            allowed = allowed[..., None].flatten(1).all(1)
            if not bool(allowed.all()):
                first = int((~allowed).nonzero()[0, 0])
                raise PlanError(
                    f"Stroke {first} has {name} {values[first].flatten().tolist()}; "
                    f"allowed is {least:g} to {most:g} on a canvas of {size}."
                )
