"""The easel's process is killed in the middle of a motion: the machine is held all the same, and stays latched."""

import os
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import NO_CAMERA
from frida_painter.easel.order import EaselOrder
from frida_painter.easel.parent import EaselProcess
from frida_painter.errors import RobotAbandoned, RobotDisconnected, RobotStopped
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gcode import Gcode
from frida_painter.hardware.latch import latches
from frida_painter.hardware.robot import Waypoints
from frida_painter.hardware.workcell import example
from frida_painter_drivers.axidraw import AxidrawRobot, AxidrawSettings
from frida_painter_drivers.gcode import GcodeRobot
from machines.bench import tell_zero
from machines.ebb import Ebb
from machines.grbl import GRBL, QUICK, GrblController
from machines.marlin import Build, MarlinController
from machines.simulated_time import Living
from machines.xarm_box import XarmBox, use_ports
from session.easel_errands import kill, until
from support.plotter import PLOTTER

SIZE = CanvasSize(0.14, 0.1)
ARM_SIZE = example().replace("width = 0.3556", "width = 0.14").replace("height = 0.2794", "height = 0.1")


@dataclass(frozen=True)
class Played:
    """A machine that lives in real time: its name, its workspace, the place of its tip (m), and what stopped it."""

    name: str
    workspace: str
    tip: Callable[[], Any]
    heard: Callable[[], bool]


@contextmanager
def _firmware(kind: str, flavour: str, controller: Any, stop: str) -> Iterator[Played]:
    with Living(controller, pace=1.0) as living:
        tell_zero(Gcode(flavour), living.name, (0.1, -0.25, 0.25))
        heard = lambda: stop in controller.received  # noqa: E731
        yield Played(f"{kind}:{living.name}", ARM_SIZE, lambda: controller.tip / 1000, heard)


def grbl() -> AbstractContextManager[Played]:
    return _firmware("gcode", "grbl", GrblController(GRBL, QUICK), "!")


def marlin() -> AbstractContextManager[Played]:
    wide = Build(lowest=(-1000.0, -1000.0, -1000.0), highest=(1000.0, 1000.0, 1000.0))
    return _firmware("marlin", "marlin", MarlinController(wide), "M410")


@contextmanager
def xarm() -> Iterator[Played]:
    with XarmBox(pace=1.0) as box, pytest.MonkeyPatch.context() as patch:
        box.pose[:3] = (100.0, -250.0, 250.0)
        use_ports(box, patch)
        yield Played("xarm:127.0.0.1", ARM_SIZE, lambda: box.pose[:3] / 1000, lambda: box.state == 4)


@contextmanager
def plotter() -> Iterator[Played]:
    class Kept(Ebb):
        stopped = False

        def _obey(self, name: str, values: list[str]) -> None:
            Kept.stopped = Kept.stopped or name == "ES"
            super()._obey(name, values)

    with tempfile.TemporaryDirectory() as folder, Kept(Path(folder) / "plotter", pace=1.0) as board:
        with_zero = AxidrawRobot(AxidrawSettings((0.0, 0.0, 0.01), str(board.port)))
        with_zero.connect()
        with_zero.set_zero(np.zeros(3))
        with_zero.follow(
            Waypoints("away", np.array([[0.002, -0.002, 0.01]]), 0.05)
        )  # another program leaves it at zero
        with_zero.close()
        Kept.stopped = False

        def tip() -> np.ndarray:
            first, second = board.count
            return np.array([first + second, second - first, 0.0]) / 160_000

        yield Played(f"axidraw:{board.port}", PLOTTER, tip, lambda: Kept.stopped)


MACHINES = {"grbl": grbl, "marlin": marlin, "plotter": plotter, "xarm": xarm}


def order_of(played: Played, folder: Path) -> EaselOrder:
    (folder / "painting").mkdir(exist_ok=True)
    (folder / "easel.toml").write_text(played.workspace)
    return EaselOrder(
        played.name,
        SIZE,
        ("fine",),
        folder / "state",
        folder / "painting",
        workspace=folder / "easel.toml",
        camera=NO_CAMERA,
    )


@contextmanager
def in_motion(easel: Easel, played: Played, act: Callable[[], object]) -> Iterator[None]:
    """Sends the robot across the canvas, and acts after 3 cm of the way."""
    corner = np.array([*easel.workspace.canvas_origin[:2], easel.workspace.top + easel.workspace.hover])
    easel.robot.follow(Waypoints("there", corner[None], 0.15))
    start = played.tip().copy()

    def watch() -> None:
        until(lambda: np.linalg.norm(played.tip() - start) > 0.03)
        act()

    thread = threading.Thread(target=watch)
    thread.start()
    easel.robot.follow(Waypoints("across", corner + np.linspace(0, 0.12, 121)[:, None] * (1, 0, 0), 0.05))
    thread.join()
    yield


