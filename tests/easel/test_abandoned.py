"""The easel's process is killed in the middle of a motion: the machine is held all the same, and stays latched."""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import NO_CAMERA
from frida_painter.easel.order import EaselOrder
from frida_painter.easel.parent import EaselProcess
from frida_painter.errors import RobotAbandoned, RobotStopped
from frida_painter.hardware.drivers.gcode import GcodeRobot
from frida_painter.hardware.gcode import Gcode
from frida_painter.hardware.latch import latches
from frida_painter.hardware.robot import Waypoints
from frida_painter.hardware.workcell import example
from machines.bench import tell_zero
from machines.ebb import Ebb
from machines.grbl import GRBL, QUICK, GrblController
from machines.marlin import Build, MarlinController
from machines.simulated_time import Living
from machines.xarm_box import XarmBox, use_ports
from session.easel_errands import until

pytestmark = pytest.mark.slow

SIZE = CanvasSize(0.14, 0.1)
ARM_SIZE = example().replace("width = 0.3556", "width = 0.14").replace("height = 0.2794", "height = 0.1")
PLOTTER = """
easel = "a plotter"
[bounds]
lower = [0.0, -0.25, -0.002]
upper = [0.3, 0.0, 0.010]
[canvas]
width = 0.14
height = 0.1
corner = [0.1, -0.15, 0.0]
turn = 0.0
[brush]
touch_height = 0.0
press_height = -0.002
[paint]
wells = [[0.03, -0.05, -0.001], [0.06, -0.05, -0.001]]
water = [0.03, -0.10, -0.001]
rag = [0.05, -0.15, 0.0]
rag_width = 0.04
[motion]
hover = 0.006
painting_speed = 0.06
travel_speed = 0.15
home = [0.0, 0.0, 0.010]
"""


class Played:
    """A machine that lives in real time: its name, its workspace, the place of its tip (m), and what stopped it."""

    def __init__(self, name: str, workspace: str, tip: Callable[[], Any], heard: Callable[[], bool]) -> None:
        self.name, self.workspace, self.tip, self.heard = name, workspace, tip, heard


@contextmanager
def grbl() -> Iterator[Played]:
    controller = GrblController(GRBL, QUICK)
    with Living(controller, pace=1.0) as living:
        tell_zero(Gcode("grbl"), living.name, (0.1, -0.25, 0.25))
        yield Played(
            f"gcode:{living.name}", ARM_SIZE, lambda: controller.tip / 1000, lambda: "!" in controller.received
        )


@contextmanager
def marlin() -> Iterator[Played]:
    wide = Build(lowest=(-1000.0, -1000.0, -1000.0), highest=(1000.0, 1000.0, 1000.0))
    controller = MarlinController(wide)
    with Living(controller, pace=1.0) as living:
        tell_zero(Gcode("marlin"), living.name, (0.1, -0.25, 0.25))
        yield Played(
            f"marlin:{living.name}", ARM_SIZE, lambda: controller.tip / 1000, lambda: "M410" in controller.received
        )


@contextmanager
def xarm() -> Iterator[Played]:
    with XarmBox(pace=1.0) as box, pytest.MonkeyPatch.context() as patch:
        box.pose[:3] = (100.0, -250.0, 250.0)
        use_ports(box, patch)
        yield Played("xarm:127.0.0.1", ARM_SIZE, lambda: box.pose[:3] / 1000, lambda: box.state == 4)


MACHINES = {"grbl": grbl, "marlin": marlin, "xarm": xarm}


def order_of(played: Played, folder: Path) -> EaselOrder:
    (folder / "painting").mkdir(exist_ok=True)
    (folder / "easel.toml").write_text(played.workspace)
    return EaselOrder(
        played.name,
        SIZE,
        ("fine",),
        0,
        folder / "state",
        folder / "painting",
        workspace=folder / "easel.toml",
        camera=NO_CAMERA,
    )


def kill_in_motion(played: Played, order: EaselOrder) -> tuple[RobotAbandoned, float, float]:
    """Returns the error, the seconds from the kill until the machine was stopped, and metres that it went after it."""
    with pytest.raises(RobotAbandoned) as lost, EaselProcess() as process:
        easel = process.open(order)
        easel.robot.connect()
        corner = np.array([*easel.workspace.canvas_origin[:2], easel.workspace.top + easel.workspace.hover])
        easel.robot.follow(Waypoints("there", corner[None], 0.2))
        across = corner + np.linspace(0, 0.12, 121)[:, None] * (1, 0, 0)
        start = played.tip().copy()
        killed: list[tuple[float, np.ndarray]] = []

        def kill() -> None:
            until(lambda: played.tip()[0] > start[0] + 0.03)
            killed.append((time.monotonic(), played.tip().copy()))
            os.kill(process._process.pid, signal.SIGKILL)

        threading.Thread(target=kill).start()
        easel.robot.follow(Waypoints("across", across, 0.05))
    at, there = killed[0]
    heard = None
    still_since, before = time.monotonic(), played.tip().copy()
    while time.monotonic() < still_since + 0.3 or heard is None:
        if heard is None and played.heard():
            heard = time.monotonic()
        now = played.tip().copy()
        if not np.allclose(now, before, atol=1e-6):
            still_since, before = time.monotonic(), now
        assert time.monotonic() < at + 20
        time.sleep(0.005)
    print(played.name, lost.value, still_since - at, np.linalg.norm(before - there))
    return lost.value, still_since - at, float(np.linalg.norm(before - there))


@pytest.mark.parametrize("machine", MACHINES.values(), ids=MACHINES)
def test_a_machine_whose_easels_process_was_killed_is_held_and_latched(
    tmp_path: Path, machine: Callable[[], AbstractContextManager[Played]]
) -> None:
    with machine() as played:
        order = order_of(played, tmp_path)
        error, _, gone = kill_in_motion(played, order)
        assert (error.held, error.latched) == (True, True)
        with EaselProcess() as process, pytest.raises(RobotStopped):
            process.open(order)
        (latch,) = latches(order.state)
        latch.release()
        with EaselProcess() as process:  # its port is free, and it kept its place
            easel = process.open(order)
            easel.robot.connect()
            assert easel.robot.pose().shape == (3,)
