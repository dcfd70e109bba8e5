"""What procedures do at an easel: move the robot, and photograph with the arm aside."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from frida_painter.hardware.camera import Frame
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gateway import RobotGateway
from frida_painter.hardware.robot import Waypoints
from frida_painter.session.canvas_observer import Photographer


class EaselAccess:
    """One procedure's access to an easel: one gateway to its robot, and one memory of what its camera gave.

    lowest: see RobotGateway; only the brush procedure gives it.
    """

    def __init__(self, easel: Easel, *, lowest: float | None = None) -> None:
        self.easel = easel
        self._gateway = RobotGateway(easel, lowest=lowest)
        self._photographer = Photographer(easel.camera)

    def photograph(self) -> Frame:
        """A photograph taken after the arm has gone aside. Raises RobotError, CameraError and their kinds."""
        self._gateway.step_aside()
        return self._photographer.photograph(self._gateway.last_motion)

    def perform(self, motions: Iterable[Waypoints]) -> None:
        """Makes the motions, checked as one batch. Raises WorkspaceViolation before anything moves, RobotError."""
        self._gateway.perform(motions)

    def step_aside(self) -> None:
        """Moves the arm out of the camera's sight. Raises RobotError."""
        self._gateway.step_aside()

    def pose(self) -> NDArray[np.float64]:
        """Where the tip is, [3] metres. Raises RobotError."""
        return self._gateway.pose()
