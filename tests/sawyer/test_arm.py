import sys
import threading
import time

import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import RobotError, RobotStopped, WorkspaceViolation
from frida_painter.hardware.robot import Waypoints
from virtual.hand import Hand

mujoco = pytest.importorskip("mujoco")
pytest.importorskip("mink")
CANVAS = CanvasSize(0.2, 0.15)


def sawyer(*colors, **settings):
    return Hand(*colors, canvas=CANVAS, arm="sawyer", noise=None, **settings)


@pytest.fixture(scope="module")
def hand():
    return sawyer([0.1, 0.2, 0.6])


@pytest.fixture
def moving(hand):
    """The real path of the motions since the fixture was asked for."""
    paths, move = [], hand.studio.table.move
    hand.studio.table.move = lambda path, now, *more: (paths.append(path), move(path, now, *more))[1]
    yield paths
    hand.studio.table.move = move


def test_it_paints_with_its_own_small_errors(hand, moving):
    hand.dip(0)
    hand.stroke(0.06, 0.08, 0.08, bend=0.01)
    reached = hand.easel.robot.home().reached
    assert hand.around(0.10, 0.0875, 0.001)[0] < 0.5  # blue, where the stroke's bend comes through
    assert hand.around(0.10, 0.03, 0.001)[0] > 0.9
    stroke = moving[1]
    off = np.abs(np.diff(stroke, axis=0)).max()
    assert 1e-5 < off < 0.003  # a real path, in small steps and never by a jump
    assert 0 < np.linalg.norm(reached - [0.45, 0.33, 0.15]) < 3e-4


def test_the_tip_is_near_where_it_is_sent_and_never_quite_there(hand, moving):
    start = hand.easel.robot.pose()
    line = np.array([[0.55, -0.05, 0.08], [0.65, 0.05, 0.08]])
    hand.easel.robot.follow(Waypoints("line", line, 0.06))
    (path,) = moving
    np.testing.assert_allclose(path[0], start, atol=1e-5)  # exactly there where it moved before
    late = path[np.abs(path[:, 2] - 0.08) < 0.001][-150:]
    across = np.abs((late[:, 0] - late[:, 1]) - 0.6) / np.sqrt(2)
    assert 1e-6 < across.max() < 3e-4


def test_its_motions_take_the_time_that_is_told_of_them(hand):
    robot, timing = hand.easel.robot, hand.easel.timing
    start = robot.home().reached
    way = np.array([[0.55, -0.05, 0.08], [0.55, -0.05, 0.06], [0.6, 0.0, 0.06], [0.6, 0.0, 0.08]])
    report = robot.follow(Waypoints("a short way", way, 0.06))
    told = timing.seconds(np.vstack([start, way]), np.array([hand.easel.workspace.travel_speed, 0.06, 0.06, 0.06]))
    assert report.finished_at - report.started_at == pytest.approx(told, abs=0.03)


@pytest.mark.parametrize(
    ("place", "says"),
    [((1.3, 0.0, 0.1), "reaches from"), ((0.76, -0.52, 0.199), "does not reach"), ((np.nan, 0, 0), "nan")],
)
def test_what_it_cannot_reach_is_refused_before_it_moves(place, says):
    hand = Hand(canvas=CanvasSize(0.5, 0.5), arm="sawyer", noise=None)
    before, clock = hand.studio.robot.pose(), hand.studio.clock.now
    upper = hand.easel.workspace.upper
    place = (upper[0], -0.4, place[2]) if says == "does not reach" else place
    with pytest.raises(WorkspaceViolation, match=says):
        hand.easel.robot.follow(Waypoints("stroke 7", np.array([place]), 0.1))
    assert (hand.studio.robot.pose() == before).all()
    assert hand.studio.clock.now == clock
    hand.easel.robot.home()


def stop_on_the_way(robot, way, after):
    """Seconds that a stop took, which is asked for some seconds after the beginning."""
    ends = []

    def go():
        try:
            robot.follow(way)
        except RobotStopped:
            ends.append(time.monotonic())

    thread = threading.Thread(target=go)
    thread.start()
    time.sleep(after)
    asked = time.monotonic()
    robot.stop()
    thread.join()
    return ends[0] - asked


