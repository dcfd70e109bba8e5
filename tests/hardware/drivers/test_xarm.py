"""The driver of xArms: the maker's own SDK speaks over its own protocol to a simulated control box."""

import math
import socket
import sys
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from frida_painter.errors import MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware import interlock
from frida_painter.hardware.robot import ExaminedRobot, TimedRobot, Waypoints
from frida_painter_drivers.xarm import XarmRobot
from machines.paths import a_stroke
from machines.xarm_box import COLLISION, PAUSED, STOPPED, XarmBox, use_ports

pytest.importorskip("xarm", reason="the extra `xarm` is not installed")

HOME = (0.3, -0.1, 0.3)


def reached_by_arm(waypoints: Waypoints) -> Waypoints:
    """The same path where an xArm reaches."""
    return Waypoints(waypoints.label, waypoints.position + np.array([0.2, 0.0, 0.15]), waypoints.speed)


STROKE = reached_by_arm(a_stroke())


@pytest.fixture
def box(monkeypatch: pytest.MonkeyPatch) -> Iterator[XarmBox]:
    with XarmBox() as box:
        use_ports(box, monkeypatch)
        yield box


@pytest.fixture
def robot(box: XarmBox) -> Iterator[XarmRobot]:
    robot = XarmRobot("127.0.0.1", HOME)
    robot.connect()
    yield robot
    robot.close()


def test_it_follows_in_millimetres_and_says_where_it_really_is(box: XarmBox, robot: XarmRobot) -> None:
    assert isinstance(robot, TimedRobot) and isinstance(robot, ExaminedRobot)
    report = robot.follow(STROKE)
    assert report.started_at < report.finished_at <= time.monotonic()
    assert report.reached == pytest.approx(STROKE.position[-1], abs=1e-6)
    assert robot.pose() == pytest.approx(STROKE.position[-1], abs=1e-6)
    for point in STROKE.position:
        assert min(np.linalg.norm(np.array(box.moved) - 1000 * point, axis=1)) < 1e-3
    assert box.pose[3:] == pytest.approx((math.pi, 0, 0))
    assert robot.home().reached == pytest.approx(HOME, abs=1e-6)
    assert robot.serial_number == "XI130308B22L34"
    robot.close()
    wait_for(lambda: box.connections == 0)


def wait_for(told: object) -> None:
    until = time.monotonic() + 60
    while not told() and time.monotonic() < until:  # type: ignore[operator]
        time.sleep(0.01)
    assert told()  # type: ignore[operator]


def test_a_long_brush_is_held_higher_by_its_length(box: XarmBox) -> None:
    robot = XarmRobot("127.0.0.1", HOME, brush_length=0.12)
    robot.connect()
    report = robot.follow(STROKE)
    assert report.reached == pytest.approx(STROKE.position[-1], abs=1e-6)
    assert box.pose[2] == pytest.approx(1000 * (STROKE.position[-1, 2] + 0.12), abs=1e-3)
    robot.close()


def test_a_brush_that_leans_after_guiding_is_turned_upright_about_its_tip_first(box: XarmBox) -> None:
    """The handle's angle and the tip's path, by the places and angles of the control box."""
    length, lean = 0.12, math.radians(25)
    handle = np.array([0.0, math.sin(lean), math.cos(lean)])  # from the tip to the hand
    tip = STROKE.position[0]
    box.pose = np.array([*(1000 * (tip + length * handle)), math.pi - lean, 0.0, 0.0])
    robot = XarmRobot("127.0.0.1", HOME, brush_length=length)
    robot.connect()
    assert robot.pose() == pytest.approx(tip, abs=1e-6)
    before = len(box.moved)
    report = robot.follow(STROKE)
    toward = Rotation.from_euler("xyz", np.array(box.turned[before:])).apply([0.0, 0.0, -1.0])
    tips = np.array(box.moved[before:]) / 1000 - length * toward
    leans = np.degrees(np.arccos(np.clip(toward[:, 2], -1, 1)))
    turning = int((leans < 0.1).argmax())
    assert turning > 10 and np.linalg.norm(tips[:turning] - tip, axis=1).max() < 1e-4
    assert leans[turning:].max() < 0.1
    for point in STROKE.position:
        assert np.linalg.norm(tips - point, axis=1).min() < 1e-5
    assert report.reached == pytest.approx(STROKE.position[-1], abs=1e-6)
    robot.close()


