"""An arm that a person guides by hand: its tip is recorded, and it stays stopped until somebody arms it again.

The stop is stored before the arm is released. So it holds even if this process is killed in between.
"""

import time
from collections.abc import Callable
from contextlib import ExitStack

import numpy as np
from numpy.typing import NDArray

from frida_painter.easel.kinds import state_folder
from frida_painter.easel.lock import hold_machines
from frida_painter.easel.open import machines, make_robot
from frida_painter.easel.order import EaselOrder
from frida_painter.errors import ConfigError, RobotStopped
from frida_painter.hardware.latch import HOW_TO_ARM, latch_of
from frida_painter.hardware.robot import GuidedRobot
from frida_painter.hardware.workcell import WorkcellConfig

GUIDED_RATE = 50
"""Samples of the tip per second, at most."""
_LONGEST = 3600.0  # seconds


def guide_arm(
    name: str,
    workcell: WorkcellConfig,
    hear: Callable[[NDArray[np.float64], float], None],
    ended: Callable[[], bool],
) -> None:
    """Releases a named arm, and tells where its tip is until `ended`, or for an hour.

    hear: receives the tip [3] in metres of the robot's frame, and the seconds since the release
    ended: asked after every sample

    The arm holds its place afterwards, also after an error, and is stopped until a person arms it.
    Raises ConfigError if the robot cannot be guided, RobotBusy if another process uses it, RobotStopped if it is
    stopped, RobotError and its subclasses.
    """
    driver = make_robot(name, workcell.workspace)
    if not isinstance(driver, GuidedRobot):
        raise ConfigError(
            f"{name[:60]!r} cannot be guided by hand; xarm and franka can. Of another robot, record trajectories into "
            "a folder of .json or .csv files, and teach that folder."
        )
    order = EaselOrder(name, workcell.canvas, ("broad",), 0, state_folder())
    known = machines(order)
    with ExitStack() as stack:
        hold_machines(stack, order.state, known)
        latch = latch_of(order.state, workcell.easel, known)
        if (stopped := latch.read()) is not None:
            raise RobotStopped(f"{stopped}. It is not released before somebody has looked: {HOW_TO_ARM}")
        latch.engage("it was released to be guided by hand")
        stack.callback(driver.end_guiding)
        driver.begin_guiding()
        began = time.monotonic()
        now, due = 0.0, 0.0
        while now < _LONGEST:
            hear(driver.guided_tip(), now)
            if ended():
                return
            due = max(due + 1 / GUIDED_RATE, now)
            now = time.monotonic() - began
            time.sleep(max(0.0, due - now))
            now = time.monotonic() - began
