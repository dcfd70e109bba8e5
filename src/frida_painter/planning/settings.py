"""What a planner is told, with the defaults of all faces; RunSpec takes its own from here. It loads no tensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING

from frida_painter.canvas_size import CanvasSize

if TYPE_CHECKING:
    from frida_painter.brush.kinds import StrokeModel
    from frida_painter.planning.layers import Effort
    from frida_painter.planning.problem import Region


Color = tuple[float, float, float]
"""sRGB in [0, 1]."""


@dataclass(frozen=True, eq=False)
class PlannerSettings:
    """How a plan is made.

    size: of the canvas, such as "14x11in".
    model: what the brush's marks look like, or the name of a brush that comes with the project; several, of different
    brushes or the same, paint a layer each.
    strokes, colors: of a plan, unless `plan` is asked for others.
    rows: height of the planning image in pixels; the start is planned at half of it.
    effort: how many iterations are spent, as a factor of the usual number, or one by one.
    seed: of every random choice.
    layers: of a plan, one for each of several models; None: that many, or the usual number of one model, towards a
    picture in 100 strokes or more, else one, of the first model.
    shares: of the strokes that each layer gets, by default as planning/planner.py says.
    new_paints: whether each layer has a palette of its own.
    focus: what matters most in photographs (objectives/attention.py): "faces", "subject" or "none".
    sharpness: how much sharper than photographs the plan is (objectives/pixel_loss.py).
    ground: the colour of the bare canvas.
    darkest: the darkest paint that there is; none is planned darker. None: black.
    region: what strokes keep clear of.
    """

    size: CanvasSize | str
    model: StrokeModel | str | Sequence[StrokeModel | str]
    _: KW_ONLY
    strokes: int = 300
    colors: int = 12
    rows: int = 256
    effort: Effort | float = 1.0
    seed: int = 0
    layers: int | None = None
    shares: Sequence[float] | None = None
    new_paints: bool = True
    focus: str = "faces"
    sharpness: float = 0.3
    ground: Color = (1.0, 1.0, 1.0)
    darkest: Color | None = None
    region: Region | None = None
