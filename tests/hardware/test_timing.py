import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from frida_painter.hardware.robot import Timing

TIMING = Timing(acceleration=0.8, smoothing=0.06, period=0.01)
METRES = st.floats(-0.3, 0.3)


def polyline(count):
    return arrays(float, (count, 3), elements=METRES)


def off_the_line(places, path):
    """Distance of every place to the nearest piece of the path."""
    start, way = path[:-1], np.diff(path, axis=0)
    share = ((places[:, None] - start) * way).sum(-1) / np.maximum((way**2).sum(-1), 1e-30)
    nearest = start + np.clip(share, 0, 1)[..., None] * way
    return np.linalg.norm(places[:, None] - nearest, axis=-1).min(1)


@given(polyline(5), st.floats(0.02, 0.3))
def test_the_tip_stays_on_the_path_within_speed_and_ends_at_its_ends(path, speed):
    places = TIMING.places(path, np.full(len(path) - 1, speed))
    np.testing.assert_allclose(places[[0, -1]], path[[0, -1]], atol=1e-7)
    assert off_the_line(places, path).max() < 1e-6
    assert (np.linalg.norm(np.diff(places, axis=0), axis=1) <= speed * TIMING.period + 1e-9).all()


def test_a_straight_way_starts_and_stops_gently():
    places = TIMING.places(np.array([[0, 0, 0], [0.2, 0, 0.0]]), np.array([0.25]))
    speed = np.diff(places[:, 0]) / TIMING.period
    force = np.diff(np.r_[0, speed, 0]) / TIMING.period
    assert np.abs(force).max() <= TIMING.acceleration + 1e-6
    assert np.abs(np.diff(force)).max() <= TIMING.acceleration * TIMING.period / TIMING.smoothing + 1e-6
    assert speed.max() == pytest.approx(0.25, abs=1e-6)


def test_a_sharp_corner_is_a_stop_and_a_gentle_bend_is_not():
    def slowest_inside(turn):
        corner = np.array([0.1, 0, 0])
        path = np.array([[0, 0, 0], corner, corner + 0.1 * np.array([np.cos(turn), np.sin(turn), 0])])
        speed = np.linalg.norm(np.diff(TIMING.places(path, np.full(2, 0.06)), axis=0), axis=1) / TIMING.period
        middle = len(speed) // 2
        return speed[middle - 20 : middle + 20].min()

    assert slowest_inside(np.radians(90)) < 0.02
    assert slowest_inside(np.radians(3)) > 0.055


def test_no_way_to_go_is_one_place():
    assert TIMING.places(np.zeros((3, 3)), np.full(2, 0.1)).shape == (1, 3)
