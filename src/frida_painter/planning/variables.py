"""Variables of the optimiser: stroke shapes in comparable units, and colours or paints.

One tensor holds all shapes. The unit of each column is a sensible first step, so that one learning rate suits all
columns. A shape is described around the middle of its stroke, so that turning and lengthening do not move the
stroke away.

The painting order is an index that is computed from the strokes' lightness. The variables themselves never change
places, so the optimiser's state stays with its stroke.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.strokes.family import Taught
from frida_painter.strokes.palette import Palette, to_lab
from frida_painter.strokes.strokes import GROUPS, StrokeLimits, Strokes
from frida_painter.system.devices import array, compiles_for

# First steps of x and y in metres, angle in radians, length and bend in metres, and thickness; then of each code.
_UNITS = (0.0015, 0.0015, 0.06, 0.002, 0.001, 0.04)
_CODE_UNIT = 0.1
_COLOR_UNIT = 0.03


@dataclass(frozen=True)
class Paints:
    """Palette and the paint of each stroke.

    color [k, 3]: sRGB of the paints.
    paint [n]: index into `color` for each stroke.
    first: lowest paint number that a newly placed stroke may take.
    """

    color: Tensor
    paint: Tensor
    first: int = 0


class Variables:
    """Leaf tensors of the optimiser, made from strokes and turned back into strokes.

    With `paints`, each stroke has a colour of the palette, and the palette may vary too. Without `paints`, each
    stroke has its own colour. The painting order is from light to dark. The strokes belong to one family, or to none;
    a family has one more column for each code.
    """

    def __init__(self, strokes: Strokes, paints: Paints | None, *, vary_colors: bool) -> None:
        self._taught = None if strokes.taught is None else strokes.taught.detach()
        codes = 0 if self._taught is None else self._taught.code.shape[1]
        self._unit = strokes.angle.new_tensor((*_UNITS, *[_CODE_UNIT] * codes))
        self.shape = self._shape_of(strokes).requires_grad_()  # [n, 6], or more with codes
        free = strokes.color if paints is None else paints.color
        self.color = (free.detach().clone() / _COLOR_UNIT).requires_grad_(vary_colors)  # [n or k, 3]
        self._paints = paints
        self.paint = None if paints is None else paints.paint

    @property
    def leaves(self) -> list[Tensor]:
        """Tensors that the optimiser varies."""
        return [leaf for leaf in (self.shape, self.color) if leaf.requires_grad]

    def strokes(self, order: Tensor | None = None) -> Strokes:
        """Returns the current strokes, differentiable in the leaves.

        order [n]: order of the strokes. None: the order of the variables.
        """
        look: Callable[..., tuple[Tensor, ...]] = _AsStrokes.apply
        if self._compiled:
            groups, taught = look(self.shape, self.color, self._unit, order, self.paint), None
        else:
            groups, taught = self._plainly(order)
        return Strokes(**dict(zip(GROUPS, groups, strict=True)), taught=taught)

    def _plainly(self, order: Tensor | None) -> tuple[tuple[Tensor, ...], Taught | None]:
        """Returns the fields of `Strokes` in the given order, by plain PyTorch, and their families and codes."""
        order = torch.arange(len(self.shape), device=self.shape.device) if order is None else order
        shape, color = self.shape[order], self.color * _COLOR_UNIT
        # All strokes belong to one family.
        taught = None if self._taught is None else replace(self._taught, code=shape[:, 6:] * _CODE_UNIT)
        x, y, angle, length, bend, thickness = (shape * self._unit).unbind(1)[:6]
        cos, sin = torch.cos(angle), torch.sin(angle)
        along, aside = self._middle(length, bend)
        start = torch.stack((x - cos * along + sin * aside, y - sin * along - cos * aside), -1)
        colored = color[order if self.paint is None else self.paint[order]]
        return (start, angle, length, bend, thickness, colored), taught

    @property
    def _compiled(self) -> bool:
        """True if compiled loops do the work (kernels.py); otherwise PyTorch does, with the same result."""
        return self._taught is None and compiles_for(self.shape)

    def bring_inside(self, limits: StrokeLimits, size: CanvasSize, in_paint: Callable[[Tensor], Tensor]) -> None:
        """Replaces the strokes by the nearest ones that a machine can paint (`Strokes.project`).

        Colours that may change become colours that paint can have: `in_paint` maps sRGB [..., 3] to them.
        """
        with torch.no_grad():
            if self._compiled:
                from frida_painter.planning import kernels

                number, limits = _number(self.shape), limits.within(size)
                length, bend = (tuple(map(number, of)) for of in (limits.length, limits.bend))
                shape, unit = array(self.shape), array(self._unit)
                kernels.bring_inside(shape, unit, length, bend, number(size.width), number(size.height))
                torch.autograd.graph.increment_version(self.shape)
            else:
                self.shape.copy_(self._shape_of(self.strokes().project(limits, size)))
            if self.color.requires_grad:
                self.color.copy_(in_paint(self.color * _COLOR_UNIT) / _COLOR_UNIT)

    def order(self) -> Tensor:
        """Painting order of the strokes, as indices [n]."""
        lightness = to_lab(self.color.detach() * _COLOR_UNIT)[:, 0]
        if self.paint is not None:
            lightness = lightness[self.paint]
        return torch.argsort(lightness, descending=True, stable=True)

    def paints(self) -> Paints | None:
        """Current colours of the palette and the paint of each stroke; None without a palette."""
        return None if self._paints is None else replace(self._paints, color=self.color.detach() * _COLOR_UNIT)

    def _middle(self, length: Tensor, bend: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the middle of strokes in their own frames: (l/2, b/2), or the centre of a family's trajectory."""
        if self._taught is None:
            return length / 2, bend / 2
        (family,) = self._taught.families
        return length * family.middle[0], length * family.middle[1]

    def _shape_of(self, strokes: Strokes) -> Tensor:
        strokes = strokes.detach()
        cos, sin = torch.cos(strokes.angle), torch.sin(strokes.angle)
        along, aside = self._middle(strokes.length, strokes.bend)
        x = strokes.position[:, 0] + cos * along - sin * aside
        y = strokes.position[:, 1] + sin * along + cos * aside
        shape = torch.stack((x, y, strokes.angle, strokes.length, strokes.bend, strokes.thickness), -1)
        return (shape if strokes.taught is None else torch.cat((shape, strokes.taught.code), 1)) / self._unit


