"""The camera kind `opencv`: cameras that OpenCV can open, mainly webcams and V4L2 devices."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import CameraError
from frida_painter.hardware.kinds import CameraKind
from frida_painter.hardware.robot import Frame
from frida_painter_drivers.cameras.shutter import Shutter

_BUFFERED = 5
"""Number of old frames that a driver may have in its buffer; V4L2 has four."""
_OPENING, _LOOKING = 10.0, 5.0


@dataclass(frozen=True)
class OpencvSettings:
    """Settings of an OpenCV camera.

    device: number, path or address of the camera
    size: (columns, rows) of a frame; None for the camera's largest
    """

    device: int | str = 0
    size: tuple[int, int] | None = None


class OpencvCamera:
    """Camera through OpenCV. Implements hardware.robot.LiveCamera. Frames have the largest size or the set one."""

    def __init__(self, settings: OpencvSettings | None = None) -> None:
        self.settings = settings or OpencvSettings()
        self._shutter = Shutter(f"camera {self.settings.device!r}")
        self._device: Any = None

    def connect(self) -> None:
        """Opens the device and takes one test photograph. Raises CameraError."""
        self.close()
        device = self._shutter.asking("connect", self._open_device, _OPENING)
        self._device = device
        self._shutter.mark_connected()
        try:
            self.capture(newer_than=float("-inf"))
        except CameraError:
            self.close()
            raise
        self._shutter.mark_connected()

    def capture(self, newer_than: float) -> Frame:
        """Returns a photograph that was exposed after the call. Raises CameraError, StaleFrame."""
        self._shutter.require_open()
        asked = time.monotonic()
        image = self._shutter.asking("photograph", self._read_frame, _LOOKING)
        return self._shutter.frame(image, asked, newer_than)

    def glance(self) -> NDArray[np.uint8]:
        """Returns the device's current frame [rows, columns, 3], possibly a buffered one. Raises CameraError."""
        import cv2

        self._shutter.require_open()
        seen, image = self._device.read()
        if not seen or not isinstance(image, np.ndarray):
            raise CameraError(f"{self._shutter.name} gives no picture any more; look at it and at its cable.")
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)

    def close(self) -> None:
        """Closes the device. Raises CameraError if the library fails."""
        device, self._device = self._device, None
        self._shutter.mark_disconnected()
        if device is not None:
            self._shutter.asking("close", device.release, _LOOKING)

    def _open_device(self) -> Any:
        import cv2

        device = cv2.VideoCapture(self.settings.device)
        if not device.isOpened():
            device.release()
            raise CameraError(
                f"There is no camera {self.settings.device!r}, or another program uses it; plug it in, close the "
                "other program, or give another number."
            )
        columns, rows = self.settings.size or (10_000, 10_000)  # The camera takes the nearest size that it has.
        device.set(cv2.CAP_PROP_FRAME_WIDTH, columns)
        device.set(cv2.CAP_PROP_FRAME_HEIGHT, rows)
        return device

    def _read_frame(self) -> Any:
        """Discards the buffered frames and returns the next one, RGB."""
        import cv2

        for _ in range(_BUFFERED):
            self._device.grab()
        seen, image = self._device.read()
        if not seen or image is None:
            raise CameraError(f"{self._shutter.name} gives no picture any more; look at it and at its cable.")
        return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def _open(where: str) -> OpencvCamera:
    return OpencvCamera(OpencvSettings(int(where) if where.isdigit() else where or 0))


KIND = CameraKind("opencv", "opencv:NUMBER", "webcams and whatever OpenCV opens", open=_open)
