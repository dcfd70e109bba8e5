from dataclasses import replace

import numpy as np
import pytest

from easels import CALIBRATION, CANVAS, WORKSPACE, NotingRobot, stub_easel
from frida_painter.errors import WorkspaceViolation
from frida_painter.hardware.reach import ArmLength
from frida_painter.hardware.robot import Waypoints
from frida_painter.session.procedures.at_the_easel import perform
from frida_painter.session.procedures.dialogue import lead
from frida_painter.session.procedures.robot import robot
from frida_painter.session.procedures.strokes import strokes
from papers import KIND, paper_studio, proposed

OVER_CANVAS = WORKSPACE.to_robot(np.array([[CANVAS.width / 2, CANVAS.height / 2]]), np.array([0.13]))


def motion(label: str, height: float) -> Waypoints:
    return Waypoints(label, np.array([[*OVER_CANVAS[0, :2], height]]), 0.06)


@pytest.mark.parametrize("height", [CALIBRATION.press_height - 0.001, WORKSPACE.lower[2], float("nan")])
def test_nothing_is_sent_where_one_motion_presses_deeper_than_the_record_allows(height: float) -> None:
    noting = NotingRobot()
    with pytest.raises(WorkspaceViolation, match=r"stroke 2: z = .*Nothing was sent"):
        perform(stub_easel(noting), [motion("stroke 1", 0.1), motion("stroke 2", height)])
    assert noting.motions == []


def test_nothing_is_sent_where_one_motion_is_out_of_the_arm_s_reach() -> None:
    noting = NotingRobot()
    easel = replace(stub_easel(noting), reach=ArmLength((*OVER_CANVAS[0, :2], 0.1), 0.0, 0.04))
    far = Waypoints("dip into well 1", np.array([WORKSPACE.wells[0]]), 0.2)
    with pytest.raises(WorkspaceViolation, match=r"dip into well 1: the arm does not reach .*Nothing was sent"):
        perform(easel, [motion("stroke 1", 0.1), far])
    assert noting.motions == []


def test_a_stroke_library_is_refused_where_the_arm_does_not_reach_the_well() -> None:
    studio = paper_studio()
    easel, sent = studio.easel, []
    follow = studio.robot.follow
    studio.robot.follow = lambda waypoints: (sent.append(waypoints.label), follow(waypoints))[1]
    middle = easel.workspace.to_robot(np.array([[easel.canvas.width / 2, easel.canvas.height / 2]]), np.zeros(1))[0]
    short = replace(easel, reach=ArmLength((float(middle[0]), float(middle[1]), easel.workspace.top), 0.0, 0.1))
    with pytest.raises(WorkspaceViolation, match="dip into well 1: the arm does not reach"):
        lead(strokes(short, KIND, count=1), proposed)
    with pytest.raises(WorkspaceViolation, match="dip into well 1: the arm does not reach"):
        lead(robot(short), proposed)
    assert set(sent) == {"home"}
