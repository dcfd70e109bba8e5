import ast
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from frida_painter.easel.guard import GuardedRobot
from frida_painter.errors import PoseMismatch, RobotDisconnected, WorkspaceViolation
from frida_painter.hardware.gateway import RobotGateway
from frida_painter.hardware.latch import Latch
from frida_painter.hardware.robot import ArmLength, MotionReport, Waypoints
from hardware.misbehaving import Hang, MisbehavingRobot
from support.easel import CALIBRATION, CANVAS, WORKSPACE, NotingRobot, stub_easel
from test_house import SOURCES, place_of

# Each of these stands for a robot and passes a motion on: the gateway, the guard of its process, painting by hand when
# the person has made it, and the studio for a person who tries it.
STAND_FOR_A_ROBOT = {"easel/guard.py", "hardware/gateway.py", "session/human.py", "virtual/studio.py"}
MIDDLE = WORKSPACE.to_robot(np.array([[CANVAS.width / 2, CANVAS.height / 2]]), np.array([0.1]))[0]


def motion(label: str, height: float, speed: float = 0.06) -> Waypoints:
    return Waypoints(label, np.array([[*MIDDLE[:2], height]]), speed)


def test_motions_are_sent_in_order_and_the_last_one_is_remembered() -> None:
    gateway = RobotGateway(stub_easel(robot := NotingRobot(now=10.0)))
    assert gateway.last_motion == 0.0
    assert gateway.perform(iter([motion("a", 0.1), motion("b", 0.12)])) is False
    assert robot.labels() == ["a", "b"] and gateway.last_motion == 12.0
    gateway.step_aside()
    assert robot.labels()[-1] == "home" and gateway.last_motion == 13.0
    np.testing.assert_array_equal(gateway.pose(), (0.0, 0.0, 0.3))


@pytest.mark.parametrize(
    ("forbidden", "says"),
    [
        (motion("bad", CALIBRATION.press_height - 0.001), "bad: z = 0.0890 m .* the hardest press is at 0.0900 m"),
        (motion("bad", WORKSPACE.lower[2] - 0.001), "bad: z = .* the workspace reaches"),
        (motion("bad", math.nan), "bad: z = nan"),
        (motion("bad", math.inf), "bad: z = inf"),
        (motion("bad", 0.1, speed=math.nan), "bad: a speed of nan"),
        (Waypoints("bad", np.array([WORKSPACE.wells[0]]), 0.2), "bad: the arm does not reach"),
        (Waypoints("bad", np.empty((0, 3)), 0.2), "bad: waypoints of shape"),
    ],
)
def test_a_batch_of_which_one_motion_is_not_allowed_is_not_begun(forbidden: Waypoints, says: str) -> None:
    easel = replace(stub_easel(robot := NotingRobot()), reach=ArmLength((*MIDDLE[:2], 0.1), 0.0, 0.04))
    gateway = RobotGateway(easel)
    for refused in (gateway.perform, gateway.check):
        with pytest.raises(WorkspaceViolation, match=rf"{says}.*Nothing was sent"):
            refused([motion("good", 0.1), forbidden])
    assert robot.motions == [] and gateway.last_motion == 0.0


def test_a_brush_that_touches_lower_may_go_as_much_lower_and_no_more() -> None:
    gateway = RobotGateway(stub_easel(robot := NotingRobot()))
    lower = motion("lower", CALIBRATION.press_height - 0.001)
    for not_enough in (0.0, 0.0009, -0.001, math.nan):
        gateway.follow_touch(not_enough)
        with pytest.raises(WorkspaceViolation, match=r"lower: z = 0\.0890 m"):
            gateway.perform([lower])
    gateway.follow_touch(0.001)
    gateway.perform([lower])
    gateway.follow_touch(-0.001)
    gateway.perform([motion("hardest press", CALIBRATION.press_height)])
    assert robot.labels() == ["lower", "hardest press"]


