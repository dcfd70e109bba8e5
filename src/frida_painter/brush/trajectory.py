"""The trajectory of a stroke: a cubic Bezier on the canvas, pressed lightly at its ends.

Control points (0, 0), (l/3, b), (2l/3, b), (l, 0) with thickness 0.2, h, h, 0.2 (paper, "Brush
Stroke Model" and appendix "Robot Calibration"): a light start keeps the bristles from fanning out
in a direction that nobody can foresee.
"""

import math

import numpy as np
import torch
from numpy.typing import NDArray

from frida_painter.strokes import Strokes

END_THICKNESS = 0.2


def stroke_path(strokes: Strokes, index: int, step: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points at most about `step` metres apart along one stroke.

    Returns position [k, 2] in canvas metres and thickness [k], from 0.2 at the ends towards h
    in between.
    """
    stroke = strokes[[index]].detach().to(torch.float64).to("cpu")
    reach = math.hypot(float(stroke.length[0]), 2 * float(stroke.bend[0]))
    fraction = torch.linspace(0, 1, max(2, math.ceil(reach / step)) + 1, dtype=torch.float64)
    position = stroke.path(fraction)[0].numpy()
    return position, thickness_along(fraction.numpy(), float(stroke.thickness[0]))


def thickness_along(fraction: NDArray[np.float64], thickness: float) -> NDArray[np.float64]:
    """How hard the brush is pressed at fractions [k] of the path's parameter, for a stroke of that thickness."""
    middle = 3 * fraction * (1 - fraction)
    return (1 - middle) * END_THICKNESS + middle * thickness
