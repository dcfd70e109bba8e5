"""From free colours to paints: colours move towards the paints in rounds, then strokes and paints settle together."""

from collections.abc import Callable

from frida_painter.planning.optimize import Step, optimize
from frida_painter.planning.refine import anneal_to_palette, discretize
from frida_painter.planning.scene import Scene
from frida_painter.planning.variables import Paints
from frida_painter.strokes import Strokes

_KEEPING = (0.7, 0.45, 0.2, 0.1)  # of the way from a stroke's colour to its paint, round after round


def binding_iterations(drawing: int, binding: int) -> int:
    """How many iterations it takes."""
    return len(_KEEPING) * drawing + binding


def bound(
    strokes: Strokes,
    scene: Scene,
    colors: int,
    *,
    drawing: int,
    binding: int,
    seed: int,
    begin: Callable[[int], Callable[[Step], None]],
) -> tuple[Strokes, Paints]:
    """The strokes, in painting order, in at most `colors` paints.

    drawing: iterations after each round; binding: once colours are paints; begin: where so many of them are to be
    reported.
    """
    for keeping in _KEEPING:
        strokes = anneal_to_palette(strokes, scene, colors, keeping, seed)
        strokes, _ = optimize(strokes, scene, iterations=drawing, notify=begin(drawing))
    strokes, chosen = discretize(strokes, scene, colors, seed)
    strokes, paints = optimize(strokes, scene, iterations=binding, paints=chosen, notify=begin(binding))
    assert paints is not None
    return strokes, paints
