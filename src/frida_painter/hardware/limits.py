"""The limits of the workspace: a batch of motions is allowed as a whole, or nothing of it is sent.

Nothing is clamped. The checks are written so that NaN fails them.
"""

from collections.abc import Iterable

import numpy as np

from frida_painter.errors import WorkspaceViolation
from frida_painter.hardware.robot import Waypoints
from frida_painter.hardware.workspace import Workspace

FASTEST = 1.0
_TOLERANCE = 1e-6


def check(batch: Iterable[Waypoints], workspace: Workspace) -> None:
    """Raises WorkspaceViolation, naming the motion and the axis, unless every waypoint lies in the workspace."""
    lower, upper = np.array(workspace.lower) - _TOLERANCE, np.array(workspace.upper) + _TOLERANCE
    for waypoints in batch:
        if waypoints.position.ndim != 2 or waypoints.position.shape[1] != 3 or len(waypoints.position) == 0:
            raise WorkspaceViolation(
                f"{waypoints.label}: waypoints of shape {waypoints.position.shape} were planned; "
                "one or more (x, y, z) are needed. Nothing was sent to the robot."
            )
        if not 0 < waypoints.speed <= FASTEST:
            raise WorkspaceViolation(
                f"{waypoints.label}: a speed of {waypoints.speed} m/s was planned; allowed is above 0 to "
                f"{FASTEST} m/s. Nothing was sent to the robot."
            )
        inside = (waypoints.position >= lower) & (waypoints.position <= upper)
        if not inside.all():
            point, axis = np.argwhere(~inside)[0]
            raise WorkspaceViolation(
                f"{waypoints.label}: {'xyz'[axis]} = {waypoints.position[point, axis]:.4f} m at waypoint {point}; "
                f"the workspace reaches from {workspace.lower[axis]:.4f} to {workspace.upper[axis]:.4f} m. "
                "Nothing was sent to the robot; move the canvas into reach or make the workspace true."
            )
