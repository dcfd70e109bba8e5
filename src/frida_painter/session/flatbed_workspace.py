"""A desk: a canvas and nothing else that has a place, for plotters and people who are handed their paints."""

import math
from dataclasses import dataclass

from frida_painter.calibration import Calibration
from frida_painter.errors import ConfigError
from frida_painter.frames import CanvasSize
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.workspace import Point, Workspace
from frida_painter.palette import MOST_COLORS

_WELL_PITCH = 0.03
_WATER: Point = (0.0, -0.06, 0.0)
_MARGIN = 0.1
_DEEPEST, _HIGHEST = 0.02, 0.1


@dataclass(frozen=True)
class FlatbedWorkspace:
    """How a pen or a brush goes over a canvas whose bottom-left corner is the zero of all three axes.

    press: how far below the lightest touch (z = 0) the hardest press is, 0 for a pen; lift: how high
    it travels (m); painting_speed, travel_speed: m/s. Raises ConfigError.
    """

    press: float = 0.002
    lift: float = 0.005
    painting_speed: float = 0.05
    travel_speed: float = 0.1

    def __post_init__(self) -> None:
        if not 0 <= self.press <= _DEEPEST:
            raise ConfigError(
                f"A press of {self.press * 1000:g} mm was given; it is from 0, for a pen, to {_DEEPEST * 1000:g} mm."
            )
        if not 0 < self.lift <= _HIGHEST:
            raise ConfigError(
                f"A lift of {self.lift * 1000:g} mm was given; it is above 0 and at most {_HIGHEST * 1000:g} mm."
            )
        for speed in (self.painting_speed, self.travel_speed):
            if not 0 < speed <= 1:
                raise ConfigError(f"A speed of {speed * 1000:g} mm/s was given; it is above 0 and at most 1000 mm/s.")

    def motion(self, canvas: CanvasSize) -> Motion:
        """What a brush does there; its wells, left of the canvas, stand for whoever hands out the paint."""
        # A pen presses nowhere, but a calibration without any depth is taken for a mistake.
        press = max(self.press, math.ulp(1.0))
        workspace = Workspace(
            lower=(-_MARGIN - _WELL_PITCH * MOST_COLORS, -_MARGIN, -press),
            upper=(canvas.width + _MARGIN, canvas.height + _MARGIN, self.lift),
            canvas_origin=(0.0, 0.0, 0.0),
            canvas_angle=0.0,
            wells=tuple((-_WELL_PITCH * (well + 1), 0.0, 0.0) for well in range(MOST_COLORS)),
            water=_WATER,
            rag=_WATER,
            rag_width=0.0,
            hover=self.lift,
            painting_speed=self.painting_speed,
            travel_speed=self.travel_speed,
        )
        corners = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))  # no camera looks at it
        calibration = Calibration("desk", "any", corners, (1, 1), touch_height=0.0, press_height=-press)
        return Motion(workspace, calibration)
