"""Photographs that show the easel as it is: taken after the arm's last motion, and never the same one twice."""

from frida_painter.errors import CameraError, StaleFrame
from frida_painter.hardware.camera import Camera, Frame

_ATTEMPTS = 3


class Photographer:
    """Asks a camera until it gives a photograph that is newer than all before it."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._last_sequence = -1

    def photograph(self, last_motion: float) -> Frame:
        """A photograph taken after `last_motion` (s of the robot's clock), never one that was seen before.

        It is tried three times. Raises StaleFrame, or whatever else the camera complained of last.
        """
        trouble: CameraError | None = None
        for _ in range(_ATTEMPTS):
            trouble = None
            try:
                frame = self._camera.capture(last_motion)
            except StaleFrame:
                continue
            except CameraError as complaint:
                trouble = complaint
                continue
            if frame.captured_at > last_motion and frame.sequence > self._last_sequence:
                self._last_sequence = frame.sequence
                return frame
        raise trouble or StaleFrame(
            f"The camera was asked {_ATTEMPTS} times and gave no new photograph taken after the arm's last motion "
            f"(at {last_motion:.1f} s). Look whether the camera is still connected, then start again."
        )