def test_whoever_finds_the_hardest_press_names_another_lowest_height() -> None:
    deep, floor = CALIBRATION.press_height - 0.01, WORKSPACE.lower[2]
    RobotGateway(stub_easel(robot := NotingRobot()), lowest=floor).perform([motion("trial", deep)])
    assert robot.labels() == ["trial"]
    for lowest in (deep + 0.001, math.nan):
        with pytest.raises(WorkspaceViolation, match="trial"):
            RobotGateway(stub_easel(robot), lowest=lowest).perform([motion("trial", deep)])
    assert robot.labels() == ["trial"]


@pytest.mark.parametrize("astray", [0.0021, -0.1, math.nan])
def test_after_a_motion_that_ends_elsewhere_nothing_more_is_sent(astray: float) -> None:
    gateway = RobotGateway(stub_easel(robot := NotingRobot(astray=astray)))
    with pytest.raises(PoseMismatch, match=r"first: .* from where it was sent; allowed are 2 mm"):
        gateway.perform([motion("first", 0.1), motion("second", 0.1)])
    assert robot.labels() == ["first"]
    assert gateway.last_motion == 1.0, "it moved: photographs from before are stale"


@pytest.mark.parametrize("astray", [1.0, math.nan])
def test_an_arm_that_does_not_go_aside_is_told_of(astray: float) -> None:
    with pytest.raises(PoseMismatch, match="home"):
        RobotGateway(stub_easel(NotingRobot(astray=astray))).step_aside()
    easel = stub_easel(NotingRobot(astray=0.001))
    for home, fits in (((0.0, 0.0, 0.3), True), ((0.1, 0.0, 0.3), False)):
        gateway = RobotGateway(replace(easel, workspace=replace(WORKSPACE, home=home)))
        if fits:
            gateway.step_aside()
        else:
            with pytest.raises(PoseMismatch, match=r"home: .* 99"):
                gateway.step_aside()


def test_a_stroke_that_a_person_leaves_out_is_told_of() -> None:
    class Leaving(NotingRobot):
        def follow(self, waypoints: Waypoints) -> MotionReport:
            return replace(super().follow(waypoints), left_out=waypoints.label == "b")

    gateway = RobotGateway(stub_easel(Leaving()))
    assert gateway.perform([motion("a", 0.1)]) is False
    assert gateway.perform([motion("a", 0.1), motion("b", 0.1), motion("c", 0.1)]) is True


def test_the_wait_for_a_motion_has_a_deadline(tmp_path: Path) -> None:
    hang = Hang()
    latch = Latch(tmp_path / "stub", "stub")
    guard = GuardedRobot(MisbehavingRobot("follow", hang), WORKSPACE, latch, patience=0.01, grace=0.05)
    try:
        guard.connect()
        with pytest.raises(RobotDisconnected, match=r"first: the robot did not come back"):
            RobotGateway(stub_easel(guard)).perform([motion("first", 0.2)])
    finally:
        hang.released.set()
        guard.close()


def moves(source: str) -> list[int]:
    """Lines in which a module has a robot move itself: calls of `follow` or `home` of something that is a robot."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute) and node.attr in ("follow", "home"):
            of = node.value
            name = of.attr if isinstance(of, ast.Attribute) else of.id if isinstance(of, ast.Name) else ""
            if "robot" in name.lower():
                found.append(node.lineno)
    return found


def test_nothing_moves_a_robot_but_through_the_gateway() -> None:
    moving = {place_of(path): lines for path in SOURCES if (lines := moves(path.read_text("utf-8")))}
    assert set(moving) == STAND_FOR_A_ROBOT, moving


@pytest.mark.parametrize(
    "source", ["easel.robot.follow(way)", "self._robot.home()", "robot = 1\nrobot.follow(way)", "go = a.robot.follow"]
)
def test_the_reader_of_sources_can_fail(source: str) -> None:
    assert moves(source)
    assert not moves(source.replace("robot", "page"))
