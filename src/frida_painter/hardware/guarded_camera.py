"""A camera under guard: whatever its driver does becomes a photograph or an error with a name, in bounded time."""

import math
import threading
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import CameraError
from frida_painter.hardware.camera import Camera, Frame, LiveCamera
from frida_painter.hardware.deadline import Caller, in_our_errors, steady

T = TypeVar("T")


class GuardedCamera:
    """Implements hardware.camera.Camera over another; a call is given up after `patience` seconds."""

    def __init__(self, camera: Camera, *, patience: float = 30.0) -> None:
        self.camera = camera
        self._patience = patience
        self._caller = Caller("camera")
        self._turn = threading.Lock()

    def connect(self) -> None:
        """Reaches the camera. Raises CameraError and its kinds."""
        self._call(self.camera.connect)

    def capture(self, newer_than: float) -> Frame:
        """A photograph taken after `newer_than` (s). Raises CameraError and its kinds."""
        with self._turn:
            frame = self._call(lambda: self.camera.capture(newer_than))
        if not _is_photograph(frame):
            raise CameraError(
                "What the camera handed out is no photograph (rows x columns x 3 bytes, a time and a number); "
                "look at the camera and its settings, then take another."
            )
        return frame

    def glance(self) -> NDArray[np.uint8] | None:
        """The picture that a live camera has now; None where it is none, or is being used. Raises CameraError."""
        if not isinstance(self.camera, LiveCamera) or not self._turn.acquire(blocking=False):
            return None
        try:
            return self._call(self.camera.glance)
        finally:
            self._turn.release()

    def close(self) -> None:
        """Lets go of the camera. Raises CameraError and its kinds."""
        try:
            self._call(self.camera.close)
        finally:
            self._caller.end()

    def _call(self, act: Callable[[], T]) -> T:
        until = steady() + self._patience
        return in_our_errors(
            lambda: self._caller.call(act, lambda: until),
            late=lambda: CameraError(
                f"The camera did not answer within {self._patience:g} s; look at it and at its cable, then take "
                "another photograph."
            ),
            failed=lambda why: CameraError(f"The camera's driver failed ({why}); look whether it is still connected."),
        )


def _is_photograph(frame: object) -> bool:
    return (
        isinstance(frame, Frame)
        and isinstance(frame.image, np.ndarray)
        and frame.image.dtype == np.uint8
        and frame.image.ndim == 3
        and frame.image.shape[2] == 3
        and frame.image.size > 0
        and isinstance(frame.captured_at, int | float)
        and math.isfinite(frame.captured_at)
        and isinstance(frame.sequence, int)
    )