def kill_in_motion(played: Played, order: EaselOrder, *, stops: bool = True) -> tuple[RobotAbandoned, float]:
    """Kills the easel's process in the middle of a motion; returns the error, and metres gone after the kill.

    stops: False if nothing will stop the machine
    """
    killed: list[np.ndarray] = []

    def kill_and_wait() -> None:
        killed.append(played.tip().copy())
        process._process.kill()
        if stops:
            until(played.heard)

    with pytest.raises(RobotAbandoned) as lost, EaselProcess() as process:
        easel = process.open(order)
        easel.robot.connect()
        with in_motion(easel, played, kill_and_wait):
            pass
    until(lambda: is_still(played))
    return lost.value, float(np.linalg.norm(played.tip() - killed[0]))


def is_still(played: Played) -> bool:
    before = played.tip().copy()
    time.sleep(0.2)
    return bool(np.allclose(played.tip(), before, atol=1e-6))


@pytest.mark.parametrize("machine", MACHINES.values(), ids=MACHINES)
def test_a_machine_whose_easels_process_was_killed_is_held_and_latched(
    tmp_path: Path, machine: Callable[[], AbstractContextManager[Played]]
) -> None:
    """Fault B13: the easel's process is killed in the middle of a motion."""
    with machine() as played:
        order = order_of(played, tmp_path)
        error, gone = kill_in_motion(played, order)
        assert (error.held, error.latched) == (True, True) and "signal 9" in str(error)
        assert gone < 0.05, "the way was 12 cm"
        with EaselProcess() as process, pytest.raises(RobotStopped):
            process.open(order)
        (latch,) = latches(order.state)
        latch.release()
        with EaselProcess() as process:  # its port is free
            process.open(order).robot.connect()


def test_where_no_second_descriptor_is_had_the_error_says_that_nobody_was_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(GcodeRobot, "stop_line", lambda self: None)
    with grbl() as played:
        order = order_of(played, tmp_path)
        error, _ = kill_in_motion(played, order, stops=False)
        assert (error.held, error.latched) == (False, True)
        assert not played.heard() and latches(order.state)


def test_a_process_that_is_killed_while_nothing_is_asked_of_it_is_missed_at_once(tmp_path: Path) -> None:
    """The painting process may be planning then, or wait for a person."""
    with grbl() as played, EaselProcess() as process:
        order = order_of(played, tmp_path)
        easel = process.open(order)
        easel.robot.connect()
        kill(process)
        until(lambda: latches(order.state) and process.stopped)
        assert played.heard()
        for _ in range(2):
            with pytest.raises(RobotAbandoned):
                easel.robot.home()
        process._opened = False  # nobody is there to be told of the end


def test_a_robot_that_was_not_connected_is_not_latched_and_an_end_in_order_leaves_nothing_behind(
    tmp_path: Path,
) -> None:
    with grbl() as played:
        order = order_of(played, tmp_path)
        for _ in range(2):
            with EaselProcess() as process:
                easel = process.open(order)
                easel.robot.connect()
                easel.robot.close()
                easel.robot.connect()  # the lock of its port is free again
        with EaselProcess() as process:
            easel = process.open(order)
            kill(process)
            with pytest.raises(RobotAbandoned) as lost:
                easel.camera.connect()
            process._opened = False
        assert not (lost.value.held or lost.value.latched or latches(order.state) or played.heard())


def test_a_process_that_is_frozen_in_a_motion_is_ended_and_its_machine_held(tmp_path: Path) -> None:
    """Fault B11: the easel's process is frozen."""
    with grbl() as played:
        order = order_of(played, tmp_path)
        with pytest.raises(RobotAbandoned) as lost, EaselProcess() as process:
            easel = process.open(order)
            easel.robot.connect()
            process._link.most_silence = 0.5
            with in_motion(easel, played, lambda: os.kill(process._process.pid, signal.SIGSTOP)):
                pass
        assert lost.value.held and lost.value.latched and played.heard()


def test_a_process_that_is_told_to_end_stops_its_machine_itself(tmp_path: Path) -> None:
    with grbl() as played:
        order = order_of(played, tmp_path)
        with pytest.raises(RobotDisconnected) as ended, EaselProcess() as process:
            easel = process.open(order)
            easel.robot.connect()
            with in_motion(easel, played, process._process.terminate):
                pass
        assert not isinstance(ended.value, RobotAbandoned) and played.heard()
        assert process._process.poll() == 128 + signal.SIGTERM
        (latch,) = latches(order.state)
        assert "SIGTERM" in latch.read().reason
