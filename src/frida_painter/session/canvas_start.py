"""What a painting begins on: a bare canvas, one that was toned, or whatever is there where a person wants that."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.errors import ConfigError, FrameRejected
from frida_painter.hardware.easel import Easel
from frida_painter.palette import to_lab
from frida_painter.perception.color import true_color
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.margin import Color, is_evenly, light_by_margin, share_unlike
from frida_painter.plan import WHITE

TOLERANCE = 20.0
"""CIELAB within which a canvas that a person has toned by hand has the ground that was wanted."""

_SURE = 5.0  # CIELAB within which the camera knows a colour


def has_ground(canvas: Tensor, ground: Color) -> bool:
    """Whether the canvas [3, H, W] has that ground (sRGB), and is not white paper, to which a pale ground is near."""
    from_white = float((to_lab(torch.tensor(ground)) - to_lab(torch.tensor(WHITE))).norm())
    return is_evenly(canvas, ground, min(TOLERANCE, max(_SURE, from_white / 2)))


def _never(sentence: str, canvas: Tensor) -> bool:
    return False


@dataclass(frozen=True)
class CanvasStart:
    """How a painting may begin.

    ground: sRGB in which the bare canvas is toned, or was toned already; on_canvas: whether it begins on what is on
    the canvas; paint_on: asked, with a sentence and the canvas [3, H, W], where something is on it and nobody said
    so.
    """

    ground: Color = WHITE
    on_canvas: bool = False
    paint_on: Callable[[str, Tensor], bool] = _never

    def light(self, photograph: NDArray[np.uint8], picture: Tensor, easel: Easel) -> FlatField:
        """What the light does, by the first photograph [H, W, 3] and the canvas in it [3, h, w], rectified.

        A bare canvas teaches it; with anything on the canvas, the margin and the last bare canvas do. Raises
        ConfigError where something is on the canvas and nobody wants it painted on, or nothing is although it
        should; CalibrationError where no bare canvas is known; FrameRejected.
        """
        record = easel.calibration
        if record.bare is None and not self.on_canvas:
            return FlatField.learn(picture, WHITE)
        try:
            light = light_by_margin(photograph, record, easel.canvas)
        except FrameRejected:
            if self.on_canvas:
                raise
            return FlatField.learn(picture, WHITE)
        canvas = true_color(light.correct(picture), record)
        if is_evenly(canvas, WHITE):
            if self.on_canvas:
                raise ConfigError(
                    "--on-canvas was given, and the canvas is bare; leave it out, or put up the canvas to paint on."
                )
            return FlatField.learn(picture, WHITE)
        if not (self.on_canvas or is_evenly(canvas, self.ground, TOLERANCE)):
            sentence = f"The canvas is not bare: {100 * share_unlike(canvas, WHITE):.0f} % of it is not white."
            if not self.paint_on(sentence, canvas):
                raise ConfigError(
                    f"{sentence} To paint on what is there, say --on-canvas; else put up a bare canvas. Where it "
                    "is bare, repeat the canvas calibration."
                )
        return light