class _AsStrokes(torch.autograd.Function):
    """Compiled version of `Variables._plainly`, with derivatives in closed form."""

    @staticmethod
    def forward(
        context: Any, shape: Tensor, color: Tensor, unit: Tensor, order: Tensor | None, paint: Tensor | None
    ) -> tuple[Tensor, ...]:
        from frida_painter.planning import kernels

        order = torch.arange(len(shape)) if order is None else order
        colored = order if paint is None else paint[order]
        found = [shape.new_empty(len(shape), *sides) for sides in ((2,), (), (), (), (), (3,))]
        kernels.to_strokes(*map(array, (shape, unit, order, *found[:-1])))
        np.multiply(array(color)[array(colored)], _number(color)(_COLOR_UNIT), out=array(found[-1]))
        context.save_for_backward(shape, unit, order, colored)
        context.colors = len(color)
        return tuple(found)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(context: Any, *upstream: Tensor) -> tuple[Tensor | None, ...]:
        from frida_painter.planning import kernels

        *shaped, colored = context.saved_tensors
        to_shape, to_color = torch.empty_like(shaped[0]), None
        kernels.pull_to_shape(*map(array, (*shaped, *upstream[:-1], to_shape)))
        if context.needs_input_grad[1]:
            to_color = upstream[-1].new_zeros(context.colors, 3)  # strokes of one paint add up in their order
            np.add.at(array(to_color), array(colored), array(upstream[-1]) * _number(to_color)(_COLOR_UNIT))
        return to_shape, to_color, None, None, None


def _number(like: Tensor) -> type[np.floating[Any]]:
    """Returns the NumPy scalar type with the precision of the tensor."""
    return array(like).dtype.type


def as_palette(strokes: Strokes, paints: Paints) -> tuple[Strokes, Palette, Tensor]:
    """Returns strokes from light to dark, their palette from light to dark, and the paint number of each stroke [n]."""
    rank = torch.argsort(to_lab(paints.color)[:, 0], descending=True, stable=True)  # new number -> old
    palette = Palette(paints.color[rank].clamp(0, 1))
    paint = torch.argsort(rank)[paints.paint]
    order = torch.argsort(paint, stable=True)
    return strokes[order].with_groups(color=palette.color[paint[order]]), palette, paint[order]
