"""Settings of a Franka arm, with the ranges that they are checked against, and the posture of its hand.

The driver (franka.py) reads them.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import ConfigError
from frida_painter.hardware.kinds import MachineName, require_home
from frida_painter.hardware.robot import Point, Workspace
from frida_painter_drivers.franka_kinematics import make_upright


@dataclass(frozen=True)
class FrankaSettings:
    """Settings of a Franka arm.

    address: of the control cabinet or of the arm's base
    home: home position of the tip, metres
    approach: m/s to the first waypoint
    brush_length: from the arm's tool frame to the brush's tip along the tool, metres
    turn: of the hand about the vertical, degrees; 0 as in the arm's usual start posture
    acceleration: m/s2 of the tip
    force: N and Nm on the arm above which it stops by reflex
    touch_force: N on the brush that count as a touch

    Raises ConfigError if a value is out of range.
    """

    address: str
    home: Point
    approach: float = 0.15
    brush_length: float = 0.0
    turn: float = 0.0
    acceleration: float = 0.5
    force: float = 20.0
    touch_force: float = 1.5

    def __post_init__(self) -> None:
        if not (0 < self.approach <= 1 and 0 <= self.brush_length <= 1 and -180 <= self.turn <= 180):
            raise ConfigError(
                f"A Franka was given an approach of {self.approach} m/s, a brush of {self.brush_length} m and a turn "
                f"of {self.turn} degrees; they are above 0 to 1 m/s, 0 to 1 m and -180 to 180 degrees."
            )
        if not (0 < self.acceleration <= 5 and 5 <= self.force <= 100 and 0.2 <= self.touch_force <= 10):
            raise ConfigError(
                f"A Franka was given an acceleration of {self.acceleration} m/s2, a force of {self.force} N and a "
                f"touch force of {self.touch_force} N; they are above 0 to 5 m/s2, 5 to 100 N and 0.2 to 10 N."
            )

    @classmethod
    def of(cls, name: MachineName, workspace: Workspace) -> Self:
        """Returns the settings that a robot's name holds, in a workspace. Raises ConfigError."""
        name.require("brush_length", "turn", "force", "touch_force")
        return cls(
            name.where,
            require_home(name, workspace),
            workspace.travel_speed,
            name.choose("brush_length", float, 0.0),
            name.choose("turn", float, 0.0),
            force=name.choose("force", float, 20.0),
            touch_force=name.choose("touch_force", float, 1.5),
        )

    @property
    def upright(self) -> NDArray[np.float64]:
        """Rotation of the tool [3, 3] in the arm's frame with the brush pointing straight down."""
        return make_upright(self.turn)