def still_after_that(box: XarmBox, robot: XarmRobot) -> None:
    """Nothing moves any more, whatever is asked of the robot."""
    time.sleep(0.05)
    assert box.state == STOPPED
    moved, commands = len(box.moved), box.commands.count(21)
    for action in (robot.home, robot.pose, lambda: robot.follow(STROKE)):
        with pytest.raises(RobotError):
            action()
    assert (len(box.moved), box.commands.count(21)) == (moved, commands)


# Warnings: the SDK returns 0 for a waypoint that the control box dropped.


def test_m14_a_waypoint_without_a_solution_is_a_fault(box: XarmBox, robot: XarmRobot) -> None:
    far = STROKE.position.copy()
    far[12, 0] += 1.0
    with pytest.raises(MotionFailed, match=r"warning 14: .* no solution, and has dropped .* at waypoint 12"):
        robot.follow(Waypoints("stroke 7", far, 0.06))
    still_after_that(box, robot)
    robot.connect()  # the warning concerned that waypoint, and is cleared
    robot.follow(STROKE)


def test_m14_a_full_queue_is_a_fault_and_long_paths_do_not_fill_it(
    box: XarmBox, robot: XarmRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    box.room = 200
    long = reached_by_arm(a_stroke(speed=0.2, points=600))
    robot.follow(long)
    assert box.warning == 0
    for point in long.position:
        assert min(np.linalg.norm(np.array(box.moved) - 1000 * point, axis=1)) < 1e-3
    box.room, box.pace = 20, 1.0
    with pytest.raises(MotionFailed, match=r"warning 11: .* full, and has dropped what it was told at waypoint"):
        robot.follow(long)
    still_after_that(box, robot)


# What the control box does by itself.


def test_m15_moves_wait_until_the_arm_takes_them_after_set_state(box: XarmBox, monkeypatch: pytest.MonkeyPatch) -> None:
    box.pace = 1.0
    robot = XarmRobot("127.0.0.1", HOME)
    robot.connect()
    robot.follow(Waypoints("step", robot.pose()[None] + (0.01, 0.0, 0.0), 0.1))
    assert box.ignored == 0
    assert box.pose[0] == pytest.approx(310.0)
    robot.close()


@pytest.mark.parametrize("points", [2, 300])
def test_m15_blending_never_overlaps_between_close_waypoints(box: XarmBox, robot: XarmRobot, points: int) -> None:
    twice = reached_by_arm(a_stroke(points=points))
    doubled = np.repeat(twice.position, 2, axis=0)  # waypoints at the place of the one before
    robot.follow(Waypoints("stroke 1", doubled, 0.06))
    assert box.error == 0


@pytest.mark.parametrize("when", ["in the stroke", "between strokes"])
def test_m15_an_arm_that_was_configured_anew_is_told(box: XarmBox, robot: XarmRobot, when: str) -> None:
    if when == "in the stroke":
        box.events[20] = "configuration"
    else:
        box._reset()
    with pytest.raises(RobotError, match="was reset, as by another program that changed its payload"):
        robot.follow(STROKE)
    still_after_that(box, robot)
    robot.connect()
    robot.follow(STROKE)


def test_m15_another_mode_is_told(box: XarmBox, robot: XarmRobot) -> None:
    box.mode = 1
    time.sleep(0.1)
    with pytest.raises(RobotError, match="is in mode 1 and not in 0, for positions; another program uses it"):
        robot.follow(STROKE)


@pytest.mark.parametrize(("code", "says"), [(31, "Collision Caused Abnormal Current"), (77, "see UFACTORY's manual")])
def test_m15_an_error_in_a_stroke_is_named_and_never_cleared(
    box: XarmBox, robot: XarmRobot, code: int, says: str
) -> None:
    box.errors[20] = code
    with pytest.raises(MotionFailed, match=f"stroke 7: .* has error {code}.*{says}") as told:
        robot.follow(STROKE)
    assert told.value.code == code
    still_after_that(box, robot)
    with pytest.raises(MotionFailed, match=r"connect: .* this program never does"):
        robot.connect()
    wait_for(lambda: box.connections == 0)
    assert box.clears == 0
    box.clear_error()  # a person has done that
    robot.connect()
    robot.follow(STROKE)


def test_a_stop_at_the_arm_is_a_stop(box: XarmBox, robot: XarmRobot) -> None:
    box.events[20] = "stop"
    with pytest.raises(RobotStopped, match="was stopped, by its switch or to protect somebody"):
        robot.follow(STROKE)
    still_after_that(box, robot)


def test_a_fault_between_two_questions_is_no_stop_by_a_person(box: XarmBox, robot: XarmRobot) -> None:
    ask = robot._arm.get_state  # the maker's own

    def fail_first() -> tuple[int, int]:
        box._fail(COLLISION)
        return ask()

    robot._arm.get_state = fail_first
    with pytest.raises(MotionFailed, match="error 31"):
        robot.follow(a_stroke())


@pytest.mark.parametrize("points", [31, 300])
def test_an_arm_that_is_paused_is_given_up_at_the_deadline(
    box: XarmBox, robot: XarmRobot, monkeypatch: pytest.MonkeyPatch, points: int
) -> None:
    monkeypatch.setattr(interlock, "PATIENCE", 0.1)
    box.events[5] = "pause"
    with pytest.raises(MotionFailed, match="is paused, and is stopped now"):
        robot.follow(reached_by_arm(a_stroke(speed=1.0, points=points)))
    assert box.state == STOPPED


def test_an_arm_that_is_slower_than_planned_but_moves_is_alive(
    box: XarmBox, robot: XarmRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("frida_painter_drivers.xarm.motion_timeout", lambda path, speed: 0.05)
    monkeypatch.setattr("frida_painter_drivers.xarm.PATIENCE", 0.5)
    box.events[3], box.pace = "speed", 5.0
    assert robot.follow(STROKE).reached == pytest.approx(STROKE.position[-1], abs=1e-6)
    assert robot.alive_at() > 0


def test_it_has_arrived_when_two_questions_give_the_same_place(
    box: XarmBox, robot: XarmRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    ask, creeping = robot._arm.get_position, iter((3.0, 2.0, 1.0, 0.5))

    def creep(**how: object) -> tuple[int, list[float]]:
        code, place = ask(**how)
        resting = box.commands.count(21) and not box._waiting()
        return code, [place[0] + (next(creeping, 0.0) if resting else 0.0), *place[1:]]

    monkeypatch.setattr(robot._arm, "get_position", creep)
    assert robot.follow(STROKE).reached == pytest.approx(STROKE.position[-1], abs=1e-6)


def test_a_paused_arm_is_not_sent_anything(box: XarmBox, robot: XarmRobot) -> None:
    box.state = PAUSED
    with pytest.raises(RobotError, match="is paused; let it go on there"):
        robot.follow(STROKE)
    assert box.commands.count(21) == 0


# The doctor.


def test_the_doctor_reads_payload_sensitivity_and_errors_and_changes_nothing(box: XarmBox) -> None:
    box.load = 0.0
    box.sensitivity = 4
    robot = XarmRobot("127.0.0.1", HOME, brush_length=0.1)
    facts = robot.examine().facts
    told = " ".join(fact.text for fact in facts)
    assert (
        "XI130308B22L34, firmware" in told and "payload is set to 0 kg and its sensitivity for collisions to 4" in told
    )
    assert [fact.weight for fact in facts].count("warning") == 1
    assert not {11, 12, 19, 21} & set(box.commands)  # nothing was switched on, set or moved
    box.errors, box.error, box.state = {}, 35, STOPPED
    refused = [fact.text for fact in robot.examine().facts if fact.weight == "refusal"]
    assert refused == ["It has error 35: Safety Boundary Limit. Look at it and clear the error there."]
    assert box.error == 35
    wait_for(lambda: box.connections == 0)


# Lines and libraries that fail.


@pytest.mark.parametrize("call", ["get_position", "set_position", "get_state", "get_cmdnum", "get_err_warn_code"])
def test_whatever_a_call_of_the_sdk_raises_becomes_a_robot_error_and_nothing_moves_after(
    box: XarmBox, robot: XarmRobot, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    from xarm.wrapper import XArmAPI

    failure = ValueError("timed out") if call.startswith("set") else ZeroDivisionError("never heard of")

    calls = {"set_position": 12, "get_err_warn_code": 9}.get(call, 1)
    made = getattr(XArmAPI, call)

    def fail(*given: object, **named: object) -> object:
        nonlocal calls
        calls -= 1
        if calls < 0:
            raise failure
        return made(*given, **named)

    monkeypatch.setattr(XArmAPI, call, fail)
    with pytest.raises(RobotError, match=r"xArm at 127.0.0.1: .*failed|xArm at 127.0.0.1 failed"):
        robot.follow(STROKE)
    monkeypatch.undo()
    still_after_that(box, robot)


@pytest.mark.parametrize(
    ("call", "how"),
    [("motion_enable", "raises"), ("set_mode", "refuses"), ("set_state", "refuses"),
     ("get_err_warn_code", "refuses"), ("get_position", "raises")],
)  # fmt: skip
def test_a_connection_that_fails_halfway_leaves_nothing_open_and_can_be_repeated(
    box: XarmBox, monkeypatch: pytest.MonkeyPatch, call: str, how: str
) -> None:
    from xarm.wrapper import XArmAPI

    def fail(*_: object, **__: object) -> object:
        if how == "raises":
            raise ZeroDivisionError("never heard of")
        return (9, [0, 0]) if call.startswith("get") else 9

    with monkeypatch.context() as patch:
        patch.setattr(XArmAPI, call, fail)
        robot = XarmRobot("127.0.0.1", HOME)
        with pytest.raises(RobotError, match="the xArm at"):
            robot.connect()
    wait_for(lambda: box.connections == 0)
    with pytest.raises(RobotError, match=r"not connected|does not move"):
        robot.follow(STROKE)
    assert box.commands.count(21) == 0
    robot.connect()
    robot.follow(STROKE)
    robot.close()


def test_stop_acts_while_a_call_of_the_sdk_hangs(
    box: XarmBox, robot: XarmRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    box.pace = 1.0
    free = threading.Event()
    told: list[BaseException] = []
    monkeypatch.setattr(robot._arm, "get_cmdnum", lambda: free.wait(60))

    def paint() -> None:
        try:
            robot.follow(STROKE)
        except RobotError as error:
            told.append(error)

    thread = threading.Thread(target=paint)
    thread.start()
    wait_for(lambda: len(box.moved) > 20)
    asked = time.monotonic()
    robot.stop()
    stopped = time.monotonic()
    assert box.state == STOPPED and stopped - asked < 30, "it does not wait for the call"
    free.set()
    thread.join(60)
    assert box.at[-1] <= stopped
    assert isinstance(told[0], RobotStopped)
    with pytest.raises(RobotStopped):
        robot.home()


def test_stop_goes_over_the_other_connection_where_its_own_fails(
    box: XarmBox, robot: XarmRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot._stopper, "set_state", lambda _: ("?", None))
    robot.stop()
    assert (box.state, box.stops) == (STOPPED, 1)
    XarmRobot("127.0.0.1", HOME).stop()  # not connected: nothing to stop, and nothing raised


def test_the_sdks_timeout_does_not_stay_behind_for_other_sockets(box: XarmBox, robot: XarmRobot) -> None:
    assert socket.getdefaulttimeout() is None


def test_an_address_where_nobody_answers_is_told_after_five_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    waited: list[float] = []

    def silence(address: tuple[str, int], timeout: float) -> socket.socket:
        waited.append(timeout)
        raise TimeoutError("timed out")

    monkeypatch.setattr(socket, "create_connection", silence)
    with pytest.raises(RobotDisconnected, match=r"No xArm answers at 10.1.2.3 \(timed out\); look whether its control"):
        XarmRobot("10.1.2.3", HOME).connect()
    assert waited == [5.0]


def test_without_the_package_a_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarm.wrapper", None)
    with pytest.raises(RobotError, match='extra "xarm"'):
        XarmRobot("127.0.0.1", HOME).connect()
