"""Parts that all cameras share: deadlines, typed errors, and the rejection of repeated photographs."""

import hashlib
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import CameraError, StaleFrame
from frida_painter.hardware.deadline import in_our_errors, within
from frida_painter.hardware.robot import Frame

Answer = TypeVar("Answer")


class Shutter:
    """Guard of one camera: numbers its photographs and recognises repeated ones.

    name: of the camera, in messages

    After a call that did not return, it refuses everything until the camera is connected again.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._taken = 0
        self._known: set[bytes] = set()
        self._open = self._stuck = False

    def mark_connected(self) -> None:
        """Marks the camera as connected and forgets earlier photographs."""
        self._open, self._stuck, self._known = True, False, set()

    def mark_disconnected(self) -> None:
        """Marks the camera as disconnected."""
        self._open = False

    def require_open(self) -> None:
        """Raises CameraError if the camera is not connected, or if an earlier call into its library never returned."""
        if not self._open:
            raise CameraError(f"{self.name} is not connected; call connect() first.")
        if self._stuck:
            raise CameraError(
                f"{self.name} did not answer the last time; look at it, then close it and connect it anew."
            )

    def asking(self, what: str, call: Callable[[], Answer], seconds: float) -> Answer:
        """Returns the result of a call into a library. Raises CameraError if it fails or exceeds `seconds`."""

        def silent() -> CameraError:
            self._stuck = True
            return CameraError(
                f"{what}: {self.name} did not answer within {seconds:.0f} s; look at it and at its cable."
            )

        return in_our_errors(
            lambda: within(seconds, f"{self.name}: {what}", call),
            late=silent,
            failed=lambda why: CameraError(f"{what}: {self.name} failed ({why}); look at it."),
        )

    def knows(self, image: NDArray[np.uint8]) -> bool:
        """Returns True if an earlier photograph has the same pixels; no real camera takes one twice."""
        return _digest(image) in self._known

    def frame(self, image: object, captured_at: float, newer_than: float) -> Frame:
        """Returns the photograph [rows, columns, 3] as a frame with the next number.

        Raises StaleFrame if it was taken at `newer_than` or before, or was given before.
        Raises CameraError if `image` is no photograph.
        """
        if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
            given = f"{image.dtype} of shape {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
            raise CameraError(f"{self.name} gave {given} for a photograph; look whether it is set to colour pictures.")
        if image.size == 0:
            raise CameraError(f"{self.name} gave a photograph without any pixels; look at it.")
        if not captured_at > newer_than:
            raise StaleFrame(
                f"{self.name} has a photograph that is {time.monotonic() - captured_at:.1f} s old, taken before the "
                "arm's last motion; take another."
            )
        if self.knows(image):
            raise StaleFrame(f"{self.name} gave the same photograph again, byte for byte; look whether it hangs.")
        self._taken += 1
        self._known.add(_digest(image))
        return Frame(np.ascontiguousarray(image), captured_at, self._taken)


def _digest(image: NDArray[np.uint8]) -> bytes:
    return hashlib.blake2b(repr(image.shape).encode() + image.tobytes(), digest_size=16).digest()
