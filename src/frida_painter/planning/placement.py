"""Where strokes really land: learned from what the painter sees after each batch.

A robot that stands a few millimetres off against the canvas does so for every stroke. The strokes
just painted, the canvas before and the canvas after tell by how much: the rigid motion is sought
that makes the simulated strokes look most like the ones that are seen. It is a least-squares fit by
Gauss and Newton's method on blurred pictures, together with what was known before, each weighted
by its information (as a Kalman filter does for a quantity that stays the same).
"""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import torch
import torch.nn.functional as functional
from torch import Tensor

from frida_painter.calibration import Calibration
from frida_painter.frames import CanvasSize
from frida_painter.planning.scene import Scene
from frida_painter.strokes import Strokes

# What a robot set up by hand is off, one standard deviation: metres, metres, radians.
_USUAL = (0.003, 0.003, math.radians(1.5))
# Steps at which slopes are taken.
_STEP = (0.0005, 0.0005, math.radians(0.25))
_ROUNDS = 6
_BLUR = 0.004  # metres: edges of marks are ragged, and further off than their slopes reach
_CORRELATED = 0.03  # metres over which the model errs in the same way


@dataclass(frozen=True)
class Placement:
    """By how much strokes land beside where the robot was sent.

    error: metres along the canvas's x and y, and radians counter-clockwise about its centre;
    information [3, 3]: the inverse of its covariance, in the same units.
    """

    error: tuple[float, float, float]
    information: tuple[tuple[float, ...], ...]

    @classmethod
    def unknown(cls) -> Self:
        """Before anything was seen: no error is the best guess, and a few millimetres are usual."""
        return cls((0.0, 0.0, 0.0), tuple(map(tuple, np.diag(1 / np.square(_USUAL)).tolist())))

    def corrected(self, calibration: Calibration, size: CanvasSize) -> Calibration:
        """The calibration by which the robot is sent so that strokes land where they are meant to."""
        x, y, turn = self.error
        cos, sin = math.cos(turn), math.sin(turn)
        middle = np.array([size.width, size.height]) / 2
        rotation = np.array([[cos, -sin], [sin, cos]])
        landing = np.eye(3)
        landing[:2, :2] = rotation
        landing[:2, 2] = middle - rotation @ middle + (x, y)
        placement = np.array(calibration.placement) @ np.linalg.inv(landing)
        return replace(calibration, placement=tuple(map(tuple, placement.tolist())))


@torch.no_grad()
def locate(meant: Strokes, known: Placement, before: Scene, seen: Tensor) -> Placement:
    """What is known after strokes that were `meant` so, and sent as `known` says, have been seen.

    before: the scene in which they were painted; seen [3, H, W]: the canvas afterwards.
    """
    prior = torch.tensor(known.error, dtype=torch.float64)
    certainty = torch.tensor(known.information, dtype=torch.float64)
    sent = _unmoved(meant, known.error, before.size)
    width = _odd_pixels(_BLUR, before)
    blurred = _blurred(seen, width)

    def residual(error: Tensor) -> Tensor:
        landed = moved(sent, tuple(error.tolist()), before.size)
        return (blurred - _blurred(before.render(landed), width)).flatten().cpu().double()

    steps = torch.diag(torch.tensor(_STEP, dtype=torch.float64))
    alike = 3 * _odd_pixels(_CORRELATED, before) ** 2
    error, left, information = prior, residual(prior), certainty
    for _ in range(_ROUNDS):
        slopes = [(residual(error - step) - residual(error + step)) / (2 * step.sum()) for step in steps]
        slope = torch.stack(slopes, 1)  # [pixels, 3], of the picture
        noise = left.square().mean().clamp(min=1e-8) * alike
        information = certainty + slope.T @ slope / noise
        pull = slope.T @ left / noise + certainty @ (prior - error)
        nearer = error + torch.linalg.solve(information, pull)
        remaining = residual(nearer)
        if not remaining.square().sum() < left.square().sum():
            break
        error, left = nearer, remaining
    x, y, turn = error.tolist()
    return Placement((x, y, turn), tuple(map(tuple, information.tolist())))


def moved(strokes: Strokes, error: tuple[float, ...], size: CanvasSize) -> Strokes:
    """Where strokes land that are sent with that error: metres, metres, radians (`Placement.error`)."""
    x, y, turn = error
    position = (strokes.position - _middle(strokes, size)) @ _rotation(strokes, turn) + _middle(strokes, size)
    return strokes.with_groups(position=position + position.new_tensor([x, y]), angle=strokes.angle + turn)


def _unmoved(strokes: Strokes, error: tuple[float, ...], size: CanvasSize) -> Strokes:
    """Where strokes are sent so that they land, with that error, where they are."""
    x, y, turn = error
    offset = strokes.position - strokes.position.new_tensor([x, y]) - _middle(strokes, size)
    position = offset @ _rotation(strokes, -turn) + _middle(strokes, size)
    return strokes.with_groups(position=position, angle=strokes.angle - turn)


def _rotation(strokes: Strokes, turn: float) -> Tensor:
    """Turns rows (x, y) counter-clockwise, [2, 2]."""
    cos, sin = math.cos(turn), math.sin(turn)
    return strokes.position.new_tensor([[cos, sin], [-sin, cos]])


def _middle(strokes: Strokes, size: CanvasSize) -> Tensor:
    return strokes.position.new_tensor([size.width / 2, size.height / 2])


def _odd_pixels(metres: float, scene: Scene) -> int:
    return 2 * round(metres / scene.size.height * scene.canvas.shape[1] / 2) + 1


def _blurred(picture: Tensor, width: int) -> Tensor:
    once = functional.avg_pool2d(picture[None], width, 1, width // 2, count_include_pad=False)
    return functional.avg_pool2d(once, width, 1, width // 2, count_include_pad=False)[0]
