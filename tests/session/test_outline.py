"""Outlines of canvas and painting, traced in the air."""

from dataclasses import replace

import numpy as np
import pytest

from frida_painter.errors import WorkspaceViolation
from frida_painter.session.outline import outline_strokes, plan_outlines, trace_outlines
from support.easel import CALIBRATION, CANVAS, WORKSPACE, NotingRobot, PatientCamera, stub_easel
from support.plans import made_up_plan


def test_the_tip_goes_round_the_canvas_at_hover_height_from_its_corner() -> None:
    easel = stub_easel(NotingRobot(), PatientCamera())
    motions = plan_outlines(easel)
    assert [each.label for each in motions] == [
        "to the canvas", *(f"side {number} of 4 of the canvas" for number in (1, 2, 3, 4)), "up from the canvas",
    ]  # fmt: skip
    x, y = WORKSPACE.canvas_origin[:2]
    cos, sin = np.cos(WORKSPACE.canvas_angle), np.sin(WORKSPACE.canvas_angle)
    for motion, (u, v) in zip(
        motions[1:5], [(1, 0), (1, 1), (0, 1), (0, 0)], strict=True
    ):  # the end of each side, as the workspace has it
        right, up = u * CANVAS.width, v * CANVAS.height
        wanted = (x + cos * right - sin * up, y + sin * right + cos * up)
        assert motion.position[-1, :2] == pytest.approx(wanted, abs=1e-9)
        assert motion.position[:, 2] == pytest.approx(CALIBRATION.touch_height + WORKSPACE.hover)
        assert np.linalg.norm(np.diff(motion.position, axis=0), axis=1).max() <= 0.010001


def test_the_outline_of_a_painting_holds_all_of_its_strokes() -> None:
    plan = made_up_plan(30)
    outline = outline_strokes(plan)
    side, places = np.roll(outline, -1, 0) - outline, plan.strokes.extremes().reshape(-1, 2).numpy()
    left = (
        side[:, None, 0] * (places - outline[:, None])[..., 1] - side[:, None, 1] * (places - outline[:, None])[..., 0]
    )
    assert (left >= -1e-5).all(), "every stroke lies to the left of every side"
    assert not plan_outlines(stub_easel(NotingRobot(), PatientCamera()), plan.part(slice(0)))[6:]


def test_it_can_be_stopped_between_two_sides_and_goes_aside_then() -> None:
    robot, told = NotingRobot(), []
    easel = stub_easel(robot, PatientCamera())
    assert not trace_outlines(easel, plan_outlines(easel), told.append, lambda: len(told) == 3)
    assert told == ["to the canvas", "side 1 of 4 of the canvas", "side 2 of 4 of the canvas"]
    assert robot.labels() == [*told, "home"]


def test_nothing_moves_if_a_part_lies_outside_the_workspace() -> None:
    robot = NotingRobot()
    easel = stub_easel(robot, PatientCamera())
    easel = replace(easel, workspace=replace(easel.workspace, upper=(0.15, 0.5, 0.4)))
    with pytest.raises(WorkspaceViolation, match="side 1 of 4 of the canvas"):
        trace_outlines(easel, plan_outlines(easel), print, lambda: False)
    assert robot.motions == []
