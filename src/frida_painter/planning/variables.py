"""The numbers that the optimiser turns: stroke shapes in comparable units, and colours or paints.

Shapes are held as one tensor whose columns are measured in units of a sensible first step, so
that one learning rate suits them all, and around the middle of a stroke rather than its start, so
that turning and lengthening do not move it away. The order in which strokes are painted is an
index computed from their lightness; the variables themselves never change places, and the
optimiser's memory stays with its stroke.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any

import numpy as np
import torch
from torch import Tensor

from frida_painter.frames import CanvasSize
from frida_painter.palette import Palette, to_lab
from frida_painter.strokes import StrokeLimits, Strokes

# A first step in metres across, metres up, radians, metres long, metres bent, thickness.
_UNITS = (0.0015, 0.0015, 0.06, 0.002, 0.001, 0.04)
_COLOR_UNIT = 0.03


@dataclass(frozen=True)
class Paints:
    """Colours bound to a palette: stroke i is painted in color[paint[i]]; color [k, 3] sRGB, paint [n].

    No stroke that is placed anew takes a paint numbered below `first`.
    """

    color: Tensor
    paint: Tensor
    first: int = 0


class Variables:
    """Leaf tensors for the optimiser, and their way to strokes and back.

    With `paints` the strokes' colours are those of a palette (whose colours may be varied too);
    without, each stroke has its own. With `light_to_dark` the strokes are painted in that order,
    otherwise in the order given.
    """

    def __init__(self, strokes: Strokes, paints: Paints | None, *, vary_colors: bool, light_to_dark: bool) -> None:
        self._unit = strokes.angle.new_tensor(_UNITS)
        self.shape = self._shape_of(strokes).requires_grad_()  # [n, 6]
        free = strokes.color if paints is None else paints.color
        self.color = (free.detach().clone() / _COLOR_UNIT).requires_grad_(vary_colors)  # [n or k, 3]
        self._paints = paints
        self.paint = None if paints is None else paints.paint
        self.light_to_dark = light_to_dark

    @property
    def leaves(self) -> list[Tensor]:
        """What the optimiser varies."""
        return [leaf for leaf in (self.shape, self.color) if leaf.requires_grad]

    def strokes(self, order: Tensor | None = None) -> Strokes:
        """The strokes as they stand, in that order [n] or the variables' own; differentiable in the leaves."""
        paint, color = self.paint, self.color * _COLOR_UNIT
        if order is not None:
            paint = order if paint is None else paint[order]
        look: Callable[..., tuple[Tensor, ...]] = _AsStrokes.apply
        parts = look(self.shape, self._unit, order) if self._compiled else self._plainly(order)
        position, angle, length, bend, thickness = parts
        return Strokes(position, angle, length, bend, thickness, color if paint is None else color[paint])

    def _plainly(self, order: Tensor | None) -> tuple[Tensor, ...]:
        """Position [n, 2], angle, length, bend and thickness [n] of the strokes in that order, by PyTorch anywhere."""
        shape = self.shape if order is None else self.shape[order]
        x, y, angle, length, bend, thickness = (shape * self._unit).unbind(1)
        cos, sin = torch.cos(angle), torch.sin(angle)
        # From the middle of the stroke, (l/2, b/2) in its own frame, back to its start.
        start = torch.stack((x - cos * length / 2 + sin * bend / 2, y - sin * length / 2 - cos * bend / 2), -1)
        return start, angle, length, bend, thickness

    @property
    def _compiled(self) -> bool:
        """Whether compiled loops do the work (variable_kernels.py); elsewhere PyTorch does, to the same effect."""
        return self.shape.device.type == "cpu" and find_spec("numba") is not None

    def bring_inside(self, limits: StrokeLimits, size: CanvasSize, in_paint: Callable[[Tensor], Tensor]) -> None:
        """Makes them those of the nearest strokes that a machine may paint (`Strokes.project`).

        Colours that may change become those that paint can have; in_paint: which, of sRGB [..., 3].
        """
        with torch.no_grad():
            if self._compiled:
                from frida_painter.planning import variable_kernels

                number, limits = _number(self.shape), limits.within(size)
                length, bend = (tuple(map(number, of)) for of in (limits.length, limits.bend))
                shape, unit = self.shape.numpy(), self._unit.numpy()
                variable_kernels.bring_inside(shape, unit, length, bend, number(size.width), number(size.height))
                torch.autograd.graph.increment_version(self.shape)
            else:
                self.shape.copy_(self._shape_of(self.strokes().project(limits, size)))
            if self.color.requires_grad:
                self.color.copy_(in_paint(self.color * _COLOR_UNIT) / _COLOR_UNIT)

    def order(self) -> Tensor:
        """Which stroke is painted when, [n]."""
        if not self.light_to_dark:
            return torch.arange(len(self.shape), device=self.shape.device)
        lightness = to_lab(self.color.detach() * _COLOR_UNIT)[:, 0]
        if self.paint is not None:
            lightness = lightness[self.paint]
        return torch.argsort(lightness, descending=True, stable=True)

    def paints(self) -> Paints | None:
        """The palette's colours and each stroke's paint, as they stand."""
        return None if self._paints is None else replace(self._paints, color=self.color.detach() * _COLOR_UNIT)

    def _shape_of(self, strokes: Strokes) -> Tensor:
        strokes = strokes.detach()
        cos, sin = torch.cos(strokes.angle), torch.sin(strokes.angle)
        x = strokes.position[:, 0] + cos * strokes.length / 2 - sin * strokes.bend / 2
        y = strokes.position[:, 1] + sin * strokes.length / 2 + cos * strokes.bend / 2
        return torch.stack((x, y, strokes.angle, strokes.length, strokes.bend, strokes.thickness), -1) / self._unit


class _AsStrokes(torch.autograd.Function):
    """`Variables._plainly` by compiled loops, with its derivatives in closed form."""

    @staticmethod
    def forward(context: Any, shape: Tensor, unit: Tensor, order: Tensor | None) -> tuple[Tensor, ...]:
        from frida_painter.planning import variable_kernels

        order = torch.arange(len(shape)) if order is None else order
        found = shape.new_empty(len(shape), 2), *(shape.new_empty(len(shape)) for _ in range(4))
        variable_kernels.to_strokes(*_arrays(shape, unit, order, *found))
        context.save_for_backward(shape, unit, order)
        return found

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(context: Any, *upstream: Tensor) -> tuple[Tensor | None, ...]:
        from frida_painter.planning import variable_kernels

        to_shape = torch.empty_like(context.saved_tensors[0])
        variable_kernels.pull_to_shape(*_arrays(*context.saved_tensors, *upstream, to_shape))
        return to_shape, None, None


def _arrays(*tensors: Tensor) -> list[np.ndarray[Any, Any]]:
    """The tensors as the compiled loops take them."""
    return [tensor.detach().contiguous().numpy() for tensor in tensors]


def _number(like: Tensor) -> type[np.floating[Any]]:
    """A number as precise as the tensor's."""
    return like.detach().numpy().dtype.type


def as_palette(strokes: Strokes, paints: Paints) -> tuple[Strokes, Palette, Tensor]:
    """Strokes in order from light to dark, their palette lightest first, and each stroke's number in it [n]."""
    rank = torch.argsort(to_lab(paints.color)[:, 0], descending=True, stable=True)  # new number -> old
    palette = Palette(paints.color[rank].clamp(0, 1))
    paint = torch.argsort(rank)[paints.paint]
    order = torch.argsort(paint, stable=True)
    return strokes[order].with_groups(color=palette.color[paint[order]]), palette, paint[order]
