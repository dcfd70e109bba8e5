"""What the planner plans on: a canvas as it is now, a brush, and what the picture shall become."""

import copy
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from frida_painter.brush.dip import painted_area
from frida_painter.brush.spread import CoverageSpread, spread_of
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.frames import ALL_ROWS, CanvasSize, PixelGrid, Rows
from frida_painter.objectives.objective import Objective
from frida_painter.render import Marks, Moments, marks_of, render, render_moments
from frida_painter.strokes import StrokeLimits, Strokes

# Marks vary more in a painting than in a stroke library: paint lies on paint that may be wet, the brush is not always
# full, and of all strokes those are chosen for which the model is wrong in their favour. Measured on three photographs.
_IN_A_PAINTING = 1.5
PAINT_PRICE = 0.0003
"""Of strokes towards a photograph, as a share of the loss for as much paint as the brush's largest mark takes."""
_NOISE = 0.03  # of sRGB, by which a photograph of a bare canvas may differ from it


@dataclass(frozen=True)
class Scene:
    """A canvas picture [3, H, W] (blank, or a photograph of the real one) of `size`, a brush and an objective.

    validation: says which of several plans is best where the objective cannot: where it looks at a picture
    in another way every time, or could be fooled. importance [H, W]: how much an error matters at each
    place when strokes are placed, 1 in the mean; None: everywhere the same. flow [3, H, W]: which way strokes go where
    they are placed, as objectives/brushwork.py tells it; None: any way. paint_price: by which share the
    loss would have to fall for as much more paint as the brush's largest mark takes. objective_on_rows: the
    objective for pictures that have some rows only; None where it judges whole pictures. rows: which rows of the
    canvas are rendered and judged. darkest [3]: sRGB of the darkest paint that there is; None: black.
    """

    canvas: Tensor
    size: CanvasSize
    model: StrokeModel
    objective: Objective
    validation: Objective | None = None
    importance: Tensor | None = None
    flow: Tensor | None = None
    paint_price: float = 0.0
    objective_on_rows: Callable[[Rows], Objective] | None = None
    rows: Rows = ALL_ROWS
    darkest: Tensor | None = None

    @property
    def limits(self) -> StrokeLimits:
        """What the brush can do on this canvas."""
        return self.model.limits.within(self.size)

    def in_paint(self, color: Tensor) -> Tensor:
        """sRGB [..., 3] as near as paint comes to it: in [0, 1], and no band darker than in the darkest paint."""
        return color.clamp(0, 1) if self.darkest is None else torch.maximum(color.clamp(max=1), self.darkest)

    def marks(self, strokes: Strokes) -> Marks:
        """The marks that the brush makes of strokes, on the rows that are looked at."""
        return marks_of(strokes, self.model, PixelGrid(self.size, *self.canvas.shape[1:]), self.rows)

    def render(self, strokes: Strokes) -> Tensor:
        """The picture [3, H, W] that the strokes, in their order, would make of the canvas."""
        return render(strokes, self.model, self.canvas, self.size, self.rows)

    def moments(self, strokes: Strokes) -> Moments:
        """Mean and variance of that picture, since no two marks of one stroke are the same."""
        return render_moments(strokes, self.model, self.canvas, self.size, self.spread, self.rows)

    @property
    def spread(self) -> CoverageSpread:
        """How much the marks of a painting vary about what the model says."""
        return spread_of(self.model).widened(_IN_A_PAINTING)

    def expected_loss(self, strokes: Strokes, objective: Objective | None = None) -> Tensor:
        """What the objective (default: the scene's own) says on average of the pictures that the strokes would make."""
        judge = objective or self.objective
        if self.spread.share == 0:
            return judge(self.render(strokes))
        return judge(*self.moments(strokes))

    def paint_cost(self, strokes: Strokes) -> Tensor:
        """What the paint of strokes costs, as a share of the loss."""
        longest = self.model.limits.length[1]
        return self.paint_price * painted_area(strokes.length / longest, strokes.thickness, 1.0).sum()


def is_bare(canvas: Tensor, ground: tuple[float, float, float]) -> bool:
    """Whether a canvas picture [3, H, W] shows nothing but its ground (sRGB) and the noise of a camera."""
    return bool((canvas - torch.tensor(ground).to(canvas)[:, None, None]).abs().amax() <= _NOISE)


def on_device(model: StrokeModel, device: torch.device) -> StrokeModel:
    """The model on a device: a copy of it where that is another than the CPU, on which others draw with it."""
    return copy.deepcopy(model).to(device) if device.type != "cpu" and isinstance(model, nn.Module) else model
