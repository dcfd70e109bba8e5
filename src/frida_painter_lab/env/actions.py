"""Actions: seven numbers in [-1, 1] for each stroke, and back. Every action in the space is a stroke that fits.

    0, 1  place: -1 to 1 over all places at which the whole stroke lies on the canvas, from left to right and from the
          lower to the upper edge
    2     angle: -1 to 1 from -pi to pi, counter-clockwise from the canvas's x
    3     length, 4 bend: -1 to 1 from the least to the greatest that the brush paints on this canvas
    5     pressure: -1 for the lightest touch, 1 for the hardest press
    6     paint: [-1, 1] in as many equal parts as there are paints, in their order

So nothing is clamped: the mapping is one to one but for the paint, and for angles of -1 and 1. A stroke's own shape
decides over which places the first two numbers reach.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import PlanError, StepRefused
from frida_painter.strokes.strokes import StrokeLimits, Strokes

NUMBERS = 7
"""Numbers of a stroke."""
NAMES = ("x", "y", "angle", "length", "bend", "pressure", "paint")
_ROUNDING = 1e-4  # of numbers in [-1, 1]


def require_action(action: object, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Returns an action as float32 [*shape]. Raises StepRefused for another shape, and for NaN or outside [-1, 1]."""
    try:
        given = np.asarray(action)
    except (TypeError, ValueError):
        given = np.empty(0, object)
    wanted = f"{' x '.join(map(str, shape))} numbers from -1 to 1"
    if given.dtype.kind not in "fiu":
        raise StepRefused(f"An action of {type(action).__name__} was given; it is an array of {wanted}.")
    if given.shape != shape:
        raise StepRefused(f"An action of shape {given.shape} was given; it is an array of {wanted}.")
    inside = (given >= -1) & (given <= 1)
    if not inside.all():
        at = tuple(int(axis[0]) for axis in np.nonzero(~inside))
        stroke = f" of stroke {', '.join(map(str, at[:-1]))}" if len(at) > 1 else ""
        raise StepRefused(
            f"An action has {given[at]:g} for the {NAMES[at[-1]]}{stroke}; each number is from -1 to 1, and nothing "
            "was painted."
        )
    return given.astype(np.float32)


@dataclass(frozen=True)
class StrokeCode:
    """Code between actions and strokes of one brush on one canvas.

    size: canvas
    limits: of the brush on that canvas (`StrokeLimits.within`)
    paints: number of paints
    """

    size: CanvasSize
    limits: StrokeLimits
    paints: int

    def decode(self, action: NDArray[np.float32], palette: Tensor) -> tuple[Strokes, Tensor]:
        """Returns the strokes of actions [n, 7], and their paints [n].

        palette: colours of the paints, [k, 3] for all strokes or [n, k, 3]
        """
        x, y, angle, length, bend, pressure, paint = torch.from_numpy(action).T
        number = ((paint + 1) / 2 * self.paints).long().clamp(max=self.paints - 1)  # 1 belongs to the last paint
        color = palette[number] if palette.dim() == 2 else palette[torch.arange(len(number)), number]
        shapes = Strokes(
            position=torch.zeros(len(number), 2),
            angle=angle * math.pi,
            length=_between(length, self.limits.length),
            bend=_between(bend, self.limits.bend),
            thickness=(pressure + 1) / 2,
            color=color,
        )
        least, room = self._room(shapes)
        place = (torch.stack((x, y), 1) + 1) / 2 * room - least
        return shapes.with_groups(position=place), number

    def encode(self, strokes: Strokes, paint: Tensor) -> NDArray[np.float32]:
        """Returns the actions [n, 7] of strokes and their paints [n]. Raises PlanError if a stroke does not fit."""
        shapes = strokes.with_groups(position=torch.zeros_like(strokes.position))
        least, room = self._room(shapes)
        turn = (strokes.angle + math.pi).remainder(2 * math.pi) - math.pi
        columns = [
            *((strokes.position + least) / room.clamp(min=1e-9) * 2 - 1).T,
            turn / math.pi,
            _share(strokes.length, self.limits.length),
            _share(strokes.bend, self.limits.bend),
            strokes.thickness * 2 - 1,
            (paint + 0.5) / self.paints * 2 - 1,
        ]
        action = torch.stack([column.to(torch.float64) for column in columns], 1)
        if not bool((action.abs() <= 1 + _ROUNDING).all()):
            raise PlanError(
                f"A stroke was given that the brush cannot paint on a canvas of {self.size}; give one of the same "
                "brush and canvas as the environment."
            )
        return action.clamp(-1, 1).float().numpy()  # only rounding is taken off

    def _room(self, shapes: Strokes) -> tuple[Tensor, Tensor]:
        """Returns the lower left corner [n, 2] of strokes that begin at the origin, and the room to move them in."""
        extent = shapes.extremes()
        least, most = extent.amin(1), extent.amax(1)
        side = most.new_tensor([self.size.width, self.size.height])
        return least, side - (most - least)


def _between(share: Tensor, limits: tuple[float, float]) -> Tensor:
    """Returns -1 to 1 as the least to the greatest value."""
    least, most = limits
    return (least + (share + 1) / 2 * (most - least)).clamp(least, most)  # rounding must not pass a limit


def _share(value: Tensor, limits: tuple[float, float]) -> Tensor:
    """Returns the least to the greatest value as -1 to 1."""
    least, most = limits
    return (value - least) / (most - least) * 2 - 1 if most > least else torch.zeros_like(value)
