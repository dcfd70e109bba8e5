"""An easel in a process of its own is the easel that it would be in this one."""

import hashlib
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from frida_painter.easel.kinds import SIMULATION_LOG
from frida_painter.easel.open import open_easel
from frida_painter.easel.order import EaselOrder
from frida_painter.easel.parent import EaselProcess
from frida_painter.errors import ConfigError, RobotBusy, RobotDisconnected, StaleFrame, WorkspaceViolation
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.robot import Waypoints
from session.easel_errands import PAINTS, easel_of, kill, order_in, paint

ORDERS = TypeAdapter(EaselOrder)


def here(order: EaselOrder) -> Easel:
    easel = open_easel(order).easel
    easel.robot.connect()
    easel.camera.connect()
    return easel


def look(easel: Easel) -> str:
    frame = easel.camera.capture(easel.robot.home().finished_at)
    return hashlib.sha256(frame.image.tobytes()).hexdigest() + f" {frame.captured_at} {frame.sequence}"


@pytest.mark.usefixtures("fresh_easel")
def test_the_painting_is_the_same_to_the_byte_and_so_is_all_that_is_known(tmp_path: Path) -> None:
    order = order_in(tmp_path / "one")
    with easel_of(order) as (away, _):
        beside = here(order_in(tmp_path / "two"))
        assert away.calibration == beside.calibration
        assert (away.workspace, away.canvas, away.simulated) == (beside.workspace, beside.canvas, beside.simulated)
        for easel in (away, beside):
            easel.operator.fill_wells(PAINTS)
            paint(easel, range(3))
        assert look(away) == look(beside)
        assert (away.robot.pose() == beside.robot.pose()).all()
        assert away.operator.lay_checker() and away.operator.take_checker_away() and away.operator.lay_paper()
        with pytest.raises(WorkspaceViolation, match="stroke 99"):
            away.robot.follow(Waypoints("stroke 99", np.array([[0.0, 0.0, 9.0]]), 0.1))
        with pytest.raises(StaleFrame):
            away.camera.capture(1e9)
        assert look(away)  # nothing of it broke the link


def test_a_killed_painting_goes_on_in_the_next_process(tmp_path: Path) -> None:
    whole, broken = order_in(tmp_path / "whole"), order_in(tmp_path / "broken")
    with easel_of(whole) as (easel, _):
        easel.operator.fill_wells(PAINTS)
        paint(easel, range(4))
        wanted = look(easel)
    with pytest.raises(RobotDisconnected), easel_of(broken) as (easel, process):
        easel.operator.fill_wells(PAINTS)
        paint(easel, range(2))
        kill(process)
        easel.robot.home()
    with easel_of(broken) as (easel, _):
        paint(easel, range(2, 4))
        assert look(easel) == wanted
    assert (tmp_path / "whole" / SIMULATION_LOG).read_bytes() != b""


@pytest.mark.usefixtures("fresh_easel")
def test_a_process_ends_with_its_block_whether_it_was_opened_or_not(tmp_path: Path) -> None:
    with EaselProcess() as process, process:
        process.open(order_in(tmp_path)).robot.connect()
    assert process._process.poll() == 0
    with pytest.raises(ConfigError), EaselProcess() as process:
        raise ConfigError("nothing is painted")
    assert process._process.poll() == -signal.SIGKILL


def test_what_cannot_be_opened_says_so_at_once(tmp_path: Path) -> None:
    for settings, says in (({"brushes": ("broom",)}, "no brush 'broom'"), ({"robot": "golem"}, "no robot 'golem'")):
        began = time.monotonic()
        with EaselProcess() as process, pytest.raises(ConfigError, match=says):
            process.open(order_in(tmp_path, **settings))
        assert time.monotonic() - began < 60


def test_a_robot_that_another_process_has_is_busy_and_free_when_that_one_is_dead(tmp_path: Path) -> None:
    """Fault F32: two painters, one robot."""
    order = order_in(tmp_path)
    with easel_of(order) as (_, first):
        with EaselProcess() as second, pytest.raises(RobotBusy, match=f"process {first._process.pid}") as busy:
            second.open(order)
        assert busy.value.pid == first._process.pid
        kill(first)
        with easel_of(order) as (easel, _):
            easel.robot.home()
        first._opened = False  # nobody is there to be told of the end


@pytest.mark.parametrize(
    ("record", "says"),
    [({"robot": "virtual"}, "canvas"), ({"pace": float("nan")}, "pace"), ({"surprise": 1}, "surprise")],
)
def test_an_order_that_is_none_is_refused(tmp_path: Path, record: dict, says: str) -> None:
    whole = ORDERS.dump_python(order_in(tmp_path), mode="json")
    with pytest.raises(ValidationError, match=says):
        ORDERS.validate_python(record if says == "canvas" else {**whole, **record})
    assert ORDERS.validate_python(whole) == order_in(tmp_path)
