"""Layers: later strokes go on the dry paint of earlier ones, and begin light again, as painters work.

Strokes of later layers are a reserve, which is not settled before its turn comes: by then they move to where the
canvas, as it is seen, is farthest from what it should be, and light paint may go over dark.
"""

import itertools
from collections.abc import Sequence

from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.brush.table_cache import cached_table
from frida_painter.brush.weights import load_stroke_model
from frida_painter.errors import ConfigError

LAYERS = 2
"""Of a plan towards a picture, where nothing else is said."""
FEWEST_FOR_LAYERS = 100  # strokes
RESERVE = 0.4
"""Share of the strokes that later layers get together, where nothing else is said."""


def stroke_models(given: StrokeModel | str | Sequence[StrokeModel | str]) -> tuple[StrokeModel, ...]:
    """The stroke model of each layer, or the one of all: those given, and the tables of those that are named.

    Raises WeightsError where there is none of that name, ConfigError for two of one brush.
    """
    several = given if isinstance(given, Sequence) and not isinstance(given, str) else (given,)
    named = {name: cached_table(load_stroke_model(name)) for name in several if isinstance(name, str)}
    models = tuple(named[one] if isinstance(one, str) else one for one in several)
    if len({id(one) for one in models}) > len({one.brush for one in models}):
        raise ConfigError("Two stroke models of one brush were given; all layers of a brush have the same one.")
    return models


def usual_layers(strokes: int, brushes: int) -> int:
    """How many layers so many strokes towards a picture have, where nothing else is said."""
    return max(LAYERS, brushes) if strokes >= FEWEST_FOR_LAYERS else 1


def usual_shares(layers: int) -> tuple[float, ...]:
    """Which share of the strokes each of so many layers gets, where nothing else is said."""
    if layers <= 1:
        return (1.0,) * layers
    return (1 - RESERVE, *([RESERVE / (layers - 1)] * (layers - 1)))


def layer_sizes(strokes: int, shares: Sequence[float]) -> tuple[int, ...]:
    """How many of so many strokes each layer gets, by its share. Raises ConfigError unless each has one."""
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
