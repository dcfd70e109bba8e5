"""The driver of Franka arms against franky-sim, which other authors wrote."""

import socket
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("franky")
pytest.importorskip("franky_sim")

import franky

from frida_painter.easel.guard import GuardedRobot
from frida_painter.errors import MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware import interlock
from frida_painter.hardware.gateway import MotionLimits
from frida_painter.hardware.latch import Latch
from frida_painter.hardware.robot import TouchProbe, Waypoints, Workspace
from frida_painter_drivers import franka
from frida_painter_drivers.franka import FrankaReach, FrankaRobot
from machines.franky_arm import BRUSH, HEIGHT, TABLE_AT, FrankyArm, tip_positions

HOME = (0.4, 0.0, 0.3)
SPEED = 0.03


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FrankyArm]:
    with FrankyArm(tmp_path_factory.mktemp("franka"), table=False) as arm:
        yield arm


@pytest.fixture
def robot(arm: FrankyArm) -> Iterator[FrankaRobot]:
    arm.order(mode=None, errors=[], reject=None)
    robot = connected(arm)
    yield robot
    robot.close()


def connected(arm: FrankyArm) -> FrankaRobot:
    robot = FrankaRobot(arm.address, HOME, brush_length=BRUSH)
    robot.connect()
    return robot


def a_stroke(speed: float = SPEED, points: int = 61) -> Waypoints:
    """60 mm of a bent stroke at the height of a canvas, which comes down, presses and lifts."""
    along = np.linspace(0, 1, points)
    x, y = 0.45 + 0.06 * along, 0.05 + 0.008 * np.sin(2 * np.pi * along)
    path = np.c_[x, y, 0.1 - 0.003 * np.sin(np.pi * along)]
    above = path[[0, -1]] + (0, 0, 0.02)
    return Waypoints("stroke 7", np.concatenate([above[:1], path, above[1:]]), speed)


def painted(arm: FrankyArm, since: int) -> np.ndarray:
    """True positions of the tip [n, 3] since a millisecond."""
    time.sleep(0.3)
    return tip_positions(arm.joints()[since:])


def off_path(tips: np.ndarray, waypoints: Waypoints) -> np.ndarray:
    """Distance of each tip from the path, metres."""
    starts, ends = waypoints.position[:-1], waypoints.position[1:]
    away = np.full(len(tips), np.inf)
    for start, end in zip(starts, ends, strict=True):
        share = np.clip((tips - start) @ (end - start) / ((end - start) @ (end - start)), 0, 1)
        away = np.minimum(away, np.linalg.norm(tips - start - share[:, None] * (end - start), axis=1))
    return away


def test_a_stroke_is_exact_even_upright_and_as_long_as_foretold_and_home_is_reached_from_above(
    arm: FrankyArm, robot: FrankaRobot
) -> None:
    stroke = a_stroke()
    robot.follow(Waypoints("above", stroke.position[:1], 0.1))
    since, moves = len(arm.joints()), arm.moves()
    report = robot.follow(stroke)
    assert arm.moves() == moves + 1, "a stroke is one motion"
    assert report.started_at < report.finished_at <= time.monotonic()
    tips = painted(arm, since)
    joints = arm.joints()[since:][: len(tips)]
    assert np.sqrt((off_path(tips, stroke) ** 2).mean()) < 3e-4
    assert np.linalg.norm(off_path(stroke.position, Waypoints("", tips[::20], 1.0)).max()) < 1e-3  # and it paints all
    assert report.reached == pytest.approx(tips[-1], abs=2e-4)
    assert report.reached == pytest.approx(stroke.position[-1], abs=5e-4)
    handle = tip_positions(joints, 0.0) - tip_positions(joints, BRUSH)
    assert np.degrees(np.arccos(handle[:, 2] / np.linalg.norm(handle, axis=1))).max() < 0.3
    pace = np.linalg.norm(tips[100:] - tips[:-100], axis=1) / 0.1
    middle = (tips[50:-50, 0] > 0.46) & (tips[50:-50, 0] < 0.50) & (tips[50:-50, 2] < 0.1)
    assert middle.sum() > 500
    assert pace[middle].min() > 0.9 * SPEED and pace[middle].max() < 1.1 * SPEED
    # By the arm's own clock while it moves: a busy computer plans before for an unknown time.
    moving = np.flatnonzero(np.linalg.norm(np.diff(tips, axis=0), axis=1) > 2e-6)
    taken = (moving[-1] - moving[0]) / 1000
    timing = robot.timing()
    told = timing.seconds(stroke.position, np.full(len(stroke.position) - 1, stroke.speed)) + timing.between
    rest = 0.5 - 0.2  # of `between`: half a second to stand, of which the simulated arm needs some
    assert told - rest == pytest.approx(taken, rel=0.05)
    since = len(arm.joints())
    assert robot.home().reached == pytest.approx(HOME, abs=5e-4)
    tips = painted(arm, since)
    assert np.abs(tips[tips[:, 2] < 0.28][:, :2] - stroke.position[-1, :2]).max() < 2e-3


