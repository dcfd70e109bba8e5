import threading

import numpy as np
import pytest

from frida_painter.errors import RobotError, WorkspaceViolation
from frida_painter.hardware.robot import Waypoints

from .hand import Hand

pytestmark = pytest.mark.usefixtures("small_world")  # nobody looks at the canvas


@pytest.fixture
def hand():
    return Hand([0.1, 0.1, 0.1])


def at(hand, x, y, z, speed=0.1):
    return hand.easel.robot.follow(Waypoints("test", np.array([[x, y, z]]), speed))


def test_it_arrives_where_it_was_sent_and_its_clock_counts_the_way(hand):
    x, y, z = hand.easel.workspace.wells[0]
    first = at(hand, x, y, z + 0.03)
    path = np.array([[x, y, z + 0.03], [x + 0.06, y, z + 0.03]])
    report = hand.easel.robot.follow(Waypoints("across", path, 0.03))
    assert np.array_equal(report.reached, path[-1])
    assert np.array_equal(hand.easel.robot.pose(), path[-1])
    assert report.started_at == first.finished_at
    assert report.finished_at - report.started_at == pytest.approx(2.0)
    assert report.label == "across"


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("value", [np.nan, np.inf, -5.0, 5.0])
def test_what_lies_outside_its_reach_is_refused_before_it_moves(hand, axis, value):
    before = hand.easel.robot.pose()
    path = np.array([hand.easel.workspace.wells[0]] * 3)
    path[1, axis] = value
    with pytest.raises(WorkspaceViolation, match=f"stray: waypoint 1 has {'xyz'[axis]}"):
        hand.easel.robot.follow(Waypoints("stray", path, 0.1))
    assert np.array_equal(hand.easel.robot.pose(), before)


@pytest.mark.parametrize("speed", [0.0, -1.0, np.nan, 30.0])
def test_a_speed_that_is_none_is_refused(hand, speed):
    with pytest.raises(WorkspaceViolation, match="m/s"):
        at(hand, *hand.easel.workspace.wells[0], speed=speed)


@pytest.mark.parametrize("shape", [(0, 3), (3,), (2, 2)])
def test_waypoints_of_another_shape_are_refused(hand, shape):
    with pytest.raises(WorkspaceViolation, match="shape"):
        hand.easel.robot.follow(Waypoints("test", np.zeros(shape), 0.1))


def test_stop_latches_until_somebody_rearms_it(hand):
    thread = threading.Thread(target=hand.easel.robot.stop)
    thread.start()
    thread.join()
    for motion in (lambda: at(hand, *hand.easel.workspace.wells[0]), hand.easel.robot.home):
        with pytest.raises(RobotError, match="stopped"):
            motion()
    hand.easel.robot.connect()
    with pytest.raises(RobotError, match="stopped"):
        hand.easel.robot.home()
    assert np.isfinite(hand.easel.robot.pose()).all(), "whoever looks may know where it is"
    hand.studio.robot.rearm()
    hand.easel.robot.home()


def test_closed_it_does_not_move(hand):
    hand.easel.robot.close()
    with pytest.raises(RobotError, match="connect"):
        hand.easel.robot.home()
    hand.easel.robot.connect()
    hand.easel.robot.home()


def test_the_workspace_holds_enough_wells_apart_from_each_other_inside_its_bounds(hand):
    workspace = hand.easel.workspace
    things = np.array([*workspace.wells, workspace.water, workspace.rag])
    assert len(workspace.wells) >= 24
    apart = np.linalg.norm(things[:, None] - things[None], axis=-1)[np.triu_indices(len(things), 1)]
    assert apart.min() > 0.04
    around, up = np.array([0.02, 0.02, 0.0]), np.array([0.0, 0.0, workspace.hover])
    assert (things - around > workspace.lower).all()
    assert (things + around + up < workspace.upper).all()
    corners = workspace.to_robot(np.array([[0, 0], [0.12, 0.09], [0, 0.09], [0.12, 0]]), np.full(4, 0.13))
    assert (corners > workspace.lower).all() and (corners < workspace.upper).all()
