"""What the planner plans on: a canvas as it is now, a brush, and what the picture shall become."""

from dataclasses import dataclass

from torch import Tensor

from frida_painter.brush.spread import spread_of
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.frames import CanvasSize
from frida_painter.objectives.objective import Objective
from frida_painter.render import Moments, render, render_moments
from frida_painter.strokes import StrokeLimits, Strokes


@dataclass(frozen=True)
class Scene:
    """A canvas picture [3, H, W] (blank, or a photograph of the real one) of `size`, a brush and an objective.

    validation: says which of several plans is best where the objective cannot: where it looks at a picture
    in another way every time, or could be fooled. importance [H, W]: how much an error matters at each
    place when strokes are placed, 1 in the mean; None: everywhere the same.
    """

    canvas: Tensor
    size: CanvasSize
    model: StrokeModel
    objective: Objective
    validation: Objective | None = None
    importance: Tensor | None = None

    @property
    def limits(self) -> StrokeLimits:
        """What the brush can do on this canvas."""
        return self.model.limits.within(self.size)

    def render(self, strokes: Strokes) -> Tensor:
        """The picture [3, H, W] that the strokes, in their order, would make of the canvas."""
        return render(strokes, self.model, self.canvas, self.size)

    def moments(self, strokes: Strokes) -> Moments:
        """Mean and variance of that picture, since no two marks of one stroke are the same."""
        return render_moments(strokes, self.model, self.canvas, self.size)

    def expected_loss(self, strokes: Strokes, objective: Objective | None = None) -> Tensor:
        """What the objective (default: the scene's own) says on average of the pictures that the strokes would make."""
        judge = objective or self.objective
        if spread_of(self.model).share == 0:
            return judge(self.render(strokes))
        return judge(*self.moments(strokes))
