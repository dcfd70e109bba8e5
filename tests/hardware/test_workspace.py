import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.hardware.robot import Waypoints
from support.easel import WORKSPACE

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


@given(st.floats(-math.pi, math.pi), st.floats(0.01, 1))
def test_the_lower_edge_heads_along_the_canvas_angle(angle, along):
    origin, end = placed(np.array([(0.0, 0.0), (along, 0.0)]), angle)[:, :2]
    assert np.allclose(origin, WORKSPACE.canvas_origin[:2])
    assert np.allclose(end - origin, (along * math.cos(angle), along * math.sin(angle)), atol=1e-12)


def test_up_on_the_canvas_is_left_of_its_lower_edge():
    start, up = placed(np.array([(0.0, 0.0), (0.0, 0.1)]), angle=math.pi / 2)[:, :2]
    assert up - start == pytest.approx((-0.1, 0.0))


def test_heights_are_the_robots_own():
    there = WORKSPACE.to_robot(np.zeros((3, 2)), np.array([0.11, 0.1, 0.09]))
    assert there[:, 2].tolist() == [0.11, 0.1, 0.09]


def test_the_length_of_a_path_is_measured_in_space():
    path = np.array([(0.0, 0.0, 0.0), (0.3, 0.4, 0.0), (0.3, 0.4, 1.2)])
    assert Waypoints("there", path, 0.1).length == pytest.approx(1.7)


@given(points, st.floats(-math.pi, math.pi))
def test_the_way_back_to_the_canvas_is_the_way_there(position, angle):
    workspace = replace(WORKSPACE, canvas_angle=angle)
    there = workspace.to_robot(position, np.full(len(position), 0.1))
    assert np.allclose(workspace.to_canvas(there), position, atol=1e-12)


def test_the_top_is_the_highest_thing():
    assert WORKSPACE.top == 0.1
    assert replace(WORKSPACE, rag=(0.0, 0.0, 0.13)).top == 0.13