def test_the_reach_that_is_known_before_is_that_of_the_arms_own_model(arm: FrankyArm, robot: FrankaRobot) -> None:
    state = robot._state("test")
    places = np.array([[0.4, 0.1, 0.1], [0.5, -0.3, 0.2], [0.3, 0.2, 0.05], [0.55, 0.0, 0.3]])
    for place, joints in zip(places, FrankaReach(BRUSH).solve(places), strict=True):
        tip, rotation = robot._pose_of(joints, state)
        assert tip == pytest.approx(place, abs=1e-6)
        assert rotation == pytest.approx(robot._upright.as_matrix(), abs=1e-6)
    assert robot.reachable(places).all()
    assert not robot.reachable(np.array([[0.95, 0, 0.1], [0.1, 0, 0.1], [0.25, 0, 0.75]])).any()


@pytest.mark.parametrize(
    ("place", "speed", "told"),
    [
        ((0.95, 0.0, 0.1), 0.1, r"does not reach \(.*\) m with the brush upright"),
        ((0.1, 0.0, 0.1), 0.1, "does not reach"),
        ((0.25, 0.0, 0.75), 0.1, "does not reach"),
        ((-0.4, 0.0, 0.3), 0.1, "does not reach|would turn at"),
    ],
)
def test_what_the_arm_cannot_do_is_refused_before_anything_moves(
    arm: FrankyArm, robot: FrankaRobot, place: tuple[float, float, float], speed: float, told: str
) -> None:
    moves = arm.moves()
    with pytest.raises(MotionFailed, match=rf"stroke 1: .*({told}).*did not move"):
        robot.follow(Waypoints("stroke 1", np.array([place]), speed))
    assert arm.moves() == moves


