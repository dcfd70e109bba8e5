"""An easel in a process of its own is the easel that it would be in this one."""

import hashlib
import math
import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from frida_painter.brush.kinds import brush_kind
from frida_painter.easel.kinds import SIMULATION_LOG
from frida_painter.easel.open import open_easel
from frida_painter.easel.order import EaselOrder
from frida_painter.easel.parent import EaselProcess
from frida_painter.errors import (
    ConfigError,
    RobotBusy,
    RobotDisconnected,
    RobotError,
    StaleFrame,
    WorkspaceViolation,
)
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gateway import MotionLimits
from frida_painter.hardware.robot import Waypoints
from frida_painter.registry import EASELS
from frida_painter.session.hand import Hand
from frida_painter.system.messages import decode_error
from plugins import install
from session.easel_errands import PAINTS, easel_of, kill, moves, order_in, paint
from support.plans import plan_of_paints

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


_COUNTED_KIND = """
from frida_painter.easel.kinds import EaselKind
from frida_painter.easel.virtual_easel import VIRTUAL_KIND as STUDIO
from frida_painter.hardware.gateway import MotionLimits

def open_counted(order):
    find_faults = MotionLimits._faults_of

    def count(limits, motion):
        with (order.folder / "checks").open("a") as file:
            file.write(f"{motion.label}\\n")
        return find_faults(limits, motion)

    MotionLimits._faults_of = count
    return STUDIO.open(order)

KIND = EaselKind("counted", "a virtual studio that counts how often its door checks a motion", open_counted, True)
"""


def test_a_motion_is_checked_once_at_the_door_of_its_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    points = {EASELS: {"counted": "counted_easel:KIND"}}
    install(tmp_path / "kind", monkeypatch, "counted-easel", points, {"counted_easel": _COUNTED_KIND})
    order, plan = order_in(tmp_path / "counted", robot="counted"), plan_of_paints([0, 1, 0])
    with easel_of(order) as (easel, _):
        monkeypatch.delattr(MotionLimits, "_faults_of")  # nothing is checked on this side
        easel.operator.fill_wells(PAINTS)
        hand = Hand(easel, brush_kind("fine"))
        actions = hand.prepare(plan, 0, len(plan))
        checked = (order.folder / "checks").read_text().splitlines()
        for action in actions:
            hand.perform(action)
        assert (order.folder / "checks").read_text().splitlines() == checked, "before the first motion, and once"
        made = [motion for action in actions for motion in action.motions]
        assert len(checked) == len({motion.position.tobytes() for motion in made}), "equal ones together"
        assert len(moves(order.folder)) == len(made)
        astray = replace(
            easel, workspace=replace(easel.workspace, canvas_origin=(9.0, *easel.workspace.canvas_origin[1:]))
        )
        with pytest.raises(WorkspaceViolation, match=r"above stroke 1: x = .*Nothing was sent"):
            Hand(astray, brush_kind("fine")).prepare(plan, 0, len(plan))


def test_a_client_that_checks_nothing_is_refused_at_the_door(tmp_path: Path) -> None:
    order = order_in(tmp_path)
    with easel_of(order) as (easel, _):
        easel.robot.home()
        before, over = moves(order.folder), easel.workspace.to_robot(np.array([[0.05, 0.05]]), np.zeros(1))[0]
        press = easel.calibration.press_height
        for unsafe in (
            Waypoints("bad", np.array([[*over[:2], press - 0.001]]), 0.1),
            Waypoints("bad", np.array([[*over[:2], math.nan]]), 0.1),
            Waypoints("bad", np.array([np.add(easel.workspace.upper, 0.01)]), 0.1),
            Waypoints("bad", np.array([[*over[:2], press]]), 1.1),
            Waypoints("bad", np.empty((0, 3)), 0.1),
        ):
            with pytest.raises(WorkspaceViolation, match=r"^bad: .*Nothing was sent"):
                easel.robot.follow(unsafe)
        assert moves(order.folder) == before


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
    [({"robot": "virtual"}, "canvas"), ({"simulation": {"pace": float("nan")}}, "pace"), ({"surprise": 1}, "surprise")],
)
def test_an_order_that_is_none_is_refused(tmp_path: Path, record: dict, says: str) -> None:
    whole = ORDERS.dump_python(order_in(tmp_path), mode="json")
    with pytest.raises(ValidationError, match=says):
        ORDERS.validate_python(record if says == "canvas" else {**whole, **record})
    assert ORDERS.validate_python(whole) == order_in(tmp_path)


def test_an_order_that_is_none_comes_back_as_an_error() -> None:
    with EaselProcess() as process:
        process._wire.send({"order": {"robot": "virtual", "surprise": 1}})
        with pytest.raises(ConfigError, match=r"The order of the easel is none \(canvas: .*surprise: Unexp"):
            raise decode_error(process._wire.receive(60)[0], RobotError)
