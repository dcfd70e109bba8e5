"""The camera kind `gphoto`: cameras over USB through libgphoto2, such as the Canon EOS Rebel T7 of the paper."""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from frida_painter import registry
from frida_painter.errors import CameraError, ConfigError, ImageError
from frida_painter.hardware.kinds import CameraKind, Needed
from frida_painter.hardware.robot import Frame
from frida_painter_drivers.cameras.shutter import Shutter

Answer = TypeVar("Answer")

_NEEDED = Needed(module="gphoto2", extra="gphoto")
_OPENING, _EXPOSING = 15.0, 25.0


class GphotoCamera:
    """Camera over libgphoto2: the first one found. Implements hardware.robot.Camera. Pictures stay on its card."""

    def __init__(self) -> None:
        self._shutter = Shutter("the camera at gphoto2")
        self._library: Any = None
        self._camera: Any = None

    def connect(self) -> None:
        """Connects to the camera. Raises CameraError if it fails; the message says what to install or to switch on."""
        self.close()
        with registry.importing("gphoto", "A camera over gphoto2", CameraError):
            import gphoto2
        self._library = gphoto2
        camera = gphoto2.Camera()
        self._asking("connect", camera.init, _OPENING)
        self._camera = camera
        self._shutter.mark_connected()

    def capture(self, newer_than: float) -> Frame:
        """Takes and downloads a photograph. Raises CameraError, or StaleFrame if it is not newer than `newer_than`."""
        self._shutter.require_open()
        asked = time.monotonic()
        image = self._asking("photograph", self._take, _EXPOSING)
        return self._shutter.frame(image, asked, newer_than)

    def close(self) -> None:
        """Disconnects the camera. Raises CameraError if the library fails."""
        camera, self._camera = self._camera, None
        self._shutter.mark_disconnected()
        if camera is not None:
            self._asking("close", camera.exit, _OPENING)

    def _take(self) -> Any:
        """Takes a photograph and returns it upright, in sRGB bytes."""
        from frida_painter import (
            images,
        )  # not at module level: listing the camera kinds must not load the picture libraries

        library, camera = self._library, self._camera
        place = camera.capture(library.GP_CAPTURE_IMAGE)
        picture = camera.file_get(place.folder, place.name, library.GP_FILE_TYPE_NORMAL)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "photograph"
            picture.save(str(path))
            try:
                return images.to_uint8(images.load(path))
            except ImageError as error:
                raise CameraError(
                    f"The camera took {place.name!r}, which is no picture that can be read; set it to JPEG. ({error})"
                ) from error

    def _asking(self, what: str, call: Callable[[], Answer], seconds: float) -> Answer:
        try:
            return self._shutter.asking(what, call, seconds)
        except CameraError as error:
            code = getattr(error.__cause__, "code", None)
            advice = _ADVICE.get(code) if isinstance(code, int) else None
            if advice is None:
                raise
            raise CameraError(f"{what}: {advice} (gphoto2 says {error.__cause__}).") from error


_ADVICE = {
    -105: "no camera was found over USB; switch it on, wake it up, and look at its cable",
    -53: "another program has the camera, often the desktop's file manager; eject it there",
    -60: "the camera is locked, out of focus or full; set it to manual focus and look at its card",
    -110: "the camera is busy; wait a moment and try again",
    -1: "the camera reported an error; set it to manual focus, and switch it off and on",
}
"""Advice for those error codes of libgphoto2 that a person can remedy."""


def _open(where: str) -> GphotoCamera:
    if where:
        raise ConfigError(f"'gphoto' was given {where[:40]!r}, and it takes the one camera at USB; write gphoto.")
    return GphotoCamera()


KIND = CameraKind("gphoto", "gphoto", "a camera over USB that libgphoto2 knows", open=_open, needed=_NEEDED)
