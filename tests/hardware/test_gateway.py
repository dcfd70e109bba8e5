"""Limits of motions, and the one gate that every motion passes."""

import ast
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from frida_painter.easel.guard import GuardedRobot
from frida_painter.errors import PoseMismatch, RobotDisconnected, WorkspaceViolation
from frida_painter.hardware.gateway import Door, MotionLimits, RobotGateway, Surface
from frida_painter.hardware.latch import Latch
from frida_painter.hardware.robot import ArmLength, MotionReport, Waypoints
from frida_painter.hardware.timing import TravelLimits
from hardware.misbehaving import Hang, MisbehavingRobot
from support.easel import CALIBRATION, CANVAS, WORKSPACE, NotingRobot, stub_easel
from test_house import SOURCES, place_of

# Each of these stands for a robot and passes a motion on: the gateway, the guard of its process, painting by hand when
# the person has made it, and the studio for a person who tries it.
STAND_FOR_A_ROBOT = {"easel/guard.py", "hardware/gateway.py", "session/human.py", "virtual/studio.py"}
MIDDLE = WORKSPACE.to_robot(np.array([[CANVAS.width / 2, CANVAS.height / 2]]), np.array([0.1]))[0]
INSIDE = np.array([[0.0, 0.0, 0.1], [0.1, 0.1, 0.2], [0.2, 0.1, 0.1]])
SURFACE = Surface(CANVAS, press_height=0.09)


def way(position=INSIDE, speed=0.1, label="stroke 7"):
    return Waypoints(label, np.array(position), speed)


def motion(label: str, height: float, speed: float = 0.06) -> Waypoints:
    return way([[*MIDDLE[:2], height]], speed, label)


def with_one(value, axis, point=1):
    position = INSIDE.copy()
    position[point, axis] = value
    return position


def over_canvas(x, y, height):
    return way(WORKSPACE.to_robot(np.array([[x, y], [x, y]]), np.array([0.13, height])))


def test_what_lies_inside_may_be_sent_to_the_very_edge():
    MotionLimits(WORKSPACE).check([])
    MotionLimits(WORKSPACE).check([way(), way(np.array([WORKSPACE.lower, WORKSPACE.upper]), 1.0)])


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 0.1 * 1000, -0.4, 0.6])
def test_one_number_that_is_not_allowed_refuses_the_motion_and_names_it(axis, value):
    for point in range(3):
        with pytest.raises(WorkspaceViolation) as refused:
            MotionLimits(WORKSPACE).check([way(with_one(value, axis, point))])
        message = str(refused.value)
        assert message.startswith(f"stroke 7: {'xyz'[axis]} = {value:.4f} m at waypoint {point}; ")
        assert f"from {WORKSPACE.lower[axis]:.4f} to {WORKSPACE.upper[axis]:.4f} m" in message
        assert "Nothing was sent" in message


@pytest.mark.parametrize("speed", [0.0, -0.1, math.nan, math.inf, 60.0])
def test_speeds_that_no_painter_needs_are_refused(speed):
    with pytest.raises(WorkspaceViolation, match=r"stroke 7: a speed of .* allowed is above 0 to 1"):
        MotionLimits(WORKSPACE).check([way(speed=speed)])


@pytest.mark.parametrize("position", [np.zeros((0, 3)), np.zeros((4, 2)), np.zeros(3)])
def test_what_is_no_path_is_refused(position):
    with pytest.raises(WorkspaceViolation, match=r"waypoints of shape"):
        MotionLimits(WORKSPACE).check([way(position)])


@pytest.mark.parametrize(("x", "y"), [(0.06, 0.04), (0.0, 0.0), (0.125, 0.09), (-0.009, 0.05)])
def test_over_the_canvas_nothing_goes_below_the_hardest_press_and_wells_beside_it_may_be_deeper(x, y):
    MotionLimits(WORKSPACE, SURFACE).check([over_canvas(x, y, 0.09), over_canvas(-0.03, 0.04, 0.06)])
    MotionLimits(WORKSPACE).check([over_canvas(x, y, 0.089)])
    says = r"stroke 7: z = 0\.0890 m at waypoint 1, over the canvas; .* 0\.0900 m"
    with pytest.raises(WorkspaceViolation, match=says):
        MotionLimits(WORKSPACE, SURFACE).check([over_canvas(x, y, 0.089)])
    with pytest.raises(WorkspaceViolation, match="over the canvas"):
        MotionLimits(WORKSPACE, Surface(CANVAS, math.nan)).check([over_canvas(x, y, 0.1)])