def test_stopping_brakes_at_once_and_holds_until_it_is_rearmed(hand):
    robot, took = hand.studio.robot, []
    far = hand.easel.workspace.to_robot(np.array([[0.02, 0.02], [0.18, 0.13]] * 12), np.full(24, 0.1))
    for _ in range(3):
        took.append(stop_on_the_way(robot, Waypoints("a long way", far, 0.1), 0.4))
        with pytest.raises(RobotStopped):
            robot.home()
        robot.rearm()
        assert np.linalg.norm(robot.pose() - far[-1]) > 0
        robot.home()
    # Braking included; the event itself is heeded every 2 ms of the arm's time. A busy computer holds one of them up.
    assert min(took) < 0.15


def test_moving_as_slowly_as_a_real_one_it_stops_within_a_tenth_of_a_second():
    robot, took = sawyer(pace=1.0).studio.robot, []
    for _ in range(3):
        start, began = robot.pose(), time.monotonic()
        took.append(stop_on_the_way(robot, Waypoints("aside", start[None] - [0.0, 0.3, 0.0], 0.1), 0.8))
        gone = np.linalg.norm(robot.pose() - start)
        assert 0.001 < gone < 0.25 * (time.monotonic() - began) + 0.02, "not farther than a real one in that time"
        robot.rearm()
    assert min(took) < 0.1, "a busy computer holds one of them up"


def test_braking_takes_a_tenth_of_a_second_and_a_few_millimetres(hand):
    """Stopped in full travel: how far the tip still goes, by the arm's own clock."""
    arm = hand.studio.robot.arm
    body, kinematics = arm._body, arm._kinematics
    start = hand.studio.robot.pose()
    along = np.linspace(0, 1, 120)[:, None]
    places = start + along**2 * np.array([0.0, -0.3, 0.0])
    reference = kinematics.follow(places, body.angles, threading.Event())
    stopped, calls = threading.Event(), iter(range(10**6))
    stopped.is_set = lambda: next(calls) >= 500  # one second on its way at 500 control steps a second
    track = body.track(reference, 0.01, stopped)
    at_stop = places[100]
    assert track.stopped
    assert 1.0 < track.seconds < 1.15
    assert np.linalg.norm(track.places[-1] - at_stop) < 0.02
    assert np.abs(body.data.qvel).max() < 1e-3
    hand.studio.robot._tip = body.tip


def test_the_same_seed_paints_the_same_and_another_does_not():
    def painted(seed):
        hand = sawyer([0.1, 0.2, 0.6], seed=seed, error=None)
        hand.dip(0)
        hand.stroke(0.05, 0.05, 0.06)
        return hand.studio.robot.pose(), hand.studio.canvas.wet.tobytes()

    tip, wet = painted(3)
    again, wet_again = painted(3)
    assert (tip == again).all()
    assert wet == wet_again
    assert (painted(4)[0] != tip).any()


def test_a_studio_that_is_opened_again_goes_on_with_the_arm_as_it_was(tmp_path):
    def first_half(hand):
        hand.dip(0)
        hand.stroke(0.05, 0.05, 0.06)

    def second_half(hand):
        hand.stroke(0.05, 0.09, 0.06)
        return hand.studio.robot.pose(), hand.studio.clock.now, hand.studio.canvas.wet.tobytes()

    whole = sawyer([0.1, 0.2, 0.6])
    first_half(whole)
    interrupted = sawyer([0.1, 0.2, 0.6], state=tmp_path / "studio")
    first_half(interrupted)
    interrupted.studio.close()
    again = sawyer(state=tmp_path / "studio")
    for one, other in zip(second_half(whole), second_half(again), strict=True):
        assert np.all(one == other)


def test_without_mujoco_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    for name in ("body", "surroundings"):
        monkeypatch.delitem(sys.modules, f"frida_painter_drivers.sawyer.{name}", raising=False)
    with pytest.raises(RobotError, match='extra "mujoco"'):
        sawyer()


def test_closed_it_refuses_and_connected_again_it_goes_on(hand):
    hand.easel.robot.close()
    with pytest.raises(RobotError, match="connect"):
        hand.easel.robot.home()
    hand.easel.robot.connect()
    hand.easel.robot.home()
