import math

import numpy as np
import pytest

from frida_painter.errors import WorkspaceViolation
from frida_painter.hardware import gateway
from frida_painter.hardware.gateway import Surface
from frida_painter.hardware.robot import ArmLength, Waypoints
from support.easel import CANVAS, WORKSPACE

INSIDE = np.array([[0.0, 0.0, 0.1], [0.1, 0.1, 0.2], [0.2, 0.1, 0.1]])


def motion(position=INSIDE, speed=0.1, label="stroke 7"):
    return Waypoints(label, np.array(position), speed)


def with_one(value, axis, point=1):
    position = INSIDE.copy()
    position[point, axis] = value
    return position


def test_what_lies_inside_may_be_sent_to_the_very_edge():
    gateway.check([], WORKSPACE)
    gateway.check([motion(), motion(np.array([WORKSPACE.lower, WORKSPACE.upper]))], WORKSPACE)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 0.1 * 1000, -0.4, 0.6])
def test_one_number_that_is_not_allowed_refuses_the_motion_and_names_it(axis, value):
    with pytest.raises(WorkspaceViolation) as refused:
        gateway.check([motion(with_one(value, axis))], WORKSPACE)
    message = str(refused.value)
    assert message.startswith(f"stroke 7: {'xyz'[axis]} = {value:.4f} m at waypoint 1; ")
    assert f"from {WORKSPACE.lower[axis]:.4f} to {WORKSPACE.upper[axis]:.4f} m" in message
    assert "Nothing was sent" in message


def test_millimetres_taken_for_metres_are_refused_on_every_waypoint():
    for point in range(len(INSIDE)):
        position = INSIDE.copy()
        position[point] *= 1000
        with pytest.raises(WorkspaceViolation, match=f"at waypoint {point}"):
            gateway.check([motion(position)], WORKSPACE)


def test_the_last_of_many_motions_counts_like_the_first():
    batch = [*(motion(label=f"stroke {number}") for number in range(20)), motion(with_one(9, 2), label="dip")]
    with pytest.raises(WorkspaceViolation, match="dip: z = 9"):
        gateway.check(iter(batch), WORKSPACE)


@pytest.mark.parametrize("speed", [0.0, -0.1, math.nan, math.inf, 60.0])
def test_speeds_that_no_painter_needs_are_refused(speed):
    with pytest.raises(WorkspaceViolation, match=r"stroke 7: a speed of .* allowed is above 0 to 1"):
        gateway.check([motion(speed=speed)], WORKSPACE)


@pytest.mark.parametrize("position", [np.zeros((0, 3)), np.zeros((4, 2)), np.zeros(3)])
def test_what_is_no_path_is_refused(position):
    with pytest.raises(WorkspaceViolation, match=r"waypoints of shape"):
        gateway.check([motion(position)], WORKSPACE)


SURFACE = Surface(CANVAS, press_height=0.09)


def over_canvas(x, y, height):
    return WORKSPACE.to_robot(np.array([[x, y], [x, y]]), np.array([0.13, height]))


@pytest.mark.parametrize(("x", "y"), [(0.06, 0.04), (0.0, 0.0), (0.125, 0.09), (-0.009, 0.05)])
def test_over_the_canvas_nothing_goes_below_the_hardest_press(x, y):
    gateway.check([motion(over_canvas(x, y, 0.09))], WORKSPACE, SURFACE)
    gateway.check([motion(over_canvas(x, y, 0.089))], WORKSPACE)
    with pytest.raises(
        WorkspaceViolation, match=r"stroke 7: z = 0\.0890 m at waypoint 1, over the canvas; .* 0\.0900 m"
    ):
        gateway.check([motion(over_canvas(x, y, 0.089))], WORKSPACE, SURFACE)


def test_beside_the_canvas_wells_may_be_deeper():
    gateway.check([motion(over_canvas(-0.03, 0.04, 0.06))], WORKSPACE, SURFACE)


def test_a_hardest_press_that_is_no_number_allows_nothing_over_the_canvas():
    with pytest.raises(WorkspaceViolation, match="over the canvas"):
        gateway.check([motion(over_canvas(0.06, 0.04, 0.1))], WORKSPACE, Surface(CANVAS, math.nan))


def test_where_the_arm_does_not_get_is_refused_and_so_is_the_last_waypoint():
    path = np.linspace((0.1, 0.1, 0.1), (0.3, 0.1, 0.1), 35)
    gateway.check([motion(path)], WORKSPACE, reach=ArmLength((0.0, 0.0, 0.1), 0.1, 0.32))
    with pytest.raises(WorkspaceViolation, match=r"stroke 7: the arm does not reach \(0\.300, 0\.100, 0\.100\)"):
        gateway.check([motion(path)], WORKSPACE, reach=ArmLength((0.0, 0.0, 0.1), 0.1, 0.315))


def test_every_motion_with_a_fault_is_told_once():
    batch = [motion(label="a"), motion(with_one(9, 0), label="b"), motion(label="c"), motion(speed=0, label="d")]
    assert [fault.label for fault in gateway.faults(batch, WORKSPACE)] == ["b", "d"]