def test_where_the_arm_does_not_get_is_refused_and_so_is_the_last_waypoint():
    path = np.linspace((0.1, 0.1, 0.1), (0.3, 0.1, 0.1), 35)
    MotionLimits(WORKSPACE, reach=ArmLength((0.0, 0.0, 0.1), 0.1, 0.32)).check([way(path)])
    with pytest.raises(WorkspaceViolation, match=r"stroke 7: the arm does not reach \(0\.300, 0\.100, 0\.100\)"):
        MotionLimits(WORKSPACE, reach=ArmLength((0.0, 0.0, 0.1), 0.1, 0.315)).check([way(path)])
    with pytest.raises(WorkspaceViolation, match=r"stroke 7: x = 0\.2059 m at waypoint 18; the machine's own limits"):
        MotionLimits(WORKSPACE, travel=TravelLimits((-1.0, -1.0, -1.0), (0.205, 1.0, 1.0))).check([way(path)])


def test_every_motion_with_a_fault_is_told_once():
    batch = [way(label="a"), way(with_one(9, 0), 9.0, label="b"), way(label="c"), way(speed=0, label="d")]
    assert [fault.label for fault in MotionLimits(WORKSPACE).faults(iter(batch))] == ["b", "d"]


def test_motions_are_sent_in_order_and_the_last_one_is_remembered() -> None:
    class Leaving(NotingRobot):
        def follow(self, waypoints: Waypoints) -> MotionReport:
            return replace(super().follow(waypoints), left_out=waypoints.label == "c")

    gate = RobotGateway(stub_easel(robot := Leaving(now=10.0)))
    assert gate.last_motion == 0.0
    assert gate.perform(iter([motion("a", 0.1), motion("b", 0.12)])) is False
    assert robot.labels() == ["a", "b"] and gate.last_motion == 12.0
    gate.step_aside()
    assert robot.labels()[-1] == "home" and gate.last_motion == 13.0
    np.testing.assert_array_equal(gate.pose(), (0.0, 0.0, 0.3))
    assert gate.perform([motion("b", 0.1), motion("c", 0.1), motion("d", 0.1)]) is True, "a person left one out"


@pytest.mark.parametrize(
    ("forbidden", "says"),
    [
        (motion("bad", CALIBRATION.press_height - 0.001), "bad: z = 0.0890 m .* the hardest press is at 0.0900 m"),
        (motion("bad", math.nan), "bad: z = nan"),
        (motion("bad", 0.1, speed=math.nan), "bad: a speed of nan"),
        (Waypoints("bad", np.array([WORKSPACE.wells[0]]), 0.2), "bad: the arm does not reach"),
        (Waypoints("bad", np.empty((0, 3)), 0.2), "bad: waypoints of shape"),
    ],
)
def test_a_batch_of_which_one_motion_is_not_allowed_is_not_begun(forbidden: Waypoints, says: str) -> None:
    easel = replace(stub_easel(robot := NotingRobot()), reach=ArmLength((*MIDDLE[:2], 0.1), 0.0, 0.04))
    gate = RobotGateway(easel)
    for refused in (gate.perform, gate.check):
        with pytest.raises(WorkspaceViolation, match=rf"{says}.*Nothing was sent"):
            refused([motion("good", 0.1), forbidden])
    assert robot.motions == [] and gate.last_motion == 0.0


