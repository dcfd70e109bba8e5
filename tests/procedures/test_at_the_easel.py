from dataclasses import replace

import numpy as np
import pytest

from frida_painter.easel.dialogue import lead
from frida_painter.errors import StaleFrame, WorkspaceViolation
from frida_painter.hardware.robot import ArmLength, Waypoints
from frida_painter_calibration.procedures.paper import EaselAccess
from frida_painter_calibration.procedures.robot import robot
from frida_painter_calibration.procedures.strokes import strokes
from papers import KIND, paper_studio, proposed
from support.easel import NotingRobot, PatientCamera, stub_easel

ANYWHERE = [Waypoints("dip", np.array([[-0.1, 0.0, 0.1]]), 0.2)]


def test_a_photograph_is_taken_with_the_arm_aside_and_is_newer_than_its_last_motion() -> None:
    noting, camera = NotingRobot(now=5.0), PatientCamera()
    access = EaselAccess(stub_easel(noting, camera))
    access.gateway.perform(ANYWHERE)
    assert access.photograph().captured_at == 7.5
    assert noting.labels() == ["dip", "home"] and camera.asked == [7.0]


def test_a_photograph_that_was_seen_before_is_stale_for_procedures_too() -> None:
    access = EaselAccess(stub_easel(camera=PatientCamera([(4.0, 8), *3 * [(9.0, 8)]])))
    access.photograph()
    with pytest.raises(StaleFrame, match="asked 3 times"):
        access.photograph()


def test_a_library_and_a_calibration_are_refused_where_the_arm_does_not_reach_the_well() -> None:
    studio = paper_studio()
    easel, sent = studio.easel, []
    follow = studio.robot.follow
    studio.robot.follow = lambda waypoints: (sent.append(waypoints.label), follow(waypoints))[1]
    middle = easel.workspace.to_robot(np.array([[easel.canvas.width / 2, easel.canvas.height / 2]]), np.zeros(1))[0]
    short = replace(easel, reach=ArmLength((float(middle[0]), float(middle[1]), easel.workspace.top), 0.0, 0.1))
    for procedure in (strokes(short, KIND, count=1), robot(short)):
        with pytest.raises(WorkspaceViolation, match="dip into well 1: the arm does not reach"):
            lead(procedure, proposed)
    assert set(sent) == {"home"}


def test_a_library_is_refused_where_its_strokes_press_deeper_than_the_record_allows() -> None:
    studio = paper_studio()
    easel, sent = studio.easel, []
    follow = studio.robot.follow
    studio.robot.follow = lambda waypoints: (sent.append(waypoints.label), follow(waypoints))[1]

    class Deeper(type(easel.calibration)):
        """A record that answers with heights below its own hardest press."""

        def height(self, thickness):
            return super().height(thickness) - 0.02

    record = Deeper(**vars(easel.calibration))
    low = replace(easel.workspace, lower=(*easel.workspace.lower[:2], easel.workspace.lower[2] - 0.1))
    with pytest.raises(WorkspaceViolation, match=r"stroke for the library: z = .* over the canvas; the hardest press"):
        lead(strokes(replace(easel, calibration=record, workspace=low), KIND, count=1), proposed)
    assert set(sent) == {"home"}
