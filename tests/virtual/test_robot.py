import threading

import numpy as np
import pytest

from frida_painter.errors import RobotError, WorkspaceViolation
from frida_painter.hardware.robot import Waypoints
from frida_painter.virtual.studio import open_studio

from .hand import CANVAS, Hand

pytestmark = pytest.mark.usefixtures("small_world")  # nobody looks at the canvas


@pytest.fixture
def hand():
    return Hand([0.1, 0.1, 0.1])


def test_it_arrives_where_it_was_sent_and_its_clock_counts_the_way(hand):
    x, y, z = hand.easel.workspace.wells[0]
    first = hand.follow("there", [(x, y, z)])
    path = np.array([[x, y, z + 0.03], [x + 0.06, y, z + 0.03]])
    report = hand.easel.robot.follow(Waypoints("across", path, 0.03))
    assert np.array_equal(report.reached, path[-1])
    assert np.array_equal(hand.easel.robot.pose(), path[-1])
    assert report.started_at == first.finished_at
    assert report.finished_at - report.started_at == pytest.approx(2.0)
    assert report.label == "across"


WELL = np.array(open_studio(CANVAS, "fine").easel.workspace.wells[0])
STRAYS = [(axis, value) for axis in range(3) for value in (np.nan, np.inf, -5.0, 5.0)]


@pytest.mark.parametrize(
    ("path", "speed", "says"),
    [
        *((np.where(np.eye(3)[axis] == 1, [[0], [value], [0]], WELL), 0.1, "xyz"[axis]) for axis, value in STRAYS),
        *((WELL[None], speed, "m/s") for speed in (0.0, -1.0, np.nan, 30.0)),
        *((np.zeros(shape), 0.1, "shape") for shape in ((0, 3), (3,), (2, 2))),
    ],
)
def test_what_it_cannot_do_is_refused_before_it_moves(hand, path, speed, says):
    before = hand.easel.robot.pose()
    with pytest.raises(WorkspaceViolation, match=f"stray: .*{says}"):
        hand.easel.robot.follow(Waypoints("stray", path, speed))
    assert np.array_equal(hand.easel.robot.pose(), before)


def test_stop_latches_until_somebody_rearms_it(hand):
    thread = threading.Thread(target=hand.easel.robot.stop)
    thread.start()
    thread.join()
    for motion in (lambda: hand.dip(0), hand.easel.robot.home):
        with pytest.raises(RobotError, match="stopped"):
            motion()
    hand.easel.robot.connect()
    with pytest.raises(RobotError, match="stopped"):
        hand.easel.robot.home()
    assert np.isfinite(hand.easel.robot.pose()).all(), "whoever looks may know where it is"
    hand.studio.robot.rearm()
    hand.easel.robot.home()
    hand.easel.robot.close()
    with pytest.raises(RobotError, match="connect"):
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