def test_a_brush_that_touches_lower_may_go_as_much_lower_and_no_more() -> None:
    gate = RobotGateway(stub_easel(robot := NotingRobot()))
    lower = motion("lower", CALIBRATION.press_height - 0.001)
    for not_enough in (0.0, 0.0009, -0.001, math.nan):
        gate.follow_touch(not_enough)
        with pytest.raises(WorkspaceViolation, match=r"lower: z = 0\.0890 m"):
            gate.perform([lower])
    gate.follow_touch(0.001)
    gate.perform([lower])
    gate.follow_touch(-0.001)
    gate.perform([motion("hardest press", CALIBRATION.press_height)])
    assert robot.labels() == ["lower", "hardest press"]


def test_what_a_door_allowed_is_checked_anew_when_a_limit_changes() -> None:
    door = Door(MotionLimits(WORKSPACE, SURFACE))
    deep, stated = motion("trial", 0.08), replace(SURFACE, press_height=0.08)
    for change in (
        lambda: door.learn_travel(None),
        lambda: door.allow((), WORKSPACE, SURFACE),
        lambda: door.allow((), replace(WORKSPACE, upper=(0.3, 0.3, 0.2)), stated),
    ):
        door.allow((deep,), WORKSPACE, stated)
        door.require_allowed(replace(deep, label="by another name"))
        for other in (replace(deep, speed=0.05), motion("trial", 0.0799)):
            with pytest.raises(WorkspaceViolation, match="over the canvas"):
                door.require_allowed(other)
        change()
        with pytest.raises(WorkspaceViolation, match="over the canvas"):
            door.require_allowed(deep)
    door.learn_travel(TravelLimits((-1.0, -1.0, 0.1), (1.0, 1.0, 1.0)))
    with pytest.raises(WorkspaceViolation, match="the machine's own limits"):
        door.allow((deep,), WORKSPACE, stated)


def test_whoever_finds_the_hardest_press_names_another_lowest_height() -> None:
    deep, floor = CALIBRATION.press_height - 0.01, WORKSPACE.lower[2]
    RobotGateway(stub_easel(robot := NotingRobot()), lowest=floor).perform([motion("trial", deep)])
    for lowest in (deep + 0.001, math.nan):
        with pytest.raises(WorkspaceViolation, match="trial"):
            RobotGateway(stub_easel(robot), lowest=lowest).perform([motion("trial", deep)])
    assert robot.labels() == ["trial"]


@pytest.mark.parametrize("astray", [0.0021, -0.1, math.nan])
def test_after_a_motion_that_ends_elsewhere_nothing_more_is_sent(astray: float) -> None:
    gate = RobotGateway(stub_easel(robot := NotingRobot(astray=astray)))
    with pytest.raises(PoseMismatch, match=r"first: .* from where it was sent; allowed are 2 mm"):
        gate.perform([motion("first", 0.1), motion("second", 0.1)])
    assert robot.labels() == ["first"]
    assert gate.last_motion == 1.0, "it moved: photographs from before are stale"


@pytest.mark.parametrize("astray", [1.0, math.nan])
def test_an_arm_that_does_not_go_aside_is_told_of(astray: float) -> None:
    with pytest.raises(PoseMismatch, match="home"):
        RobotGateway(stub_easel(NotingRobot(astray=astray))).step_aside()
    easel = stub_easel(NotingRobot(astray=0.001))
    RobotGateway(replace(easel, workspace=replace(WORKSPACE, home=(0.0, 0.0, 0.3)))).step_aside()
    with pytest.raises(PoseMismatch, match=r"home: .* 99"):
        RobotGateway(replace(easel, workspace=replace(WORKSPACE, home=(0.1, 0.0, 0.3)))).step_aside()


def test_the_wait_for_a_motion_has_a_deadline(tmp_path: Path) -> None:
    hang = Hang()
    latch = Latch(tmp_path / "stub", "stub")
    guard = GuardedRobot(MisbehavingRobot("follow", hang), MotionLimits(WORKSPACE), latch, patience=0.01, grace=0.05)
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
    for source in (
        "easel.robot.follow(way)",
        "self._robot.home()",
        "robot = 1\nrobot.follow(way)",
        "go = a.robot.home",
    ):
        assert moves(source) and not moves(source.replace("robot", "page"))
