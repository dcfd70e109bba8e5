from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from frida_painter.errors import ConfigError
from frida_painter.hardware.timing import AxisTiming, ServoTiming, Timing, motion_seconds

FEW = settings(max_examples=min(20, settings.default.max_examples))
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


@FEW
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


# A machine with limits per axis, as a controller states them.

SLOW = AxisTiming(speed=(500 / 60_000,) * 3, acceleration=(0.01,) * 3, deviation=1e-5)


def walked(timing: AxisTiming, path: np.ndarray, speed: float, steps: int = 4000) -> float:
    """Plain twin: integrates the fastest motion in small steps of the way, without corners' speeds of its own."""
    vector = np.diff(path, axis=0)
    length = np.linalg.norm(vector, axis=1)
    unit = vector / length[:, None]
    corners = timing._corners(unit)
    fine = np.concatenate([np.full(steps, way / steps) for way in length])
    of = np.repeat(np.arange(len(length)), steps)
    fastest = np.minimum(speed, (np.array(timing.speed) / np.maximum(np.abs(unit), 1e-12)).min(1))[of]
    gain = (np.array(timing.acceleration) / np.maximum(np.abs(unit), 1e-12)).min(1)[of]
    at = np.r_[0.0, np.minimum(fastest[1:], fastest[:-1]), 0.0]
    for k, corner in enumerate(corners, 1):
        at[k * steps] = min(at[k * steps], corner)
    for k in range(len(fine)):
        at[k + 1] = min(at[k + 1], np.sqrt(at[k] ** 2 + 2 * gain[k] * fine[k]))
    for k in reversed(range(len(fine))):
        at[k] = min(at[k], np.sqrt(at[k + 1] ** 2 + 2 * gain[k] * fine[k]))
    return float((2 * fine / (at[1:] + at[:-1])).sum())


def test_a_straight_way_takes_its_length_over_the_axis_rate_and_one_ramp():
    path = np.array([[0, 0, 0], [0.081, 0, 0]])
    assert SLOW.seconds(path, np.array([0.1])) == pytest.approx(0.081 / (0.5 / 60) + 0.5 / 60 / 0.01, rel=1e-4)
    settled = replace(SLOW, between=0.5)
    assert motion_seconds(settled, path, 0.1) == pytest.approx(SLOW.seconds(path, np.array([0.1])) + 0.5)
    assert motion_seconds(None, path, 0.1) == pytest.approx(0.81)
    diagonal = np.array([[0, 0, 0], [0.081, 0.081, 0]])
    assert SLOW.seconds(diagonal, np.array([0.1])) == pytest.approx(SLOW.seconds(path, np.array([0.1])), rel=1e-4)
    assert SLOW.limit_speeds(np.diff(diagonal, axis=0), np.array([0.1])) == pytest.approx([np.sqrt(2) * 0.5 / 60])


@FEW
@given(
    polyline(6).filter(lambda path: np.linalg.norm(np.diff(path, axis=0), axis=1).min() > 1e-3), st.floats(0.004, 0.3)
)
def test_the_duration_is_that_of_its_plain_twin(path, speed):
    for timing in (SLOW, AxisTiming((0.3, 0.2, 0.01), (2.0, 1.0, 0.1), jerk=(0.01, 0.01, 0.0004))):
        reckoned = timing.seconds(path, np.full(len(path) - 1, speed))
        assert reckoned == pytest.approx(walked(timing, path, speed, 300), rel=0.02)


def test_a_corner_costs_a_stop_only_if_the_machine_cannot_round_it():
    bent = np.array([[0, 0, 0], [0.05, 0, 0], [0.05, 0.05, 0]])
    back = np.array([[0, 0, 0], [0.05, 0, 0], [0, 0, 0]])
    gentle, hard = AxisTiming((0.1,) * 3, (0.5,) * 3, deviation=1e-3), AxisTiming((0.1,) * 3, (0.5,) * 3)
    speed = np.full(2, 0.1)
    assert gentle.seconds(bent, speed) < hard.seconds(bent, speed) - 0.05
    assert hard.seconds(bent, speed) == pytest.approx(2 * hard.seconds(bent[:2], speed[:1]))
    assert gentle.seconds(back, speed) == pytest.approx(2 * gentle.seconds(back[:2], speed[:1]))


def test_motors_that_pull_along_the_diagonals_limit_the_sum_of_both_axes():
    """An H-bot: motors along x + y and x - y, 25,000 steps/s at 80 steps a millimetre."""
    machine = AxisTiming((0.3125, 0.3125), (np.inf, np.inf), axes=((1.0, 1.0, 0.0), (1.0, -1.0, 0.0)))
    ways = np.array([[1.0, 0, 0], [1.0, 1.0, 0], [0, 0, 1.0]])
    assert machine.limit_speeds(ways, np.full(3, 0.5)) == pytest.approx([0.3125, 0.3125 / np.sqrt(2), 0.5])
    assert machine.seconds(np.array([[0, 0, 0], [0.1, 0, 0.0]]), np.array([0.2])) == pytest.approx(0.5)


def test_a_servo_lowers_the_brush_step_by_step_and_lifts_it_at_once_unless_a_speed_is_set():
    servo = ServoTiming(0.05, each=0.001)
    heights, waits = zip(*servo.steps(0.004, 0.0), strict=True)
    assert heights == pytest.approx((0.003, 0.002, 0.001, 0.0)) and waits == pytest.approx((0.02,) * 4)
    assert servo.steps(0.0, 0.004) == [(0.004, pytest.approx(0.08))]
    assert ServoTiming(0.05, lift=0.1).steps(0.0, 0.002) == [pytest.approx((z, 0.01)) for z in (0.001, 0.002)]
    assert servo.seconds(0.004, 0.0) == pytest.approx(0.084)
    machine = AxisTiming((0.1,) * 3, (1.0,) * 3, servo=servo)
    path = np.array([(0, 0, 0.01), (0.05, 0, 0.01), (0.05, 0, 0.0), (0.1, 0, 0.0)])
    assert machine.seconds(path, np.full(3, 0.2)) == pytest.approx(0.6 + 0.21 + 0.6), "it stands while it is lowered"


@pytest.mark.parametrize(
    "numbers", [((0.1, 0.0, 0.1), (1.0,) * 3), ((0.1,) * 2, (1.0,) * 2), ((np.nan,) * 3, (1.0,) * 3)]
)
def test_limits_that_no_machine_has_are_refused(numbers):
    with pytest.raises(ConfigError):
        AxisTiming(*numbers)
