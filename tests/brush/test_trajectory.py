import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.brush.kinds import pressure, stroke_path
from frida_painter.errors import PlanError
from frida_painter.strokes import Strokes


def one(x: float, y: float, angle: float, length: float, bend: float, thickness: float) -> Strokes:
    return Strokes(
        position=torch.tensor([[x, y]], dtype=torch.float64),
        angle=torch.tensor([angle], dtype=torch.float64),
        length=torch.tensor([length], dtype=torch.float64),
        bend=torch.tensor([bend], dtype=torch.float64),
        thickness=torch.tensor([thickness], dtype=torch.float64),
        color=torch.zeros(1, 3, dtype=torch.float64),
    )


@given(
    angle=st.floats(-7, 7),
    length=st.floats(0.001, 0.2),
    bend=st.floats(-0.05, 0.05),
    step=st.floats(0.0005, 0.05),
)
def test_points_start_and_end_where_they_must_and_never_lie_further_apart_than_the_step(angle, length, bend, step):
    position, thickness = stroke_path(one(0.1, 0.2, angle, length, bend, 0.7), 0, step)
    np.testing.assert_allclose(position[0], [0.1, 0.2])
    end = [0.1 + length * math.cos(angle), 0.2 + length * math.sin(angle)]
    np.testing.assert_allclose(position[-1], end, atol=1e-12)
    assert np.linalg.norm(np.diff(position, axis=0), axis=1).max() <= step
    assert len(position) == len(thickness)


def test_the_path_is_the_bezier_of_the_plan():
    stroke = one(0.1, 0.2, 0.5, 0.06, 0.02, 0.5)
    position, _ = stroke_path(stroke, 0, 0.0005)
    wanted = stroke.path(torch.linspace(0, 1, 4001, dtype=torch.float64))[0].numpy()
    away = np.linalg.norm(position[:, None] - wanted, axis=-1).min(1)
    assert away.max() < 2e-5


def test_points_are_evenly_spaced_along_the_arc():
    position, _ = stroke_path(one(0, 0, 0, 0.02, 0.03, 0.5), 0, 0.0005)
    gaps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    assert gaps.std() / gaps.mean() < 0.02


def test_thickness_runs_from_a_fifth_to_the_strokes_own_and_back():
    _, thickness = stroke_path(one(0, 0, 0, 0.04, 0, 0.9), 0, 0.001)
    assert thickness[0] == thickness[-1] == pytest.approx(0.2)
    assert thickness.max() == pytest.approx(0.2 * 0.25 + 0.9 * 0.75, abs=1e-3)
    np.testing.assert_allclose(thickness, thickness[::-1], atol=1e-3)


def test_a_bend_above_zero_goes_to_the_left_of_the_heading():
    position, _ = stroke_path(one(0, 0, math.pi / 2, 0.04, 0.01, 0.5), 0)
    assert position[:, 0].min() == pytest.approx(-0.0075, abs=1e-4)
    assert position[:, 0].max() < 1e-9


@pytest.mark.parametrize("thickness", [0.0, 0.2, 1.0])
def test_pressure_stays_between_its_ends(thickness):
    values = pressure(np.linspace(0, 1, 50), thickness)
    assert min(0.2, thickness) - 1e-12 <= values.min() <= values.max() <= max(0.2, thickness) + 1e-12


def test_a_stroke_of_no_length_is_a_dab():
    position, thickness = stroke_path(one(0.1, 0.1, 0, 0, 0, 0.5), 0)
    assert len(position) == len(thickness) == 2


@pytest.mark.parametrize("step", [0.0, -1.0, math.nan, math.inf])
def test_a_step_that_is_none_is_refused(step):
    with pytest.raises(PlanError, match="step"):
        stroke_path(one(0, 0, 0, 0.02, 0, 0.5), 0, step)


@pytest.mark.parametrize("index", [-1, 1])
def test_a_stroke_that_is_not_there_is_refused(index):
    with pytest.raises(PlanError, match="there are 1"):
        stroke_path(one(0, 0, 0, 0.02, 0, 0.5), index)


@pytest.mark.parametrize("stroke", [one(math.nan, 0, 0, 0.02, 0, 0.5), one(0, 0, 0, 0.02, 0, math.nan)])
def test_nan_is_refused(stroke):
    with pytest.raises(PlanError, match="not finite"):
        stroke_path(stroke, 0)
