import numpy as np
import pytest

from frida_painter.errors import RobotError, StaleFrame
from frida_painter.hardware.robot import Waypoints
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.faults import Bump, Faults

from .hand import Hand

BLACK = [0.08, 0.08, 0.08]
SMALL = CameraSpec(photograph=(480, 640))


def test_a_dropped_touch_leaves_no_mark_and_the_next_one_does():
    hand = Hand(BLACK, faults=Faults(dropped_touches=frozenset({1})))
    marks = []
    for y in (0.02, 0.045, 0.07):
        hand.dip(0)
        hand.stroke(0.03, y, 0.05)
        marks.append(hand.around(0.055, y).mean() < 0.4)
    assert marks == [True, False, True]


def test_a_bumped_canvas_moves_under_the_brush_and_in_the_photograph():
    shift = (0.006, 0.009)
    hands = [Hand(BLACK, camera=SMALL, faults=Faults(bumps=bumps)) for bumps in ((), (Bump(1, shift),))]
    centers, photographs = [], []
    for hand in hands:
        hand.dip(0)
        hand.stroke(0.02, 0.07, 0.03)
        before = hand.truth()
        hand.dip(0)
        hand.stroke(0.05, 0.03, 0.04)
        centers.append(np.argwhere((before - hand.truth()).mean(2) > 0.4).mean(0) / 2000)
        hand.easel.robot.home()
        photographs.append(hand.easel.camera.capture(0.0).image.astype(int))
    moved = centers[1] - centers[0]  # Rows and columns of the canvas's own picture.
    assert moved == pytest.approx((shift[1], -shift[0]), abs=0.0015)
    assert (np.abs(photographs[0] - photographs[1]).max(2) > 60).mean() > 0.01


def test_a_stale_photograph_is_the_one_before_and_is_reported_as_such():
    hand = Hand(BLACK, camera=SMALL, faults=Faults(stale_photographs=frozenset({1})))
    first = hand.easel.camera.capture(0.0)
    report = hand.easel.robot.home()
    with pytest.raises(StaleFrame, match="take another"):
        hand.easel.camera.capture(report.finished_at)
    assert hand.easel.camera.capture(report.finished_at).captured_at > first.captured_at


def test_a_dead_robot_refuses_everything_from_that_motion_on():
    hand = Hand(BLACK, faults=Faults(dead_from_motion=1))
    hand.dip(0)
    for motion in (hand.easel.robot.home, hand.easel.robot.home, hand.easel.robot.pose):
        with pytest.raises(RobotError, match="answer"):
            motion()


def test_a_stuck_motion_says_where_it_really_ended():
    hand = Hand(BLACK, faults=Faults(stuck_motions=frozenset({0})))
    x, y, z = hand.easel.workspace.wells[0]
    path = np.array([(x, y, z + 0.03), (x + 0.02, y, z + 0.03), (x + 0.04, y, z + 0.03)])
    report = hand.easel.robot.follow(Waypoints("across", path, 0.1))
    assert np.array_equal(report.reached, hand.easel.robot.pose())
    assert np.linalg.norm(report.reached - path[-1]) > 0.03
    assert np.array_equal(hand.easel.robot.follow(Waypoints("again", path, 0.1)).reached, path[-1])


def test_faults_may_be_set_and_mended_while_painting():
    hand = Hand(BLACK)
    hand.studio.break_things(Faults(dead_from_motion=0))
    with pytest.raises(RobotError):
        hand.easel.robot.home()
    hand.studio.break_things(Faults())
    hand.easel.robot.home()
