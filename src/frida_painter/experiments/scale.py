"""How much an experiment does: in full, or only as much as shows that it runs."""

from dataclasses import dataclass

from frida_painter.frames import CanvasSize

CANVAS = CanvasSize(14 * 0.0254, 11 * 0.0254)
"""The canvas of the paper's paintings, 14 by 11 inches."""
ROBOT_ERROR = "off by about 2 mm and 0.4 degrees as drawn from the seed"
"""How the virtual robot of an experiment stands that draws its placement from the seed."""


@dataclass(frozen=True, kw_only=True)
class ExperimentScale:
    """What all experiments have.

    strokes: of every plan, or of a stroke library that is painted for the experiment; quick: as little as
    possible, so that figures mean nothing.
    """

    strokes: int
    quick: bool = False


@dataclass(frozen=True, kw_only=True)
class PlanningScale(ExperimentScale):
    """Of experiments that plan and paint.

    colors: paints of every plan; rows: height of the planning image, pixels; effort: share of the usual
    planning; looks: at the canvas while it is painted.
    """

    colors: int
    rows: int
    effort: float
    looks: int = 0

    def settings(self) -> dict[str, int | float]:
        """What every plan was made with, as an outcome names it."""
        return {"strokes": self.strokes, "colors": self.colors, "rows": self.rows, "effort": self.effort}


@dataclass(frozen=True, kw_only=True)
class LearningScale(ExperimentScale):
    """Of experiments in which stroke models learn.

    held_out: strokes that no model learns from; sizes: numbers of strokes for training and validation, where
    there are several; folds: trainings of each.
    """

    held_out: int
    sizes: tuple[int, ...] = ()
    folds: int = 1
