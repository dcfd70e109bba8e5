"""The eye of the painter: photographs of the easel become pictures of the canvas, straight on and in true colours."""

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.errors import StaleFrame
from frida_painter.frames import PixelGrid
from frida_painter.hardware.camera import Frame
from frida_painter.hardware.easel import Easel
from frida_painter.perception.color import true_color
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.rectify import rectify

_ATTEMPTS = 3


class Eye:
    """Looks at the canvas of an easel.

    The first look, at the bare canvas of colour `ground` (sRGB), teaches it the `light` of the room,
    unless that is known from before.
    """

    def __init__(self, easel: Easel, ground: tuple[float, float, float], light: FlatField | None = None) -> None:
        self.easel = easel
        self.ground = ground
        self.light = light
        self._last_sequence = -1

    def look(self, last_motion: float, rows: int) -> Tensor:
        """The canvas [3, rows, columns] in sRGB as it is after `last_motion` (s of the robot's clock).

        Raises StaleFrame where the camera gives no photograph newer than that, and FrameRejected
        where it does not show the canvas.
        """
        return self.see(self.photograph(last_motion).image, rows)

    def see(self, photograph: NDArray[np.uint8], rows: int) -> Tensor:
        """The canvas [3, rows, columns] in a photograph [H, W, 3]. Raises FrameRejected."""
        grid = PixelGrid.of_height(self.easel.canvas, rows)
        picture = rectify(photograph, self.easel.calibration, grid)
        if self.light is None:
            self.light = FlatField.learn(picture, self.ground)
        return true_color(self.light.correct(picture), self.easel.calibration)

    def photograph(self, last_motion: float) -> Frame:
        """A photograph taken after the last motion, never one that was seen before; tried three times."""
        for _ in range(_ATTEMPTS):
            try:
                frame = self.easel.camera.capture(last_motion)
            except StaleFrame:
                continue
            if frame.captured_at > last_motion and frame.sequence > self._last_sequence:
                self._last_sequence = frame.sequence
                return frame
        raise StaleFrame(
            f"The camera was asked {_ATTEMPTS} times and gave no new photograph taken after the arm's last motion "
            f"(at {last_motion:.1f} s). Look whether the camera is still connected, and start again."
        )
