"""How pictures and canvas come together: the canvas takes their proportions, or they are cropped or padded."""

import math
from dataclasses import dataclass

from torch import Tensor

from frida_painter import images
from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.goal import Goal
from frida_painter.runs.goals import picture_of
from frida_painter.runs.spec import RunSpec
from frida_painter.session.canvas_observer import PHOTOGRAPH_ROWS

_TOLD = 0.01  # of a picture that is cut off without a word: pixels are whole numbers


@dataclass(frozen=True)
class Fitted:
    """A painting whose canvas and pictures have one shape.

    spec: with its final canvas; goal: with pictures as they fill the canvas; target [3, H, W]: the first of them, if
    any; remark: a sentence where a picture lost something, else "".
    """

    spec: RunSpec
    goal: Goal
    target: Tensor | None
    remark: str = ""


def fitted(spec: RunSpec, goal: Goal, *, canvas_is_fixed: bool = False) -> Fitted:
    """Brings canvas and pictures together as `spec.fit` says.

    canvas_is_fixed: whether the canvas stays as it is: a real one, or that of a painting that was begun. Raises
    ConfigError where a canvas in the picture's proportions would be too narrow.
    """
    picture, canvas = picture_of(goal), spec.canvas
    fixed = canvas_is_fixed or not spec.simulated or spec.calibration is not None  # then it lies on an easel
    shaped = picture is not None and spec.fit == "canvas" and not fixed
    if picture is not None and (shaped or not (canvas_is_fixed or "canvas" in spec.model_fields_set)):
        canvas = canvas.turned_like(*picture.shape[1:])
    if picture is not None and shaped:
        canvas = canvas.shaped_like(*picture.shape[1:])
    spec = spec.model_copy(update={"canvas": canvas}).as_kept
    remark = "" if picture is None or spec.fit == "pad" else _lost(picture, spec.canvas)
    grid = PixelGrid.of_height(spec.canvas, max(PHOTOGRAPH_ROWS, spec.render_height))
    place = images.pad if spec.fit == "pad" else images.fit
    target = None if picture is None else place(picture, grid.rows, grid.columns)
    return Fitted(spec, goal.fitted(*_planned_from(spec), pad=spec.fit == "pad"), target, remark)


def _planned_from(spec: RunSpec) -> tuple[int, int]:
    """Rows and columns of the pictures that a planner is given: some times those that it plans and judges in.

    Means of whole pixels are then exactly those of the file's areas, and no detail is lost in between.
    """
    grid = PixelGrid.of_height(spec.canvas, spec.render_height)
    times = math.ceil(PHOTOGRAPH_ROWS / grid.rows)
    return times * grid.rows, times * grid.columns


def _lost(picture: Tensor, canvas: CanvasSize) -> str:
    """What a crop takes away, in a sentence."""
    share = (picture.shape[2] / picture.shape[1]) / (canvas.width / canvas.height)
    lost, side = (1 - 1 / share, "width") if share > 1 else (1 - share, "height")
    if lost <= _TOLD:
        return ""
    return (
        f"The picture is cropped to the canvas: {100 * lost:.0f} % of its {side} is left out. "
        "To paint all of it, give --fit pad, or a canvas in its proportions."
    )
