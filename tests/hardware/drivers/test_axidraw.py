import sys
import threading
import time

import numpy as np
import pytest

from frida_painter.errors import ConfigError, MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.drivers.axidraw import AxidrawRobot, AxidrawSettings
from frida_painter.hardware.gcode import Servo
from frida_painter.hardware.robot import Waypoints
from machines.fake_ebb import FakeEbb
from machines.paths import NOT_PATHS, a_stroke

pytest.importorskip("plotink", reason="the extra `plotter` is not installed")

HOME = (0.0, 0.0, 0.01)
SERVO = Servo((-0.002, 10_000), (0.012, 24_000), speed=1.0)


def below(waypoints: Waypoints) -> Waypoints:
    """The same path where an AxiDraw's table is: y below zero."""
    return Waypoints(waypoints.label, waypoints.position * (1, -1, 1), waypoints.speed)


STROKE = below(a_stroke())


def connected(board: FakeEbb) -> AxidrawRobot:
    robot = AxidrawRobot(AxidrawSettings(HOME, board.name, SERVO))
    robot.connect()
    return robot


def test_the_carriage_makes_the_steps_of_the_stroke_and_the_servo_its_heights() -> None:
    with FakeEbb() as board:
        robot = connected(board)
        report = robot.follow(STROKE)
        assert report.reached == pytest.approx(STROKE.position[-1], abs=1e-5)
        assert robot.pose() == pytest.approx(report.reached)
        places = np.array(
            [((a + b) / 160_000, -(a - b) / 160_000, (pulse - 10_000) / 1e6 - 0.002) for (a, b), pulse in board.moved]
        )
        for point in STROKE.position:
            assert np.abs(places - point).max(1).min() < 2e-5
        assert robot.home().reached == pytest.approx(HOME, abs=1e-5)
        robot.close()
    assert board.received[:4] == ["V", "QC", "EM,1,1", "CS"]


@pytest.mark.parametrize(
    ("fault", "error", "says"),
    [
        ("error", MotionFailed, "answered '!3 Err: Invalid parameter value' to 'XM,.*' at waypoint"),
        ("garbage", MotionFailed, "answered '.*~~'"),
        ("unplug", RobotDisconnected, "is gone"),
        ("mute", RobotDisconnected, "did not acknowledge 'XM.* in time"),
    ],
)
def test_what_goes_wrong_is_told_and_nothing_moves_after(
    fault: str, error: type[RobotError], says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("frida_painter.hardware.drivers.interlock.PATIENCE", 0.2)
    with FakeEbb(misbehave={150: fault}) as board:
        robot = connected(board)
        with pytest.raises(error, match=says):
            robot.follow(below(a_stroke(speed=0.3)))
        board.settle()
        moved = len(board.moved)
        assert fault == "unplug" or board.stops == 1
        for action in (robot.home, robot.pose, lambda: robot.follow(STROKE)):
            with pytest.raises(RobotError, match="does not move after its last fault"):
                action()
        board.settle()
        assert len(board.moved) == moved
        robot.close()


def test_stop_ends_within_a_tenth_of_a_second() -> None:
    with FakeEbb(pace=1) as board:
        robot = connected(board)
        told: list[BaseException] = []

        def paint() -> None:
            try:
                robot.follow(STROKE)
            except RobotError as error:
                told.append(error)

        thread = threading.Thread(target=paint)
        thread.start()
        while len(board.moved) < 20:
            time.sleep(0.005)
        stopped = time.monotonic()
        robot.stop()
        robot.stop()
        assert time.monotonic() - stopped < 0.05
        thread.join(2)
        board.settle()
        assert isinstance(told[0], RobotStopped)
        assert board.at[-1] - stopped < 0.1
        with pytest.raises(RobotStopped, match="look at it"):
            robot.home()
        robot.close()


def test_a_board_without_power_or_of_another_kind_is_told_and_let_go() -> None:
    with FakeEbb(voltage=100) as board:
        robot = AxidrawRobot(AxidrawSettings(HOME, board.name, SERVO))
        with pytest.raises(RobotError, match="no power for its motors"):
            robot.connect()
        board.voltage = 300
        robot.connect()
        robot.close()


def test_no_board_and_no_port_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("plotink.ebb_serial.findPort", lambda: None)
    with pytest.raises(RobotDisconnected, match="No AxiDraw was found"):
        AxidrawRobot(AxidrawSettings(HOME)).connect()
    with pytest.raises(RobotDisconnected, match="serial port '/dev/ttyNOPE' cannot be opened"):
        AxidrawRobot(AxidrawSettings(HOME, "/dev/ttyNOPE")).connect()
    monkeypatch.setitem(sys.modules, "plotink", None)
    with pytest.raises(RobotError, match=r"pip install 'frida-painter\[plotter\]'"):
        AxidrawRobot(AxidrawSettings(HOME)).connect()


def test_a_height_beyond_the_servo_is_refused_before_anything_moves() -> None:
    with FakeEbb() as board:
        robot = connected(board)
        before = len(board.moved)
        with pytest.raises(ConfigError, match="servo reaches from -2 to 12 mm"):
            robot.follow(Waypoints("stroke 1", np.array([[0.1, -0.1, 0.01], [0.1, -0.1, -0.01]]), 0.1))
        board.settle()
        assert len(board.moved) <= before + 1  # the pen's rise when it was connected
        for position in NOT_PATHS:
            with pytest.raises(MotionFailed, match="did not move"):
                robot.follow(Waypoints("stroke 1", position, 0.1))
        robot.follow(STROKE)
        robot.close()


@pytest.mark.parametrize("values", [{"approach": 0.0}, {"acceleration": float("nan")}])
def test_settings_that_cannot_be_are_refused(values: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="An AxiDraw was given"):
        AxidrawSettings(HOME, **values)
