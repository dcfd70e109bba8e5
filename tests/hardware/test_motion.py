import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from frida_painter.errors import WorkspaceViolation
from frida_painter.hardware import gateway
from frida_painter.hardware.motion import Motion
from frida_painter.strokes import Strokes
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


def test_where_the_brush_hovers_low_it_goes_down_from_there():
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


def test_a_motion_is_called_what_it_is_for():
    assert MOTION.stroke(stroke(), 0).label == "stroke 0"
    assert MOTION.stroke(stroke(), 0, "stroke 12").label == "stroke 12"
    assert MOTION.dip(2).label == "dip into well 3"
    assert (MOTION.rinse().label, MOTION.wipe().label) == ("rinse", "wipe")


def test_a_dip_goes_straight_down_into_its_well_and_stirs_around_its_middle():
    for well, place in enumerate(WORKSPACE.wells):
        position = MOTION.dip(well).position
        assert np.allclose(position[1:-2, :2].mean(0), place[:2], atol=1e-9)
        assert np.linalg.norm(position[1:-1, :2] - place[:2], axis=1).max() < 0.01
        assert position[1:-1, 2] == pytest.approx(place[2])
        assert np.allclose(position[[0, -1]] - position[[1, -2]], (0, 0, WORKSPACE.hover))


def test_a_rinse_stirs_longer_than_a_dip():
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


def test_everything_a_painter_does_on_the_canvas_stays_in_the_workspace():
    gateway.check([MOTION.stroke(stroke(), 0), MOTION.rinse(), MOTION.wipe(), *map(MOTION.dip, range(4))], WORKSPACE)


def test_all_travel_is_above_the_highest_thing_whatever_lies_lower():
    low_wells = replace(WORKSPACE, wells=((-0.1, 0.0, 0.06),), water=(-0.2, 0.0, 0.07), rag=(-0.2, 0.2, 0.15))
    uneven = Motion(low_wells, CALIBRATION)
    assert uneven.travel_height == pytest.approx(0.15 + WORKSPACE.hover)
    for motion in (uneven.dip(0), uneven.rinse(), uneven.wipe(), uneven.stroke(stroke(), 0)):
        assert motion.position[[0, -1], 2] == pytest.approx(uneven.travel_height)
