"""From what a person said to what is planned towards."""

from frida_painter.frames import PixelGrid
from frida_painter.goal import Goal
from frida_painter.objectives.encoders.registry import EncoderRegistry


def interpreted(goal: Goal, grid: PixelGrid, encoders: EncoderRegistry, seed: int) -> Goal:
    """The goal as it is pursued on pictures of that grid.

    Sketches are drawn on the photograph they came with, words get a picture to begin with, what is painted in
    a style is wanted in its colours, and what is painted by its meaning is attended to where its meaning is.
    Raises WeightsError where a network is missing.
    """
    # Imported where a goal is pursued: with them come all the networks' modules.
    from frida_painter.objectives.attention import attended
    from frida_painter.objectives.initial_composition import initial_composition
    from frida_painter.objectives.overlay import overlaid
    from frida_painter.objectives.style_colors import in_style_colors

    return attended(in_style_colors(initial_composition(overlaid(goal), grid, encoders, seed)), encoders)
