"""What a painting of a photograph is planned towards: the photograph, sharpened by as much as painting softens it.

Marks have soft edges and land beside where they are meant, and where the planner is not sure of them it evens colours
out. So a painting has less contrast than its photograph, from one mark to the next. Printers sharpen pictures for the
same reason.
"""

from dataclasses import replace

from torch import Tensor

from frida_painter import images
from frida_painter.frames import PixelGrid
from frida_painter.goal import Goal, Term
from frida_painter.objectives.kinds.image import ImageTerm

_SPREAD = 0.0037
"""Standard deviation, metres on the canvas, over which a place is compared with what is around it."""


def sharpened(goal: Goal, sharpness: float, grid: PixelGrid) -> Goal:
    """The goal, whose photographs are planned towards as they are when they are sharpened for the canvas of that grid.

    sharpness: by how much of its difference from its surroundings each place differs more (unsharp masking). A goal
    that asks for anything but photographs stays as it is, for then other terms say what is wanted of edges.
    """
    if sharpness == 0 or not all(term.is_pixelwise for term in goal.terms):
        return goal
    spread = _SPREAD / grid.pitch[1]

    def on_canvas(term: Term) -> Term:
        if not isinstance(term, ImageTerm):
            return term
        shown = images.fit(term.image, grid.rows, grid.columns)
        return replace(term, wanted=with_contrast(shown, spread, sharpness))

    return Goal(tuple(map(on_canvas, goal.terms)), goal.initial)


def with_contrast(picture: Tensor, spread: float, amount: float) -> Tensor:
    """A picture [3, H, W] in [0, 1] with `amount` more of each pixel's difference from those within `spread` pixels."""
    return (picture + amount * (picture - images.blurred(picture, spread))).clamp(0, 1)
