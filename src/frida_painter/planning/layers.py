"""Layers: later strokes go on the dry paint of earlier ones, and begin light again, as painters work.

The first layer holds most strokes and is planned as if it were all. Those of later layers are a reserve, which is not
settled before its turn comes: its strokes are proposed where the canvas, as it is seen by then, is farthest from
what it should be, and light paint may go over dark.
"""

from collections.abc import Sequence
from dataclasses import replace

import torch

from frida_painter.errors import ConfigError
from frida_painter.plan import Plan
from frida_painter.strokes import Strokes

RESERVE = 0.4
"""Share of the strokes that later layers get together."""


def layer_sizes(strokes: int, layers: int) -> tuple[int, ...]:
    """How many of so many strokes each layer gets. Raises ConfigError unless each can have one."""
    if not 1 <= layers <= strokes:
        raise ConfigError(f"{layers} layers for {strokes} strokes were asked for; give from 1 layer to {strokes}.")
    later = max(layers - 1, round(RESERVE * strokes)) if layers > 1 else 0
    reserve = [later * (number + 1) // (layers - 1) - later * number // (layers - 1) for number in range(layers - 1)]
    return (strokes - later, *reserve)


def with_layers(plan: Plan, parts: Sequence[Plan]) -> Plan:
    """The plan with these strokes in those of its layers that have any."""
    found = iter(parts)
    layers = tuple(len(next(found)) if count else 0 for count in plan.layers)
    strokes, paint = Strokes.join(*(part.strokes for part in parts)), torch.cat([part.paint for part in parts])
    return replace(plan, strokes=strokes, palette=parts[0].palette, paint=paint, layers=layers)
