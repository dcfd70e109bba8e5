import inspect
import socket
import sys
import threading
import time
import types
from collections.abc import Iterator

import numpy as np
import pytest

from frida_painter.errors import ConfigError, MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.drivers import interlock
from frida_painter.hardware.drivers.xarm import XarmRobot, XarmSettings
from frida_painter.hardware.robot import Waypoints
from machines.fake_xarm import ControlBox, FakeApi
from machines.paths import NOT_PATHS, a_stroke

HOME = (0.2, -0.1, 0.3)


@pytest.fixture
def box(monkeypatch: pytest.MonkeyPatch) -> Iterator[ControlBox]:
    box = ControlBox()
    wrapper = types.ModuleType("xarm.wrapper")
    wrapper.XArmAPI = box.api
    monkeypatch.setitem(sys.modules, "xarm", types.ModuleType("xarm"))
    monkeypatch.setitem(sys.modules, "xarm.wrapper", wrapper)
    with socket.create_server(("127.0.0.1", 0)) as door:
        monkeypatch.setattr("frida_painter.hardware.drivers.xarm._CONTROL_PORT", door.getsockname()[1])
        yield box
    box.free.set()


def connected(brush_length: float = 0.0) -> XarmRobot:
    robot = XarmRobot(XarmSettings("127.0.0.1", HOME, brush_length=brush_length))
    robot.connect()
    return robot


def test_it_follows_in_millimetres_and_says_where_it_really_is(box: ControlBox) -> None:
    stroke = a_stroke()
    robot = connected()
    report = robot.follow(stroke)
    assert report.started_at < report.finished_at <= time.monotonic()
    assert report.reached == pytest.approx(stroke.position[-1], abs=1e-9)
    assert robot.pose() == pytest.approx(stroke.position[-1], abs=1e-9)
    for point in stroke.position:
        assert min(np.linalg.norm(np.array(box.moved) - 1000 * point, axis=1)) < 1e-6
    assert box.place[3:] == pytest.approx((180, 0, 0))
    given = [what for name, what in box.calls if name == "set_position"]
    assert given[0] == (0.5, 150.0) and given[1] == (0.5, 60.0) and given[-1] == (None, 60.0)
    assert robot.home().reached == pytest.approx(HOME)
    robot.close()
    assert box.connections == 0


def test_a_long_brush_is_held_higher_by_its_length(box: ControlBox) -> None:
    robot = connected(brush_length=0.12)
    report = robot.follow(a_stroke())
    assert report.reached == pytest.approx(a_stroke().position[-1])
    assert box.place[2] == pytest.approx(1000 * (a_stroke().position[-1, 2] + 0.12))


def test_it_tells_the_truth_about_a_place_that_it_did_not_reach(box: ControlBox) -> None:
    box.astray = np.array([7.0, 0.0, 0.0])
    report = connected().follow(a_stroke())
    assert np.linalg.norm(report.reached - a_stroke().position[-1]) == pytest.approx(0.007)


def test_an_arm_that_says_too_soon_that_it_stands_is_waited_for(box: ControlBox) -> None:
    box.hasty, box.pace = True, 5.0
    stroke = a_stroke()
    robot = connected()
    assert robot.follow(stroke).reached == pytest.approx(stroke.position[-1], abs=1e-9)
    robot.close()


def test_an_error_in_a_stroke_is_told_by_its_code_and_never_cleared(box: ControlBox) -> None:
    robot = connected()
    box.error_at = 12
    with pytest.raises(MotionFailed, match=r"stroke 7: .* error 31: it ran into something at waypoint 12") as told:
        robot.follow(a_stroke())
    assert (told.value.code, told.value.waypoint) == (31, 12)
    still_after_that(box, robot)
    with pytest.raises(MotionFailed, match=r"connect: .* this program never does"):
        robot.connect()
    assert box.connections == 0
    assert not [name for name, _ in box.calls if "clean" in name]
    box.error = 0  # a person has cleared it
    robot.connect()
    box.error_at = None
    robot.follow(a_stroke())


def test_a_protective_stop_is_a_stop(box: ControlBox) -> None:
    robot = connected()
    box.protective_at = 40
    with pytest.raises(RobotStopped, match="was stopped, by its switch or to protect somebody"):
        robot.follow(a_stroke(points=60))
    still_after_that(box, robot)


def test_an_arm_that_is_paused_is_given_up_at_the_deadline(box: ControlBox, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interlock, "PATIENCE", 0.1)
    robot = connected()
    box.place[:3] = a_stroke().position[0] * 1000
    box.paused_at = 5
    with pytest.raises(MotionFailed, match="is paused, and is stopped now"):
        robot.follow(a_stroke(speed=1.0))
    assert box.state == 4


def still_after_that(box: ControlBox, robot: XarmRobot) -> None:
    """Nothing moves any more, whatever is asked of the robot."""
    time.sleep(0.05)
    box.run()
    assert box.state == 4
    moved, sent = len(box.moved), box.sent
    for action in (robot.home, robot.pose, lambda: robot.follow(a_stroke())):
        with pytest.raises(RobotError):
            action()
    box.run()
    assert (len(box.moved), box.sent) == (moved, sent)


CALLS = ("get_position", "set_position", "get_state", "get_cmdnum", "get_err_warn_code")


