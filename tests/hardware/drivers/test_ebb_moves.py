import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frida_painter.hardware.robot import Waypoints
from frida_painter_drivers.axidraw import MAX_SPEED, AxidrawSettings, Move, moves
from machines.paths import a_stroke

PLACE = st.tuples(st.floats(0, 0.3), st.floats(-0.2, 0), st.sampled_from([-0.001, 0.0, 0.005]))
PLOTTER = AxidrawSettings((0.0, 0.0, 0.01))


@settings(max_examples=min(30, settings.default.max_examples))
@given(st.lists(PLACE, min_size=1, max_size=4), PLACE, st.floats(0.005, MAX_SPEED))
def test_all_moves_together_lead_exactly_to_every_waypoint_within_the_boards_limits(
    places: list[tuple[float, float, float]], start: tuple[float, float, float], speed: float
) -> None:
    here, path = np.array(start), np.array(places)
    waypoints = Waypoints("stroke 1", path, speed)
    todo = list(moves(here, waypoints, PLOTTER))
    first = at = np.round(here[:2] * (80_000, -80_000))
    ends = {}
    for move in todo:
        at = at + move.steps
        ends[move.waypoint] = at
        assert 1 <= move.milliseconds <= 26
        assert max(abs(sum(move.steps)), abs(move.steps[0] - move.steps[1])) <= 25 * move.milliseconds
    for index, place in enumerate(path):
        found = next(
            (ends[earlier] for earlier in range(index, -1, -1) if earlier in ends), first
        )  # a waypoint at the place of the one before needs no move
        assert np.abs(found - place[:2] * (80_000, -80_000)).max() <= 0.5 + 1e-6
    if todo:
        assert todo[-1].height == path[-1, 2]
    told = PLOTTER.timing.seconds(np.vstack([here, path]), np.r_[PLOTTER.approach, np.full(len(path) - 1, speed)])
    assert sum(move.milliseconds for move in todo) / 1000 >= 0.99 * told - 0.002


def speeds(todo: list[Move]) -> np.ndarray:
    return np.array([np.hypot(*move.steps) / 80 / move.milliseconds for move in todo])


def test_it_begins_and_ends_slowly_and_gains_no_more_than_its_acceleration() -> None:
    path = Waypoints("travel", np.array([[0.2, -0.05, 0.01], [0.2, -0.15, 0.01]]), 0.1)
    found = speeds(list(moves(np.array([0.0, 0.0, 0.01]), path, AxidrawSettings((0.0, 0.0, 0.01), approach=0.2))))
    assert found.max() < 0.2 * 1.05
    assert found[0] < 0.05 and found[-1] < 0.05


def test_it_stops_where_the_path_turns_back_and_slows_down_in_a_corner() -> None:
    wipe = Waypoints(
        "wipe", np.array([[0.1, -0.1, 0.01], [0.15, -0.1, 0.01], [0.1, -0.1, 0.01], [0.1, -0.05, 0.01]]), 0.15
    )
    todo = list(moves(wipe.position[0], wipe, PLOTTER))
    for waypoint in (1, 2):
        leg, after = ([move for move in todo if move.waypoint == index] for index in (waypoint, waypoint + 1))
        assert max(speeds(leg[-1:])[0], speeds(after[:1])[0]) < 0.05
        assert speeds(leg).max() > 0.1


def test_a_stroke_takes_little_longer_than_its_length_over_its_speed() -> None:
    stroke = a_stroke(speed=0.05)
    todo = [move for move in moves(stroke.position[0], stroke, PLOTTER) if move.waypoint > 0]
    lift = 2 * 0.01 / 0.03 / 2 + 0.01 / 0.05  # down and up again
    assert sum(move.milliseconds for move in todo) / 1000 == pytest.approx(0.031 / 0.05 + 0.05 / 0.8 + lift, rel=0.15)
