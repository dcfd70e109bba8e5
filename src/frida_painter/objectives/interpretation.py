"""From what a person said to what is planned towards."""

from frida_painter.frames import PixelGrid
from frida_painter.goal import Goal
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.objective import ObjectiveContext


def interpreted(goal: Goal, grid: PixelGrid, encoders: EncoderRegistry, seed: int) -> Goal:
    """The goal as it is pursued on pictures of that grid: each kind of term in it is asked once, in their order.

    Sketches are drawn on the photograph they came with, words get a picture to begin with, what is painted in
    a style is wanted in its colours, and what is painted by its meaning is attended to where its meaning is.
    Raises WeightsError where a network is missing.
    """
    context = ObjectiveContext(grid, encoders, seed)
    kinds = {type(term) for term in (*goal.terms, *goal.initial)}
    for kind in sorted(kinds, key=lambda kind: (kind.interpretation_order, kind.__qualname__)):
        goal = kind.interpret(goal, context)
    return goal