@pytest.mark.parametrize("fault", ["vendor", "unknown", "hangs", "garbage", "refuses"])
@pytest.mark.parametrize("call", CALLS)
def test_whatever_a_call_does_in_a_stroke_becomes_a_robot_error_and_nothing_moves_after(
    box: ControlBox, monkeypatch: pytest.MonkeyPatch, call: str, fault: str
) -> None:
    robot = connected()
    box.misbehave[call] = fault
    box.after[call] = {"set_position": 12, "get_cmdnum": 0}.get(call, 2)
    monkeypatch.setattr(interlock.Interlock.asking, "__defaults__", (0.3,))
    box.pace = 1
    with pytest.raises(RobotError) as told:
        robot.follow(a_stroke(speed=1.0))
    assert "xArm at 127.0.0.1" in str(told.value)
    if fault == "hangs":
        assert isinstance(told.value, RobotDisconnected)
    box.misbehave.clear()
    still_after_that(box, robot)
    robot.close()
    box.free.set()
    box.pace = 100
    robot.connect()
    robot.follow(a_stroke())


FAULTS = ("vendor", "unknown", "hangs", "garbage", "refuses")
OPENING = [("connect", fault) for fault in FAULTS[:3]]  # connect answers nothing that could be garbage
OPENING += [
    (call, fault) for call in ("motion_enable", "set_mode", "set_state", *CALLS[4:], CALLS[0]) for fault in FAULTS
]


@pytest.mark.parametrize(("call", "fault"), OPENING)
def test_a_connection_that_fails_halfway_leaves_nothing_open_and_can_be_repeated(
    box: ControlBox, monkeypatch: pytest.MonkeyPatch, call: str, fault: str
) -> None:
    monkeypatch.setattr(interlock.Interlock.asking, "__defaults__", (0.3,))
    monkeypatch.setattr("frida_painter.hardware.drivers.xarm._OPENING", 0.3)
    box.misbehave[call] = fault
    if call == "connect":
        box.after[call] = 1  # the second of the two connections
    robot = XarmRobot(XarmSettings("127.0.0.1", HOME))
    with pytest.raises(RobotError, match="the xArm at"):
        robot.connect()
    assert box.connections == 0
    with pytest.raises(RobotError, match=r"not connected|does not move"):
        robot.follow(a_stroke())
    assert box.sent == 0
    box.misbehave.clear()
    box.free.set()
    robot.connect()
    robot.follow(a_stroke())


def test_stop_acts_while_a_call_of_the_sdk_hangs(box: ControlBox) -> None:
    box.pace = 1
    robot = connected()
    box.place[:3] = a_stroke().position[0] * 1000
    box.misbehave["get_state"] = "hangs"
    told: list[BaseException] = []

    def paint() -> None:
        try:
            robot.follow(a_stroke())
        except RobotError as error:
            told.append(error)

    thread = threading.Thread(target=paint)
    thread.start()
    while box.sent < 30:
        time.sleep(0.005)
    time.sleep(0.05)
    box.run()
    stopped = time.monotonic()
    robot.stop()
    assert time.monotonic() - stopped < 0.1
    assert box.state == 4
    box.free.set()
    thread.join(3)
    assert told and box.at[-1] - stopped < 0.1
    still_after_that(box, robot)
    with pytest.raises(RobotStopped):
        robot.home()


def test_stop_goes_over_the_other_connection_where_its_own_fails(box: ControlBox) -> None:
    robot = connected()
    box.misbehave["set_state"] = "garbage"
    robot.stop()
    assert [given for name, given in box.calls if name == "set_state"][-2:] == [4, 4]
    XarmRobot(XarmSettings("127.0.0.1", HOME)).stop()  # not connected: nothing to stop, and nothing raised


@pytest.mark.parametrize("position", NOT_PATHS, ids=lambda position: str(position.shape))
def test_what_is_no_path_is_refused_before_anything_is_sent(box: ControlBox, position: np.ndarray) -> None:
    robot = connected()
    with pytest.raises(MotionFailed, match="did not move"):
        robot.follow(Waypoints("stroke 1", position, 0.1))
    assert box.sent == 0
    robot.follow(a_stroke())


def test_an_address_where_nobody_answers_is_told_after_five_seconds(
    box: ControlBox, monkeypatch: pytest.MonkeyPatch
) -> None:
    waited: list[float] = []

    def silence(address: tuple[str, int], timeout: float) -> socket.socket:
        waited.append(timeout)
        raise TimeoutError("timed out")

    monkeypatch.setattr(socket, "create_connection", silence)
    with pytest.raises(RobotDisconnected, match=r"No xArm answers at 10.1.2.3 \(timed out\); look whether its control"):
        XarmRobot(XarmSettings("10.1.2.3", HOME)).connect()
    assert waited == [5.0] and box.calls == []


def test_without_the_package_a_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarm.wrapper", None)
    with pytest.raises(RobotError, match=r"pip install 'frida-painter\[xarm\]'"):
        XarmRobot(XarmSettings("127.0.0.1", HOME)).connect()


@pytest.mark.parametrize(
    "values", [{"approach": 0.0}, {"brush_length": -1.0}, {"blend": float("nan")}, {"acceleration": 0.0},
               {"tool": (180.0, float("nan"), 0.0)}],
)  # fmt: skip
def test_settings_that_cannot_be_are_refused(values: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="An xArm was given"):
        XarmSettings("127.0.0.1", HOME, **values)


def test_the_calls_that_are_used_are_the_sdks_own() -> None:
    sdk = pytest.importorskip("xarm.wrapper").XArmAPI
    for name in ("connect", "disconnect", "motion_enable", "set_mode", "set_state", "set_position", *CALLS):
        ours = inspect.signature(getattr(FakeApi, name)).parameters
        theirs = inspect.signature(getattr(sdk, name)).parameters
        assert set(ours) <= set(theirs), name
    assert {"is_radian", "do_not_open"} <= set(inspect.signature(sdk).parameters)
