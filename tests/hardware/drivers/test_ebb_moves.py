import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frida_painter.hardware.drivers.axidraw import Move, moves
from frida_painter.hardware.robot import Waypoints
from machines.paths import a_stroke

PLACE = st.tuples(st.floats(0, 0.3), st.floats(-0.2, 0), st.sampled_from([-0.001, 0.0, 0.005]))


@settings(max_examples=min(30, settings.default.max_examples))
@given(st.lists(PLACE, min_size=1, max_size=4), PLACE, st.floats(0.005, 0.3))
def test_all_pieces_together_lead_exactly_to_every_waypoint(
    places: list[tuple[float, float, float]], start: tuple[float, float, float], speed: float
) -> None:
    here, path = np.array(start), np.array(places)
    todo = list(moves(here, Waypoints("stroke 1", path, speed), 0.15, 0.8))
    at = np.round(here[:2] * (80_000, -80_000))
    ends = {}
    for move in todo:
        at = at + move.steps
        ends[move.waypoint] = at
        assert 0 <= move.seconds <= 0.05 + 1e-9
    for index, place in enumerate(path):
        assert np.abs(ends[index] - place[:2] * (80_000, -80_000)).max() <= 0.5 + 1e-6
    assert todo[-1].height == path[-1, 2]


def speeds(todo: list[Move]) -> np.ndarray:
    return np.array([np.hypot(*move.steps) / 80_000 / move.seconds for move in todo if move.seconds > 0])


def test_it_begins_and_ends_slowly_and_gains_no_more_than_its_acceleration() -> None:
    path = Waypoints("travel", np.array([[0.2, -0.05, 0.01], [0.2, -0.15, 0.01]]), 0.1)
    found = speeds(list(moves(np.array([0.0, 0.0, 0.01]), path, 0.2, 0.8)))
    assert found.max() < 0.2 * 1.15
    assert found[0] < 0.05 and found[-1] < 0.05


def test_a_stroke_takes_little_longer_than_its_length_over_its_speed() -> None:
    stroke = a_stroke(speed=0.05)
    todo = [move for move in moves(stroke.position[0], stroke, 0.15, 0.8) if move.waypoint > 0]
    assert sum(move.seconds for move in todo) == pytest.approx(0.031 / 0.05 + 0.05 / 0.8, rel=0.2)
