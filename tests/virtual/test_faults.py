import cv2
import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CameraError, RobotError, StaleFrame
from frida_painter.hardware.faults import Bump, Faults, InSight, LightChange, LostFocus
from frida_painter.hardware.robot import Waypoints
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.paint import to_linear

from .hand import Hand

BLACK = [0.08, 0.08, 0.08]
SMALL, TINY = CameraSpec(photograph=(480, 640)), CameraSpec(photograph=(240, 320))


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


def test_photographs_that_are_stale_frozen_or_not_taken():
    """A stale one is the one before; a frozen camera gives its last picture as a new one."""
    faults = Faults(
        stale_photographs=frozenset({1}), frozen_photographs=frozenset({3}), failed_photographs=frozenset({5})
    )
    hand = Hand(BLACK, camera=SMALL, faults=faults)
    first = hand.easel.camera.capture(0.0)
    report = hand.easel.robot.home()
    with pytest.raises(StaleFrame, match="take another"):
        hand.easel.camera.capture(report.finished_at)
    second, third, fourth = (hand.easel.camera.capture(report.finished_at) for _ in range(3))
    assert first.captured_at <= report.finished_at < second.captured_at < third.captured_at
    assert np.array_equal(second.image, third.image) and not np.array_equal(third.image, fourth.image)
    with pytest.raises(CameraError, match="does not answer"):
        hand.easel.camera.capture(0.0)
    assert hand.easel.camera.capture(0.0).sequence == 6


def test_a_dead_robot_refuses_everything_from_that_motion_on():
    hand = Hand(BLACK, faults=Faults(dead_from_motion=1))
    hand.dip(0)
    for motion in (hand.easel.robot.home, hand.easel.robot.home, hand.easel.robot.pose):
        with pytest.raises(RobotError, match="answer"):
            motion()
    hand.studio.break_things(Faults())
    hand.easel.robot.home()


def test_a_stuck_motion_says_where_it_really_ended():
    hand = Hand(BLACK, faults=Faults(stuck_motions=frozenset({0})))
    x, y, z = hand.easel.workspace.wells[0]
    path = np.array([(x, y, z + 0.03), (x + 0.02, y, z + 0.03), (x + 0.04, y, z + 0.03)])
    report = hand.easel.robot.follow(Waypoints("across", path, 0.1))
    assert np.array_equal(report.reached, hand.easel.robot.pose())
    assert np.linalg.norm(report.reached - path[-1]) > 0.03
    assert np.array_equal(hand.easel.robot.follow(Waypoints("again", path, 0.1)).reached, path[-1])


def sharpness(image: np.ndarray) -> float:
    """Steepest step between two pixels, once the noise has been smoothed away."""
    return float(np.abs(np.diff(cv2.GaussianBlur(image, (0, 0), 1.0).astype(float), axis=1)).max())


def test_the_focus_is_lost_in_the_photographs_named_and_found_again():
    lost = Faults(lost_focus=(LostFocus(1, 2), LostFocus(4)))
    hand = Hand(BLACK, camera=SMALL, faults=lost)
    hand.dip(0)
    hand.stroke(0.02, 0.05, 0.06)
    hand.easel.robot.home()
    steepest = [sharpness(hand.easel.camera.capture(0.0).image) for _ in range(6)]
    sharp = [value > 0.7 * max(steepest) for value in steepest]
    assert sharp == [True, False, False, True, False, False]


def test_the_light_changes_in_strength_colour_and_direction_until_it_changes_again():
    evening, lamp = LightChange(1, (0.8, 0.6, 0.4)), LightChange(3, (0.7, 0.7, 0.7), lean=(0.3, 0.0))
    hand = Hand(BLACK, camera=SMALL, faults=Faults(light_changes=(lamp, evening)))
    hand.easel.robot.home()
    seen = [to_linear(hand.easel.camera.capture(0.0).image / 255) for _ in range(4)]
    whole = [picture.mean((0, 1)) for picture in seen]
    assert whole[1] / whole[0] == pytest.approx((0.8, 0.6, 0.4), abs=0.01)
    assert whole[2] / whole[0] == pytest.approx((0.8, 0.6, 0.4), abs=0.01)
    right, left = (seen[3][:, side].mean() / seen[0][:, side].mean() for side in (np.s_[480:], np.s_[:160]))
    assert right == pytest.approx(0.7 * 1.225, abs=0.02)
    assert left == pytest.approx(0.7 * 0.775, abs=0.02)


def test_an_empty_well_gives_no_paint_until_it_is_filled_again():
    hand = Hand(BLACK, faults=Faults(dry_dips=frozenset({0, 2})))
    taken = []
    for _ in range(4):
        before = hand.studio.balance().drawn
        hand.dip(0)
        taken.append(hand.studio.balance().drawn > before)
        hand.clean()
    assert taken == [False, True, False, True]


def photographs(faults: Faults, count: int = 3) -> list[np.ndarray]:
    hand = Hand(camera=TINY, faults=faults)
    hand.easel.robot.home()
    return [hand.easel.camera.capture(0.0).image.astype(int) for _ in range(count)]


def test_a_hand_lies_in_the_photographs_named_from_the_lower_edge_to_its_place() -> None:
    """Over a canvas of 42 cm, a hand of 20 cm and its forearm, with all five fingers."""
    faults = Faults(in_sight=(InSight("hand", 1, 1, place=(0.4, 0.5)),))
    hand = Hand(camera=TINY, canvas=CanvasSize(0.42, 0.297), cell=2.0, faults=faults)
    hand.easel.robot.home()
    before, during, after = (hand.easel.camera.capture(0.0).image.astype(int) for _ in range(3))
    covered = np.abs(during - before).max(2) > 40
    rows = np.flatnonzero(covered.any(1))
    assert covered[120, 128], "the palm is at its place"
    assert np.array_equal(rows, np.arange(rows[0], 240)), "in one piece, out of the lower edge"
    assert 20 < rows[0] < 60 and not covered[:, [0, -1]].any(), "the fingers end over the canvas"
    fingertips = np.diff(np.r_[0, covered[rows[0] + 20], 0]) == 1
    assert fingertips.sum() == 4
    blue = during[-1, covered[-1]]
    assert (blue[:, 2] > blue[:, 0]).mean() > 0.8, "a sleeve is what comes from below"
    assert (np.abs(after - before).max(2) > 40).mean() < 0.001


def test_glare_is_brighter_than_can_be_recorded() -> None:
    before, during, _ = photographs(Faults(in_sight=(InSight("glare", 1, 1, place=(0.6, 0.4)),)))
    row, column = round(0.4 * 239), round(0.6 * 319)
    assert (during[row, column] == 255).all() and (before[row, column] < 255).any()
    assert (during >= before - 30).all()
    first, second, _ = photographs(Faults(in_sight=(InSight("glare", 5),)))
    assert np.abs(first - second).mean() < 3, "what is not there yet is not seen"
