"""What the driver of Franka arms knows without franky and an arm: its reach, and paths that go on."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter_drivers.franka import FrankaReach, resume_path
from machines.franky_arm import tip_positions


@given(
    radius=st.floats(0.05, 1.0), azimuth=st.floats(-3.1, 3.1), height=st.floats(-0.3, 0.9),
    brush=st.floats(0.0, 0.3), turn=st.floats(-90, 90),
)  # fmt: skip
def test_the_reach_that_is_known_before_agrees_with_the_published_table(
    radius: float, azimuth: float, height: float, brush: float, turn: float
) -> None:
    place = np.array([[radius * np.cos(azimuth), radius * np.sin(azimuth), height]])
    reach = FrankaReach(brush, turn)
    joints = reach.solve(place)
    if np.isnan(joints).any():
        assert not reach.reachable(place)[0]
        return
    assert tip_positions(joints, brush) == pytest.approx(place, abs=1e-9)
    assert tip_positions(joints, brush + 1.0) == pytest.approx(place - (0, 0, 1), abs=1e-9)  # upright


@given(left=st.integers(0, 80), off=st.floats(-0.01, 0.01), seed=st.integers(0, 9))
def test_a_path_that_goes_on_begins_at_rest_where_the_arm_is_and_ends_as_before(
    left: int, off: float, seed: int
) -> None:
    share = np.linspace(0, 1, 101)[:, None]
    joints = (share**2 * (3 - 2 * share) * np.random.default_rng(seed).uniform(-1, 1, 7))[100 - left :]
    rest = resume_path(joints, joints[0] + off)
    assert rest[0] == pytest.approx(joints[0] + off) and rest[-1] == pytest.approx(joints[-1])
    steps = np.diff(rest, axis=0)
    fastest = np.abs(np.diff(joints, axis=0)).max(initial=0)
    assert np.abs(steps).max() <= fastest + 0.1 * abs(off) + 1e-12
    assert np.abs(steps[0]).max() <= 0.1 * fastest + 0.01 * abs(off) + 1e-12
    assert len(rest) <= left + 1 + 20
