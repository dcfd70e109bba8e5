"""Where the simulated Sawyer gets, asked before anything moves."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import RobotError
from frida_painter.frames import CanvasSize
from frida_painter.hardware.workspace import Workspace
from frida_painter.virtual.sawyer.arm import MISSING

if TYPE_CHECKING:
    from frida_painter.virtual.sawyer.kinematics import Kinematics

# Places in one cube of this side (m) are answered alike: strokes lie thick on a canvas.
_CUBE = 0.005


class SawyerReach:
    """Implements hardware.reach.Reach by inverse kinematics: the tip there, the brush upright, nothing touched."""

    def __init__(self, workspace: Workspace, canvas: CanvasSize) -> None:
        self._workspace, self._canvas = workspace, canvas
        self._kinematics: Kinematics | None = None
        self._answers: dict[tuple[int, ...], bool] = {}

    def reachable(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the tip can be at each place [k, 3], metres: [k]. Raises RobotError where MuJoCo is not installed."""
        if not np.isfinite(position).all():
            return np.isfinite(position).all(1) & self.reachable(np.nan_to_num(position, posinf=0.0, neginf=0.0))
        cubes = np.round(position / _CUBE).astype(int)
        return np.array([self._answer((*cube.tolist(),)) for cube in cubes], bool)

    def _answer(self, cube: tuple[int, ...]) -> bool:
        if cube not in self._answers:
            place, kinematics = np.array(cube) * _CUBE, self._known()
            angles = kinematics.posture(place)
            self._answers[cube] = kinematics.hindrance(angles[None], place[None], 1.0) is None
        return self._answers[cube]

    def _known(self) -> "Kinematics":
        if self._kinematics is None:
            try:
                from frida_painter.virtual.sawyer.kinematics import Kinematics
                from frida_painter.virtual.sawyer.surroundings import Surroundings
            except ImportError as cause:
                raise RobotError(MISSING) from cause
            self._kinematics = Kinematics(Surroundings(self._workspace, self._canvas).model())
        return self._kinematics
