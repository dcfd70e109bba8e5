"""The picture that a camera has now, in a file, about once a second: for people to watch what the robot does."""

import threading
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from frida_painter import storage
from frida_painter.errors import FridaError
from frida_painter.hardware.camera import LiveCamera
from frida_painter.hardware.guarded_camera import GuardedCamera

BETWEEN = 1.0
"""Seconds between two pictures."""
_WIDEST, _QUALITY = 960, 75


class LivePicture:
    """Keeps a JPEG of a live camera in `path` until it is dismissed; of another camera there is none.

    Nobody waits for it: a photograph that the painter takes comes first, and a picture that cannot be had, or not be
    written, is left out.
    """

    def __init__(self, camera: GuardedCamera, path: Path, between: float = BETWEEN) -> None:
        self._camera, self._path, self._between = camera, path, between
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True, name="live picture")
        if isinstance(camera.camera, LiveCamera):
            self._thread.start()

    def dismiss(self) -> None:
        """Ends it and removes the file."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join(2 * self._between)
        self._path.unlink(missing_ok=True)

    def _run(self) -> None:
        while not self._over.wait(self._between):
            try:
                picture = self._camera.glance()
                if picture is not None:
                    storage.write_bytes(self._path, encoded(picture))
            except FridaError:
                continue


def encoded(picture: NDArray[np.uint8]) -> bytes:
    """A picture [rows, columns, 3] sRGB as JPEG, at most 960 pixels wide."""
    share = min(1.0, _WIDEST / picture.shape[1])
    small = cv2.resize(picture, None, fx=share, fy=share, interpolation=cv2.INTER_AREA) if share < 1 else picture
    _, content = cv2.imencode(".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return content.tobytes()
