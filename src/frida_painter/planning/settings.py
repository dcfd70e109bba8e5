"""Settings of the planner with the defaults of all interfaces; RunSpec takes its defaults from here.

This module loads no PyTorch at run time.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING

from frida_painter.canvas_size import AnyCanvas
from frida_painter.errors import ConfigError

if TYPE_CHECKING:
    from frida_painter.brush.weights import AnyBrush
    from frida_painter.mixing.recipe import PaintSet
    from frida_painter.palette import AnyColor
    from frida_painter.planning.effort import Effort
    from frida_painter.planning.problem import Region


@dataclass(frozen=True, eq=False)
class PlannerSettings:
    """Settings of a planner.

    size: canvas size, such as "14x11in".
    model: brush: its name, a file of weights or a stroke model. With several models, each
    one paints a layer; the brushes may be the same or different ones.
    strokes, colors: default numbers of strokes and of paints; arguments of `plan` override them.
    rows: height of the planning image in pixels. The start is planned at half this height.
    effort: factor of the usual number of iterations, or the iterations of each stage.
    seed: seed of every random choice.

    layers: number of layers. None: one layer for each of several models. With one model, None means the usual
    number of layers if the goal is a picture and the plan has 100 strokes or more, else one layer.
    shares: share of the strokes for each layer. None: the defaults of planning/planner.py.
    new_paints: True if each layer has a palette of its own.

    focus: part of a photograph that matters most (objectives/attention.py): "faces" or "none".
    sharpness: how much sharper than the photograph the plan is (objectives/image.py).
    ground: colour of the bare canvas.
    darkest: colour of the darkest available paint; no stroke is planned darker. None: black.
    paints: paints from which the palettes are mixed: "acrylics", a file of paints, or "any" for every colour.
    region: part of the canvas that strokes keep clear of.
    planner: name of the registered way to plan.

        >>> import frida_painter as fp
        >>> from dataclasses import replace
        >>> settings = fp.PlannerSettings("A5", "broad", strokes=50)
        >>> replace(settings, seed=1).strokes
        50
    """

    size: AnyCanvas
    model: AnyBrush | Sequence[AnyBrush]
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
    ground: AnyColor = (1.0, 1.0, 1.0)
    darkest: AnyColor | None = None
    paints: PaintSet | str = "acrylics"
    region: Region | None = None
    planner: str = "layers"


# Layers: later strokes go on the dry paint of earlier ones, and start light again, as painters work.
#
# The strokes of later layers are a reserve. When a later layer begins, the replan moves its strokes to the places
# where the seen canvas differs most from the goal. There, light paint may cover dark paint.

LAYERS = 2
"""Default number of layers of a plan towards a picture."""
FEWEST_FOR_LAYERS = 100  # strokes
RESERVE = 0.4
"""Default share of the strokes that later layers get together."""


def usual_layers(strokes: int, brushes: int) -> int:
    """Default number of layers of a plan with this many strokes towards a picture."""
    return max(LAYERS, brushes) if strokes >= FEWEST_FOR_LAYERS else 1


def usual_shares(layers: int) -> tuple[float, ...]:
    """Returns the default share of the strokes for each layer."""
    if layers <= 1:
        return (1.0,) * layers
    return (1 - RESERVE, *([RESERVE / (layers - 1)] * (layers - 1)))


def layer_sizes(strokes: int, shares: Sequence[float]) -> tuple[int, ...]:
    """Returns the number of strokes of each layer, by its share. Raises ConfigError if a layer gets no stroke."""
    if not 1 <= len(shares) <= strokes:
        raise ConfigError(f"{len(shares)} layers for {strokes} strokes were asked for; give from 1 layer to {strokes}.")
    total = sum(shares)
    later = max(len(shares) - 1, round(strokes * (total - shares[0]) / total)) if len(shares) > 1 else 0
    later = min(later, strokes - 1)
    rest = list(itertools.accumulate(shares[1:]))
    ends = [int(later * end / rest[-1] + 1e-9) for end in rest]
    sizes = [end - before for before, end in itertools.pairwise([0, *ends])]
    if 0 in sizes:
        number = sizes.index(0) + 1
        raise ConfigError(
            f"Layer {number + 1} gets {shares[number] / total:.1%} of {strokes} strokes, which is not one stroke; give "
            "it a larger share, or leave its brush out."
        )
    return (strokes - later, *sizes)
