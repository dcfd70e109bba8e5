"""What every camera can do: give a photograph that is newer than a given moment."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Frame:
    """A photograph: image [rows, columns, 3] uint8 sRGB, when it was taken (s, the robot's clock), its number."""

    image: NDArray[np.uint8]
    captured_at: float
    sequence: int


class Camera(Protocol):
    """A driver. Raises CameraError and its kinds."""

    def connect(self) -> None:
        """Reaches the camera; a failed attempt leaves nothing open and may be repeated."""

    def capture(self, newer_than: float) -> Frame:
        """A photograph taken after `newer_than` (s). Raises StaleFrame where there is none."""

    def close(self) -> None:
        """Lets go of the camera."""


@runtime_checkable
class LiveCamera(Camera, Protocol):
    """A camera that always has a picture, like a webcam, for people to watch."""

    def glance(self) -> NDArray[np.uint8]:
        """The picture that it has now, [rows, columns, 3] sRGB; nothing is decided by it. Raises CameraError."""
