"""Motions of a painting, in the workspace of a robot."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.errors import WorkspaceViolation
from frida_painter.hardware.gateway import MotionLimits
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import ArmLength, Waypoints
from frida_painter.strokes.strokes import Strokes
from support.easel import CALIBRATION, WORKSPACE

MOTION = Motion(WORKSPACE, CALIBRATION)
HOVER = CALIBRATION.touch_height + WORKSPACE.hover
PRESS = CALIBRATION.touch_height - CALIBRATION.press_height


def stroke(thickness=0.8, bend=0.0, angle=0.0, length=0.04, x=0.03, y=0.02):
    number = [torch.tensor([part], dtype=torch.float64) for part in (angle, length, bend, thickness)]
    return Strokes(torch.tensor([[x, y]], dtype=torch.float64), *number, torch.zeros(1, 3, dtype=torch.float64))


def on_canvas(position, workspace=WORKSPACE):
    """Back from the robot's frame, written without the code that is tested."""
    offset = position[:, :2] - np.array(workspace.canvas_origin[:2])
    turn = complex(math.cos(workspace.canvas_angle), -math.sin(workspace.canvas_angle))
    back = (offset[:, 0] + 1j * offset[:, 1]) * turn
    return np.stack((back.real, back.imag), 1)


def test_a_stroke_goes_down_along_its_path_and_up():
    waypoints = MOTION.stroke(stroke(bend=0.01, angle=0.7), 0)
    path = on_canvas(waypoints.position)
    assert np.allclose(path[:2], (0.03, 0.02)), "it hovers over its start, then goes down there"
    end = (0.03 + 0.04 * math.cos(0.7), 0.02 + 0.04 * math.sin(0.7))
    assert np.allclose(path[-2:], end), "it goes up where it ends"
    height = waypoints.position[:, 2]
    assert height[[0, -1]] == pytest.approx(HOVER)
    assert (height[1:-1] <= CALIBRATION.touch_height).all()
    assert (np.linalg.norm(np.diff(waypoints.position[1:-1], axis=0), axis=1) < 0.0015).all()
    assert waypoints.speed == WORKSPACE.painting_speed


def test_a_swift_stroke_makes_the_same_mark_and_only_its_last_bit_down_and_up_is_slow():
    slow = MOTION.stroke(stroke(bend=0.01, angle=0.7), 0)
    above, swift, up = MOTION.swift_stroke(stroke(bend=0.01, angle=0.7), 0, "stroke 3")
    assert [above.label, swift.label, up.label] == ["above stroke 3", "stroke 3", "up from stroke 3"]
    assert np.array_equal(above.position[0], slow.position[0]) and np.array_equal(up.position[0], slow.position[-1])
    assert np.array_equal(swift.position[1:-1], slow.position[1:-1]) and swift.speed == WORKSPACE.painting_speed
    assert np.array_equal(swift.position[[0, -1], :2], slow.position[[0, -1], :2])
    assert swift.position[[0, -1], 2] == pytest.approx(CALIBRATION.touch_height + 0.005)
    assert above.speed == up.speed == WORKSPACE.travel_speed
    low = Motion(replace(WORKSPACE, hover=0.003), CALIBRATION)
    above, swift, up = low.swift_stroke(stroke(), 0, "stroke 1")
    assert np.array_equal(above.position[0], swift.position[0]) and np.array_equal(up.position[0], swift.position[-1])


def test_the_path_bends_to_the_left_of_its_heading():
    path = on_canvas(MOTION.stroke(stroke(bend=0.012), 0).position)
    assert path[:, 1].max() == pytest.approx(0.02 + 0.75 * 0.012, abs=1e-5)
    assert path[:, 1].min() == pytest.approx(0.02)


