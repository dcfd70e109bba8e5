"""Where strokes really land: learned from what the painter sees after each batch.

A robot that stands a few millimetres off against the canvas does so for every stroke. The strokes
just painted, the canvas before and the canvas after tell by how much: the rigid motion is sought
that makes the simulated strokes look most like the ones that are seen. It is a least-squares fit on
blurred pictures, together with what was known before, each weighted by its information (as a Kalman
filter does for a quantity that stays the same).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import torch
import torch.nn.functional as functional
from torch import Tensor

from frida_painter import images
from frida_painter.calibration import Calibration
from frida_painter.frames import CanvasSize
from frida_painter.planning.least_squares import gauss_newton
from frida_painter.planning.scene import Scene
from frida_painter.planning.touch_heights import TouchHeights, measure_touch
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
    information [3, 3]: the inverse of its covariance, in the same units; touch: at which heights brushes touch there.
    """

    error: tuple[float, float, float]
    information: tuple[tuple[float, ...], ...]
    touch: TouchHeights = field(default_factory=TouchHeights)

    @classmethod
    def unknown(cls, depths: Mapping[str, float] | None = None) -> Self:
        """Before anything was seen: no error is the best guess, and a few millimetres are usual.

        depths: of brushes whose touch heights are learned, as TouchHeights has them.
        """
        information = tuple(map(tuple, np.diag(1 / np.square(_USUAL)).tolist()))
        return cls((0.0, 0.0, 0.0), information, TouchHeights.unknown(depths or {}))

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
        return self.touch.corrected(replace(calibration, placement=tuple(map(tuple, placement.tolist()))))


def learn(meant: Strokes, known: Placement, coarse: Scene, fine: Scene, seen: Tensor) -> Placement:
    """What is known after strokes of one brush, that were `meant` so, and sent as `known` says, have been seen.

    coarse, fine: the scene in which they were painted, of a low and of a high resolution; seen [3, H, W]: the canvas
    afterwards. Where they land is seen in the coarse one, and at which height the brush touched in the fine one.
    """
    found = locate(meant, known, coarse, images.fit(seen, *coarse.canvas.shape[1:]))
    landed = moved(_unmoved(meant, known.error, fine.size), found.error, fine.size)
    return replace(found, touch=measure_touch(landed, known.touch, fine, images.fit(seen, *fine.canvas.shape[1:])))


@torch.no_grad()
def locate(meant: Strokes, known: Placement, before: Scene, seen: Tensor) -> Placement:
    """What is known after strokes that were `meant` so, and sent as `known` says, have been seen.

    before: the scene in which they were painted; seen [3, H, W]: the canvas afterwards.
    """
    sent = _unmoved(meant, known.error, before.size)
    width = _odd_pixels(_BLUR, before)
    blurred = _blurred(seen, width)

    def residual(error: Tensor) -> Tensor:
        landed = moved(sent, tuple(error.tolist()), before.size)
        return (blurred - _blurred(before.render(landed), width)).flatten().cpu().double()

    error, information = gauss_newton(
        residual,
        torch.tensor(known.error, dtype=torch.float64),
        torch.tensor(known.information, dtype=torch.float64),
        torch.tensor(_STEP, dtype=torch.float64),
        3 * _odd_pixels(_CORRELATED, before) ** 2,
        _ROUNDS,
    )
    x, y, turn = error.tolist()
    return Placement((x, y, turn), tuple(map(tuple, information.tolist())), known.touch)


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
