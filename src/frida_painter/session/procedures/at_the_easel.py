"""What procedures do at an easel: photograph it with the arm aside, and move, never out of the workspace."""

from collections.abc import Iterable

import numpy as np

from frida_painter.errors import PoseMismatch, StaleFrame
from frida_painter.hardware import limits
from frida_painter.hardware.camera import Frame
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.robot import Waypoints

_ATTEMPTS = 3
_ARRIVED = 0.002


def photograph(easel: Easel) -> Frame:
    """A photograph taken after the arm has gone aside. Raises StaleFrame where the camera gives none in three tries."""
    since = easel.robot.home().finished_at
    for _ in range(_ATTEMPTS):
        try:
            frame = easel.camera.capture(since)
        except StaleFrame:
            continue
        if frame.captured_at > since:
            return frame
    raise StaleFrame(
        f"The camera was asked {_ATTEMPTS} times and gave no photograph newer than the arm's last motion; "
        "look whether it is still connected, and repeat this calibration."
    )


def perform(easel: Easel, motions: Iterable[Waypoints], *, lowest: float | None = None) -> None:
    """Makes the motions one after another, once all of them are known to be allowed.

    lowest: robot z below which the tip does not go over the canvas, metres; the hardest press of the
    record where it is None. Raises WorkspaceViolation before anything moves, where a motion leaves the
    workspace, presses deeper or is out of the arm's reach; RobotError and PoseMismatch.
    """
    batch = list(motions)
    surface = limits.Surface(easel.canvas, easel.calibration.press_height if lowest is None else lowest)
    limits.check(batch, easel.workspace, surface, easel.reach)
    for motion in batch:
        report = easel.robot.follow(motion)
        away = float(np.linalg.norm(report.reached - motion.position[-1]))
        if not away <= _ARRIVED:
            raise PoseMismatch(
                f"{motion.label}: the robot says it is done, but its tip is {away * 1000:.1f} mm from where it was "
                f"sent; allowed are {_ARRIVED * 1000:g} mm. Look at the robot, then repeat this calibration."
            )
