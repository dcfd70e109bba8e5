"""`rpicam`: the camera of a Raspberry Pi, through the program rpicam-still."""

import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import frida_painter as fp
from frida_painter.plugins import CameraError, CameraKind, ConfigError, Frame, Shutter

_SECONDS = 20.0


class RpiCamera:
    """Implements hardware.camera.Camera. number: which of the cameras of the Raspberry Pi."""

    def __init__(self, number: int) -> None:
        self._number = number
        self._shutter = Shutter(f"the Raspberry Pi's camera {number}")  # numbers photographs, refuses one twice

    def connect(self) -> None:
        """Takes one photograph to see whether it works. Raises CameraError."""
        self._shutter.mark_connected()
        try:
            self.capture(newer_than=float("-inf"))
        except CameraError:
            self._shutter.mark_disconnected()
            raise
        self._shutter.mark_connected()

    def capture(self, newer_than: float) -> Frame:
        """A photograph that was exposed after this was called. Raises CameraError, StaleFrame."""
        self._shutter.require_open()
        asked = time.monotonic()
        return self._shutter.frame(self._shutter.asking("photograph", self._taken, _SECONDS), asked, newer_than)

    def close(self) -> None:
        """Nothing stays open between two photographs."""
        self._shutter.mark_disconnected()

    def _taken(self) -> NDArray[np.uint8]:
        """Upright, [rows, columns, 3] sRGB."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "photograph.png"
            command = ["rpicam-still", "--camera", str(self._number), "--nopreview", "--encoding", "png", "-o", path]
            try:
                subprocess.run(command, check=True, capture_output=True, timeout=_SECONDS)
            except (OSError, subprocess.SubprocessError) as error:
                raise CameraError(f"rpicam-still took no photograph ({error}); try it in a terminal.") from error
            return (fp.load_picture(path) * 255).round().byte().permute(1, 2, 0).numpy()


def _open(where: str) -> RpiCamera:
    if not (where.isascii() and (where.isdigit() or not where)):
        raise ConfigError(f"rpicam was given {where[:40]!r}; write rpicam, or rpicam:NUMBER for the others.")
    return RpiCamera(int(where or 0))


KIND = CameraKind("rpicam", "rpicam[:NUMBER]", "the camera of a Raspberry Pi", open=_open)
