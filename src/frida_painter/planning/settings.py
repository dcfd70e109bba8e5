"""Settings of the planner with the defaults of all interfaces; RunSpec takes its defaults from here.

This module loads no PyTorch at run time.
"""

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
    """Settings of a planner.

    size: canvas size, such as "14x11in".
    model: stroke model of the brush, or the name of a brush that comes with the project. With several models, each
    one paints a layer; the brushes may be the same or different ones.
    strokes, colors: default numbers of strokes and of paints; arguments of `plan` override them.
    rows: height of the planning image in pixels. The start is planned at half this height.
    effort: factor of the usual number of iterations, or the iterations of each stage.
    seed: seed of every random choice.

    layers: number of layers. None: one layer for each of several models. With one model, None means the usual
    number of layers if the goal is a picture and the plan has 100 strokes or more, else one layer.
    shares: share of the strokes for each layer. None: the defaults of planning/planner.py.
    new_paints: True if each layer has a palette of its own.

    focus: part of a photograph that matters most (objectives/attention.py): "faces", "subject" or "none".
    sharpness: how much sharper than the photograph the plan is (objectives/pixel_loss.py).
    ground: colour of the bare canvas.
    darkest: colour of the darkest available paint; no stroke is planned darker. None: black.
    region: part of the canvas that strokes keep clear of.
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
