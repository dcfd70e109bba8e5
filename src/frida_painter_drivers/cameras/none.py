"""The camera kind `none`: an easel that nobody watches; its plan is painted as it is, without looks."""

from typing import NoReturn

from frida_painter.errors import CameraError, ConfigError
from frida_painter.hardware.kinds import CameraKind


class NoCamera:
    """Stand-in for a camera; implements hardware.robot.Camera. A session without a camera never asks it."""

    def connect(self) -> None:
        """Does nothing: there is nothing to connect."""

    def capture(self, newer_than: float) -> NoReturn:
        """Raises CameraError: there is no camera."""
        raise CameraError(
            "This easel has no camera (--camera none), and a photograph of the canvas is needed here; name a camera, "
            "such as --camera folder:PATH for pictures from a telephone."
        )

    def close(self) -> None:
        """Does nothing: there is nothing to disconnect."""


def _open(where: str) -> NoCamera:
    if where:
        raise ConfigError(f"'none' is no camera, and has no place {where[:40]!r}; write --camera none.")
    return NoCamera()


KIND = CameraKind("none", "none", "no camera: the plan is painted as it is, and nobody looks", open=_open)
