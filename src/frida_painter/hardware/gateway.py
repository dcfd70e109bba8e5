"""The one way to the robot: painting, calibration and stroke libraries move it through a gateway."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import PoseMismatch
from frida_painter.hardware import limits
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.robot import MotionReport, Waypoints

_ARRIVED = 0.002


class RobotGateway:
    """Checks motions as a whole, sends them one after another, and compares where the tip arrived.

    lowest: robot z (m) below which the tip does not go over the canvas, the hardest press of the
    easel's record where it is None; the brush procedure, which finds that press, gives the floor of
    the workspace. last_motion: when the robot last moved, s of its clock.

    Every wait for a motion has a deadline, which is kept where the wait is: the guard in the easel's
    process gives up a driver (hardware/guard.py), and the link gives up that process
    (hardware/link/remote.py); both raise RobotDisconnected. A person who paints by hand may take any
    time, and so may the virtual studio where an experiment opens it without a process of its own.
    """

    def __init__(self, easel: Easel, *, lowest: float | None = None) -> None:
        self.easel = easel
        self.last_motion = 0.0
        self._calibrated = easel.calibration.press_height if lowest is None else lowest
        self._surface = limits.Surface(easel.canvas, self._calibrated)

    def follow_touch(self, lower: float) -> None:
        """From now on the tip goes `lower` metres lower than the hardest press; not higher where that is below 0."""
        self._surface = limits.Surface(self.easel.canvas, self._calibrated - max(lower, 0.0))

    def check(self, motions: Iterable[Waypoints]) -> None:
        """Raises WorkspaceViolation unless every motion of the batch is allowed; nothing is clamped.

        A motion is refused where a number of it is NaN, it leaves the workspace, is faster than 1 m/s,
        goes over the canvas below the hardest press, or is out of the arm's reach.
        """
        limits.check(motions, self.easel.workspace, self._surface, self.easel.reach)

    def perform(self, motions: Iterable[Waypoints]) -> bool:
        """Makes the motions, once all of them are allowed; whether a person who paints by hand left one out.

        Raises WorkspaceViolation before anything moves, as `check` does; PoseMismatch where the tip
        arrives more than 2 mm from where it was sent, and then sends nothing more; RobotError and its kinds.
        """
        batch = list(motions)
        self.check(batch)
        left_out = False
        for motion in batch:
            report = self._done(self.easel.robot.follow(motion))
            _require_arrived(motion.label, report.reached, motion.position[-1])
            left_out |= report.left_out
        return left_out

    def step_aside(self) -> None:
        """Moves the arm out of the camera's sight.

        Raises PoseMismatch where the tip ends more than 2 mm from the workspace's home, or outside the
        workspace where that names none; RobotError and its kinds.
        """
        report = self._done(self.easel.robot.home())
        workspace = self.easel.workspace
        inside = np.minimum(np.maximum(report.reached, workspace.lower), workspace.upper)  # NaN stays NaN
        _require_arrived("home", report.reached, inside if workspace.home is None else np.array(workspace.home))

    def pose(self) -> NDArray[np.float64]:
        """Where the tip is, [3] metres. Raises RobotError where the robot does not know."""
        return self.easel.robot.pose()

    def _done(self, report: MotionReport) -> MotionReport:
        self.last_motion = report.finished_at
        return report


def _require_arrived(label: str, reached: NDArray[np.float64], sent: NDArray[np.float64]) -> None:
    away = float(np.linalg.norm(reached - sent))
    if not away <= _ARRIVED:
        raise PoseMismatch(
            f"{label}: the robot says it is done, but its tip is {away * 1000:.1f} mm from where it was sent; "
            f"allowed are {_ARRIVED * 1000:g} mm. Look at the robot, then repeat the robot calibration."
        )