def test_a_joint_that_would_be_too_fast_is_told(
    arm: FrankyArm, robot: FrankaRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(franka, "_SHARE_OF_SPEED", 0.01)
    with pytest.raises(MotionFailed, match=r"joint \d of .* would turn at .* rad/s are allowed; lower the speed"):
        robot.follow(a_stroke())


def test_stop_from_another_thread_brakes_at_once(arm: FrankyArm, robot: FrankaRobot) -> None:
    told: list[BaseException] = []

    def paint() -> None:
        try:
            robot.follow(Waypoints("stroke 7", np.array([[0.4, -0.1, 0.2], [0.4, 0.2, 0.2]]), 0.1))
        except RobotError as error:
            told.append(error)

    robot.follow(Waypoints("above", np.array([[0.4, -0.1, 0.2]]), 0.1))
    thread = threading.Thread(target=paint)
    thread.start()
    while robot.pose()[1] < -0.02:
        time.sleep(0.01)
    asked = time.monotonic()
    robot.stop()
    thread.join(5)
    assert isinstance(told[0], RobotStopped)
    step, when = arm.stops()[-1]
    assert asked <= when  # how soon, a busy computer does not tell; the arm's own clock tells how it brakes
    time.sleep(1.0)
    tips = tip_positions(arm.joints())
    pace = np.linalg.norm(np.diff(tips, axis=0), axis=1) * 1000
    assert pace[step - 20] == pytest.approx(0.1, rel=0.1)
    moving = np.flatnonzero(pace[step:] > 0.001)
    assert (moving[-1] if len(moving) else 0) < 600
    assert np.linalg.norm(tips[-1] - tips[step]) < 0.015
    with pytest.raises(RobotStopped, match="close the connection and connect it anew"):
        robot.home()


class LosesItsWay:
    """The arm as franky drives it, whose planner gives up in mid-motion some times, as it does if packets are lost."""

    def __init__(self, arm: object, times: int) -> None:
        self._arm, self._left, self._asked = arm, times, 0

    def __getattr__(self, name: str) -> object:
        return getattr(self._arm, name)

    def join_motion(self, seconds: float) -> bool:
        self._asked += 1
        if self._left and self._asked % 40 == 0:
            self._left -= 1
            self._arm.move(franky.JointStopMotion())
            raise RuntimeError("Motion planner failed with error code -111")
        return self._arm.join_motion(seconds)


def test_a_motion_whose_planner_gave_up_goes_on_where_the_arm_stands(arm: FrankyArm, robot: FrankaRobot) -> None:
    stroke = a_stroke()
    robot.follow(Waypoints("above", stroke.position[:1], 0.1))
    since, moves = len(arm.joints()), arm.moves()
    robot._arm = LosesItsWay(robot._arm, 2)
    report = robot.follow(stroke)
    assert arm.moves() == moves + 3
    tips = painted(arm, since)
    assert np.sqrt((off_path(tips, stroke) ** 2).mean()) < 3e-4
    assert np.linalg.norm(off_path(stroke.position, Waypoints("", tips[::20], 1.0)).max()) < 1e-3  # and it paints all
    assert report.reached == pytest.approx(stroke.position[-1], abs=5e-4)


def test_a_motion_that_loses_its_way_again_and_again_is_given_up(arm: FrankyArm, robot: FrankaRobot) -> None:
    robot._arm = LosesItsWay(robot._arm, 99)
    with pytest.raises(MotionFailed, match="lost its way, and stands; packets to it are lost"):
        robot.follow(a_stroke(0.01))
    with pytest.raises(RobotError, match="does not move after its last fault"):
        robot.home()


def test_a_reflex_is_told_and_only_a_person_clears_it(arm: FrankyArm, robot: FrankaRobot, tmp_path: Path) -> None:
    latch = Latch(tmp_path / "stopped" / "studio.json", "studio")
    space = Workspace((0.2, -0.4, 0.0), (0.8, 0.4, 0.6), (0.4, 0.0, 0.1), 0.0, (), (0.0,) * 3, (0.0,) * 3, 0.1, 0.02,
                      0.05, 0.2)  # fmt: skip
    guarded = GuardedRobot(robot, MotionLimits(space), latch)
    guarded.connect()
    guarded.follow(Waypoints("above", a_stroke().position[:1], 0.1))
    moves = arm.moves()
    bump = threading.Timer(0.6, lambda: arm.order(mode="kReflex", errors=[7], abort="kReflexAborted"))
    bump.start()
    with pytest.raises(MotionFailed, match=r"in a reflex: it ran into something .* press and release its user stop"):
        guarded.follow(a_stroke())
    bump.join()
    assert arm.moves() == moves + 1
    with pytest.raises(RobotStopped, match="re-arm"):
        guarded.home()
    guarded.close()
    with pytest.raises(MotionFailed, match=r"connect: .*reflex.*\(cartesian_reflex\)") as told:
        connected(arm)
    assert told.value.code == "cartesian_reflex"
    arm.order(mode=None, errors=[])  # a person has cleared it at the arm
    with pytest.raises(RobotStopped, match="frida-painter arm"):
        GuardedRobot(robot, MotionLimits(space), latch).connect()
    latch.release()  # and has re-armed it here
    again = GuardedRobot(robot, MotionLimits(space), latch)
    again.connect()
    again.follow(a_stroke())
    again.close()
    assert arm.recoveries() == 0, "neither franky nor the driver clears an error"


def test_the_user_stop_is_a_stop(arm: FrankyArm, robot: FrankaRobot) -> None:
    robot.follow(Waypoints("above", a_stroke().position[:1], 0.1))
    press = threading.Timer(0.6, lambda: arm.order(mode="kUserStopped", abort="kEmergencyAborted"))
    press.start()
    with pytest.raises(RobotStopped, match=r"stroke 7: .* user stop is pressed.* release the user stop"):
        robot.follow(a_stroke())
    press.join()
    robot.close()
    with pytest.raises(RobotStopped, match=r"connect: .* user stop is pressed"):
        connected(arm)


@pytest.mark.parametrize(
    ("mode", "told"),
    [("kGuiding", "guides it by hand; let it go"), ("kMove", "another program"), ("kOther", "look at Desk"),
     ("kAutomaticErrorRecovery", "recovers from an error")],
)  # fmt: skip
def test_an_arm_that_is_not_ready_is_not_connected(arm: FrankyArm, mode: str, told: str) -> None:
    arm.order(mode=mode)
    with pytest.raises(RobotError, match=rf"connect: the Franka at .* does not move, .*{told}"):
        connected(arm)
    arm.order(mode=None)
    connected(arm).close()


def test_a_motion_that_the_arm_rejects_is_an_error(arm: FrankyArm, robot: FrankaRobot) -> None:
    arm.order(reject="kCommandNotPossibleRejected")
    with pytest.raises(MotionFailed, match=r"stroke 7: .* gave the motion up \(.*rejected.*\)"):
        robot.follow(a_stroke())
    arm.order(reject=None)
    with pytest.raises(RobotError, match="does not move after its last fault"):
        robot.home()
    robot.connect()
    robot.home()


def test_another_program_at_the_arm_is_told(
    arm: FrankyArm, robot: FrankaRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(interlock.Interlock.asking, "__defaults__", (1.0,))
    with pytest.raises(RobotDisconnected, match=r"No Franka answers .* another program is connected"):
        connected(arm)
    robot.pose()


def test_an_arm_that_vanishes_is_disconnected(tmp_path: Path) -> None:
    with FrankyArm(tmp_path, table=False) as arm:
        robot = connected(arm)
        arm.kill()
        with pytest.raises(RobotDisconnected, match=r"pose: the connection to the Franka at .* is lost"):
            robot.pose()
        with pytest.raises(RobotError, match="does not move after its last fault"):
            robot.home()
        robot.close()
        with pytest.raises(RobotDisconnected, match=r"No Franka answers at "):
            robot.connect()


def test_an_arm_that_was_guided_by_hand_comes_into_its_posture_in_place(tmp_path: Path) -> None:
    with FrankyArm(tmp_path, table=False, start=[0.2, 0.1, 0.4, -1.6, 0.3, 1.7, 0.5]) as arm:
        robot = connected(arm)
        place = robot.pose()
        robot.follow(Waypoints("here", place[None], 0.1))
        tips = painted(arm, 0)
        assert np.linalg.norm(tips - place, axis=1).max() < 2e-3
        handle = tip_positions(arm.joints()[-1:], 0.0)[0] - tips[-1]
        assert handle == pytest.approx((0, 0, BRUSH), abs=1e-3)  # the arm's friction leaves half a degree
        assert abs(arm.joints()[-1, 2]) < 0.01


def test_an_arm_that_is_turned_too_far_is_refused(tmp_path: Path) -> None:
    with FrankyArm(tmp_path, table=False, start=[0, 0, 0, -1.57, 0, 3.0, 0.785]) as arm:
        with pytest.raises(MotionFailed, match=r"turned by 82 degrees from upright.* did not move"):
            connected(arm).home()
        assert arm.moves() == 0


TILT = (0.02, -0.03)


@pytest.mark.parametrize(("sign", "place"), [(-1.0, (0.45, -0.1)), (1.0, (0.55, 0.08))])
def test_the_brush_finds_the_table_by_itself(tmp_path: Path, sign: float, place: tuple[float, float]) -> None:
    with FrankyArm(tmp_path, tilt=TILT, sign=sign) as arm:
        robot = connected(arm)
        assert isinstance(robot, TouchProbe)
        robot.follow(Waypoints("above", np.array([[*place, 0.112]]), 0.1))
        report = robot.touch(0.09, 0.005)
        table = HEIGHT + (np.array(place) - TABLE_AT) @ TILT
        assert report.reached == pytest.approx((*place, table), abs=4e-4)
        tips = painted(arm, 0)
        assert np.linalg.norm(tips[-1] - report.reached) < 2e-4, "it stands there"
        assert tips[:, 2].min() > table - 0.008, "and has bent the brush by a few millimetres at most"


def test_where_nothing_is_the_touch_ends_at_the_lowest_place(arm: FrankyArm, robot: FrankaRobot) -> None:
    robot.follow(Waypoints("above", np.array([[0.45, 0.0, 0.105]]), 0.1))
    assert robot.touch(0.09, 0.02).reached == pytest.approx((0.45, 0.0, 0.09), abs=2e-4)


@pytest.mark.parametrize(
    ("scene", "counts", "told"),
    [({"noise": 0.02}, 0.4, "pressed with .* N, and a touch counts from 0.4 N: .* touch more slowly"),
     ({"table": False, "noise": 2.0}, 1.5, "changes although nothing touches the brush; enter the weight")],
)  # fmt: skip
def test_a_touch_that_cannot_be_believed_is_refused(
    tmp_path: Path, scene: dict[str, float], counts: float, told: str
) -> None:
    with FrankyArm(tmp_path, **scene) as arm:
        robot = FrankaRobot(arm.address, HOME, brush_length=BRUSH, touch_force=counts)
        robot.connect()
        robot.follow(Waypoints("above", np.array([[0.45, 0.0, 0.118]]), 0.1))
        with pytest.raises(MotionFailed, match=f"touch: .*{told}"):
            robot.touch(0.09, 0.06)
        with pytest.raises(RobotError, match="does not move after its last fault"):
            robot.home()


def test_an_examination_explains_the_arm_and_moves_nothing(arm: FrankyArm) -> None:
    arm.order(mode=None, errors=[], reject=None)
    moves = arm.moves()
    told = FrankaRobot(arm.address, HOME, brush_length=BRUSH).examine()
    text = " ".join(fact.text for fact in told.facts)
    assert "idle and ready" in text and "0.73 kg" in text and "PREEMPT_RT" in text
    assert {fact.weight for fact in told.facts} == {"fact", "warning"}
    arm.order(mode="kReflex", errors=[7])
    told = FrankaRobot(arm.address, HOME).examine()
    assert [fact.text for fact in told.facts if fact.weight == "refusal"] == [
        "The arm does not move: it is in a reflex: it ran into something or was commanded beyond its limits, "
        "cartesian_reflex; look at it, free it, then press and release its user stop, or clear the error in Desk; this "
        "program never does."
    ]
    assert "No brush length is given" in " ".join(fact.text for fact in told.facts)
    arm.order(mode=None, errors=[])
    assert arm.moves() == moves and arm.recoveries() == 0


def test_an_address_where_nobody_answers_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(RobotDisconnected, match=r"No Franka answers at 127.0.41.9 \(.*refused.*\).*FCI is activated"):
        FrankaRobot("127.0.41.9", HOME).connect()
    with socket.create_server(("127.0.41.9", 1337)):  # somebody who never says anything
        monkeypatch.setattr(interlock.Interlock.asking, "__defaults__", (0.5,))
        with pytest.raises(RobotDisconnected, match=r"No Franka answers at 127.0.41.9 .*another program"):
            FrankaRobot("127.0.41.9", HOME).connect()


def test_without_the_package_a_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "franky", None)
    with pytest.raises(RobotError, match='extra "franka"'):
        FrankaRobot("127.0.0.1", HOME).connect()
