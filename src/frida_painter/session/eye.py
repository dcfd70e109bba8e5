"""The eye of the painter: photographs of the easel become pictures of the canvas, straight on and in true colours."""

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

    The first look, at the bare canvas of colour `ground` (sRGB), teaches it the light of the room.
    """

    def __init__(self, easel: Easel, ground: tuple[float, float, float]) -> None:
        self.easel = easel
        self.ground = ground
        self._light: FlatField | None = None
        self._last_sequence = -1

    def look(self, last_motion: float, rows: int) -> Tensor:
        """The canvas [3, rows, columns] in sRGB as it is after `last_motion` (s of the robot's clock).

        Raises StaleFrame where the camera gives no photograph newer than that, and FrameRejected
        where it does not show the canvas.
        """
        frame = self._fresh(last_motion)
        grid = PixelGrid.of_height(self.easel.canvas, rows)
        picture = rectify(frame.image, self.easel.calibration, grid)
        if self._light is None:
            self._light = FlatField.learn(picture, self.ground)
        return true_color(self._light.correct(picture), self.easel.calibration)

    def _fresh(self, last_motion: float) -> Frame:
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