@pytest.mark.parametrize("thickness", [0.0, 0.5, 1.0])
def test_the_brush_touches_and_leaves_at_a_fifth_of_the_press_and_reaches_its_thickness_in_the_middle(thickness):
    height = MOTION.stroke(stroke(thickness), 0).position[1:-1, 2]
    pressed = (CALIBRATION.touch_height - height) / PRESS
    assert pressed[[0, -1]] == pytest.approx(0.2)
    assert pressed[len(pressed) // 2] == pytest.approx(0.25 * 0.2 + 0.75 * thickness, abs=2e-3)


def test_the_robot_is_sent_where_the_calibration_says():
    moved = replace(CALIBRATION, placement=((1.0, 0.0, 0.004), (0.0, 1.0, -0.002), (0.0, 0.0, 1.0)))
    there = on_canvas(Motion(WORKSPACE, moved).stroke(stroke(), 0).position)
    assert np.allclose(there - on_canvas(MOTION.stroke(stroke(), 0).position), (0.004, -0.002))


def test_a_motion_is_called_what_it_is_for_and_stays_in_the_workspace():
    motions = MOTION.stroke(stroke(), 0), MOTION.stroke(stroke(), 0, "stroke 12"), MOTION.rinse(), MOTION.wipe()
    MotionLimits(WORKSPACE).check([*motions, *map(MOTION.dip, range(4))])
    assert [motion.label for motion in motions] == ["stroke 0", "stroke 12", "rinse", "wipe"]
    assert MOTION.dip(2).label == "dip into well 3" and MOTION.dip(2).cue == ("dip", "3")


def test_a_dip_goes_straight_down_into_its_well_and_stirs_around_its_middle():
    for well, place in enumerate(WORKSPACE.wells):
        position = MOTION.dip(well).position
        assert np.allclose(position[1:-2, :2].mean(0), place[:2], atol=1e-9)
        assert np.linalg.norm(position[1:-1, :2] - place[:2], axis=1).max() < 0.01
        assert position[1:-1, 2] == pytest.approx(place[2])
        assert np.allclose(position[[0, -1]] - position[[1, -2]], (0, 0, WORKSPACE.hover))
    assert MOTION.rinse().length > 2 * MOTION.dip(0).length - 4 * WORKSPACE.hover
    assert np.allclose(MOTION.rinse().position[1:-2, :2].mean(0), WORKSPACE.water[:2], atol=1e-9)


def test_a_wipe_crosses_the_rag_several_times():
    x, y, z = WORKSPACE.rag
    on_rag = MOTION.wipe().position[1:-1]
    assert np.allclose(on_rag[:, 1:], (y, z))
    assert (on_rag[:, 0].min(), on_rag[:, 0].max()) == pytest.approx((x - 0.04, x + 0.04))
    assert (np.abs(np.diff(on_rag[:, 0])) > 0.07).sum() >= 3


@pytest.mark.parametrize("well", [-1, 4, 63])
def test_a_well_that_is_not_there_is_named_and_so_is_what_to_do(well):
    with pytest.raises(WorkspaceViolation, match=rf"well {well + 1} was wanted.* 4 wells; use fewer colours"):
        MOTION.dip(well)


def test_all_travel_is_above_the_highest_thing_whatever_lies_lower():
    low_wells = replace(WORKSPACE, wells=((-0.1, 0.0, 0.06),), water=(-0.2, 0.0, 0.07), rag=(-0.2, 0.2, 0.15))
    uneven = Motion(low_wells, CALIBRATION)
    assert uneven.travel_height == pytest.approx(0.15 + WORKSPACE.hover)
    for motion in (uneven.dip(0), uneven.rinse(), uneven.wipe(), uneven.stroke(stroke(), 0)):
        assert motion.position[[0, -1], 2] == pytest.approx(uneven.travel_height)


# The workspace.

metres = st.floats(-1, 1)
points = st.lists(st.tuples(metres, metres), min_size=2, max_size=6).map(np.array)


def placed(position, angle=0.3, height=0.1):
    workspace = replace(WORKSPACE, canvas_angle=angle)
    return workspace.to_robot(position, np.full(len(position), height))


@given(points, st.floats(-math.pi, math.pi))
def test_a_canvas_is_turned_and_moved_but_neither_stretched_nor_mirrored(position, angle):
    there = placed(position, angle)
    between = np.diff(position, axis=0), np.diff(there[:, :2], axis=0)
    assert np.allclose(*(np.linalg.norm(step, axis=1) for step in between), atol=1e-12)
    cross = [step[:-1, 0] * step[1:, 1] - step[:-1, 1] * step[1:, 0] for step in between]
    assert np.allclose(*cross, atol=1e-12)
    assert np.allclose(replace(WORKSPACE, canvas_angle=angle).to_canvas(there), position, atol=1e-12)


@given(st.floats(-math.pi, math.pi), st.floats(0.01, 1))
def test_the_lower_edge_heads_along_the_canvas_angle(angle, along):
    origin, end = placed(np.array([(0.0, 0.0), (along, 0.0)]), angle)[:, :2]
    assert np.allclose(origin, WORKSPACE.canvas_origin[:2])
    assert np.allclose(end - origin, (along * math.cos(angle), along * math.sin(angle)), atol=1e-12)


def test_up_on_the_canvas_is_left_of_its_lower_edge():
    start, up = placed(np.array([(0.0, 0.0), (0.0, 0.1)]), angle=math.pi / 2)[:, :2]
    assert up - start == pytest.approx((-0.1, 0.0))
    assert WORKSPACE.to_robot(np.zeros((3, 2)), np.array([0.11, 0.1, 0.09]))[:, 2].tolist() == [0.11, 0.1, 0.09]


def test_the_length_of_a_path_is_measured_in_space():
    path = np.array([(0.0, 0.0, 0.0), (0.3, 0.4, 0.0), (0.3, 0.4, 1.2)])
    assert Waypoints("there", path, 0.1).length == pytest.approx(1.7)


def test_the_top_is_the_highest_thing():
    assert WORKSPACE.top == 0.1
    assert replace(WORKSPACE, rag=(0.0, 0.0, 0.13)).top == 0.13


def test_an_arm_gets_between_two_spheres_around_its_shoulder() -> None:
    arm = ArmLength((0.1, 0.0, 0.2), 0.2, 0.5)
    places = np.array([[0.1, 0.0, 0.2], [0.35, 0.0, 0.2], [0.61, 0.0, 0.2], [0.1, 0.3, 0.6], [np.nan, 0.0, 0.0]])
    assert arm.reachable(places).tolist() == [False, True, False, True, False]
