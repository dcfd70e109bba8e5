"""An arm that a person guides by hand: the tip is recorded, and the arm stays stopped until it is armed."""

import math
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from frida_painter.easel import connecting
from frida_painter.easel.connecting import guide_arm
from frida_painter.errors import ConfigError, MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.latch import latches
from frida_painter.hardware.workcell import WorkcellConfig, example
from frida_painter_calibration.teaching.marks import MarkCutter, read_marks
from frida_painter_drivers.xarm import XarmRobot
from machines.paths import a_stroke
from machines.xarm_box import COLLISION, PAUSED, STANDBY, TEACHING, XarmBox, use_ports
from support.hand_marks import make_marks

BRUSH = 0.1
ARM = f"xarm:127.0.0.1,brush_length={BRUSH}"


@pytest.fixture
def workcell() -> WorkcellConfig:
    return WorkcellConfig.of(tomllib.loads(example()), "example")


@pytest.fixture(autouse=True)
def state(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setattr(connecting, "state_folder", lambda: tmp_path / "state")
    return tmp_path / "state"


@pytest.fixture
def box(monkeypatch: pytest.MonkeyPatch) -> Iterator[XarmBox]:
    pytest.importorskip("xarm", reason="the extra `xarm` is not installed")
    with XarmBox() as box:
        use_ports(box, monkeypatch)
        yield box


def marks_of_a_hand(workcell: WorkcellConfig, count: int) -> list[np.ndarray]:
    """Ways of the tip [k, 3] in the robot's frame, one for each mark of a comma, with the way down and up."""
    ways = []
    depth = workcell.touch_height - workcell.press_height
    for mark in make_marks("comma", count):
        place = mark.place - mark.place.mean(0) + (workcell.canvas.width / 2, workcell.canvas.height / 2)
        height = workcell.touch_height - depth * mark.pressure
        above = workcell.touch_height + np.linspace(0.01, 0.0, 6)
        place = np.concatenate([np.repeat(place[:1], 6, 0), place, np.repeat(place[-1:], 6, 0)])
        ways.append(workcell.workspace.to_robot(place, np.concatenate([above, height, above[::-1]])))
    return ways


def poses(way: np.ndarray, lean: float, length: float = BRUSH) -> np.ndarray:
    """Poses [k, 6] of an arm (mm, radians) whose brush leans by an angle about x, with its tip on a way [k, 3]."""
    lever = length * np.array([0.0, math.sin(lean), math.cos(lean)])
    angles = np.tile((math.pi - lean, 0.0, 0.0), (len(way), 1))
    return np.c_[1000 * (way + lever), angles]


def test_marks_of_a_guided_xarm_are_those_of_the_hand(
    box: XarmBox, workcell: WorkcellConfig, state: Path, tmp_path: Path
) -> None:
    lean = 0.2
    ways = marks_of_a_hand(workcell, 3)
    box.pose[2] = 400.0
    followed: list[int] = []
    modes: list[int] = []

    def lead() -> None:
        while box.mode != TEACHING or box.state != STANDBY:
            time.sleep(0.005)
        time.sleep(0.3)
        followed.extend(box.guide(poses(way, lean), 0.8) for way in ways)

    hand = threading.Thread(target=lead)
    cutter = MarkCutter(workcell.touch_height - workcell.press_height)

    def hear(tip: np.ndarray, at: float) -> None:
        modes.append(box.mode)
        assert latches(state)  # the stop is stored while the arm is released
        place = workcell.workspace.to_canvas(tip[None])[0]
        cutter.add(place, float(tip[2]) - workcell.touch_height, at)

    hand.start()
    guide_arm(ARM, workcell, hear, lambda: not hand.is_alive())
    assert set(modes) == {TEACHING} and sum(followed) == sum(map(len, ways))
    cutter.finish()
    assert cutter.save(tmp_path / "marks.json") == []
    taught = read_marks(tmp_path / "marks.json")
    assert len(taught) == len(ways)
    for mark, way in zip(taught, ways, strict=True):
        drawn = workcell.workspace.to_canvas(way)
        away = np.linalg.norm(mark.place[:, None] - drawn[None], axis=2).min(1)
        assert away.max() < 0.0004
    # It left the teach mode, holds its place, and takes no motion before somebody arms it.
    assert box.mode == 0 and box.state not in (1, 2) and box.guide(poses(ways[0], lean), 0.01) == 0
    (latch,) = latches(state)
    assert "guided by hand" in str(latch.read())
    with pytest.raises(RobotStopped, match="frida-painter arm"):
        guide_arm(ARM, workcell, hear, lambda: True)
    latch.release()
    guide_arm(ARM, workcell, lambda tip, at: None, lambda: True)


def test_no_motion_goes_to_an_arm_that_is_guided(box: XarmBox) -> None:
    robot = XarmRobot("127.0.0.1", (0.3, -0.1, 0.3), brush_length=BRUSH)
    robot.begin_guiding()
    before = box.pose.copy()
    with pytest.raises(RobotError, match="is in mode 2 and not in 0, for positions"):
        robot.follow(a_stroke())
    assert (box.pose == before).all() and not box.moved
    robot.end_guiding()
    robot.end_guiding()
    robot.connect()
    assert box.mode == 0
    robot.close()


@pytest.mark.parametrize(
    ("event", "error", "words"),
    [
        (lambda box: box._fail(COLLISION), MotionFailed, "guide: .* has error 31"),
        (
            lambda box: (box._obey(19, bytes([0])), box._set_state(0)),
            RobotError,
            "guide: .* is in mode 0 and not in 2, for teaching; another program",
        ),
        (lambda box: box._set_state(4), RobotStopped, "guide: .* was stopped"),
        (XarmBox.leave_network, RobotDisconnected, "guide: "),
    ],
)
def test_an_arm_that_ends_the_guiding_by_itself_is_told_and_stays_stopped(
    box: XarmBox,
    workcell: WorkcellConfig,
    state: Path,
    event: Callable[[XarmBox], Any],
    error: type[Exception],
    words: str,
) -> None:
    heard: list[float] = []

    def hear(tip: np.ndarray, at: float) -> None:
        heard.append(at)
        if len(heard) == 3:
            event(box)

    with pytest.raises(error, match=words):
        guide_arm(ARM, workcell, hear, lambda: len(heard) > 200)  # a test that waited for nothing
    assert latches(state) and len(heard) < 30
    if event is not XarmBox.leave_network:
        assert box.guide(poses(np.full((2, 3), 0.3), 0.0), 0.01) == 0


def test_an_arm_with_an_error_is_not_released(box: XarmBox, workcell: WorkcellConfig) -> None:
    box.error, box.state = COLLISION, PAUSED
    with pytest.raises(MotionFailed, match=r"error 31.*clear the error at the arm"):
        guide_arm(ARM, workcell, lambda tip, at: None, lambda: True)
    assert box.mode == 0 and box.clears == 0


def test_an_arm_that_is_not_there_or_has_no_teach_mode_is_told_and_not_stopped(
    workcell: WorkcellConfig, state: Path
) -> None:
    with pytest.raises(ConfigError, match=r"cannot be guided by hand; xarm and franka can. Of another robot, record"):
        guide_arm("axidraw", workcell, lambda tip, at: None, lambda: True)
    assert not latches(state)
    pytest.importorskip("xarm", reason="the extra `xarm` is not installed")
    with pytest.raises(RobotDisconnected, match=r"No xArm answers at 127.0.0.9"):
        guide_arm("xarm:127.0.0.9", workcell, lambda tip, at: None, lambda: True)
