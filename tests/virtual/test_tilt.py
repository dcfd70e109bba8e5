"""Marks of a tilted brush: a sharp side at the tip, a soft one under the handle, and the same bytes when upright."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from frida_painter.errors import WorkspaceViolation
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import TiltingRobot, Waypoints
from frida_painter.strokes import MAX_TILT, Strokes
from frida_painter.virtual.bristles import Tuft, find_brush
from virtual.hand import Hand

pytestmark = pytest.mark.usefixtures("small_world")
BLUE = (0.05, 0.1, 0.4)
THERE = {"cell": 0.4, "seed": 3, "brush": "broad"}
Y, X, LENGTH = 0.045, 0.03, 0.05


def stroke(left: float = 0.0, forward: float = 0.0, angle: float = 0.0, x: float = X) -> Strokes:
    one = torch.ones(1)
    tilt = torch.tensor([[math.radians(left), math.radians(forward)]])
    place = torch.tensor([[x, Y]])
    return Strokes(place, angle * one, LENGTH * one, 0 * one, 0.6 * one, torch.zeros(1, 3), tilt=tilt)


def paint(hand: Hand, strokes: Strokes) -> None:
    motion = Motion(hand.easel.workspace, hand.easel.calibration)
    hand.dip(0)
    for way in motion.swift_stroke(strokes, 0, "stroke"):
        hand.easel.robot.follow(way)


def profile(strokes: Strokes) -> np.ndarray:
    """Mean darkness across the middle of a mark, from its right side to its left, per half millimetre."""
    hand = Hand(BLUE, **THERE)
    paint(hand, strokes)
    middle = hand.truth()[:, round(2000 * (X + 0.015)) : round(2000 * (X + 0.035))]
    across = 1 - middle.mean((1, 2))[::-1]  # rows go down, y goes up
    return np.asarray(across / across.max())


def edges(across: np.ndarray) -> tuple[float, float]:
    """Widths in mm of the right and the left side of a mark, between a tenth and nine tenths of its full paint."""
    full, any_paint = np.flatnonzero(across > 0.9), np.flatnonzero(across > 0.1)
    return (full[0] - any_paint[0]) / 2, (any_paint[-1] - full[-1]) / 2


@pytest.mark.slow
def test_a_brush_that_leans_to_the_left_has_a_soft_left_side_and_a_sharp_right_one() -> None:
    upright, leaning = edges(profile(stroke())), edges(profile(stroke(left=40)))
    assert leaning[0] <= 1.0 and leaning[1] >= 4.0 > 2 * max(upright)
    mirrored = edges(profile(stroke(left=-40)))
    assert mirrored[1] <= 1.5 and mirrored[0] >= 4.0


def test_the_soft_side_grows_with_the_tilt() -> None:
    soft = [edges(profile(stroke(left=degrees)))[1] for degrees in (0, 20, 40)]
    assert soft[0] < soft[1] < soft[2]


def test_the_soft_side_turns_with_the_stroke() -> None:
    back = stroke(left=40, angle=math.pi, x=X + LENGTH)  # from right to left: its left is below
    right, left = edges(profile(back))
    assert right >= 4.0 > 3 * left


def test_a_brush_that_leans_forward_is_soft_on_neither_side() -> None:
    assert max(edges(profile(stroke(forward=40)))) < 4.0


@pytest.mark.parametrize("left", [0.0, 1e-7])
def test_a_tilt_of_nearly_nothing_is_an_upright_brush(left: float) -> None:
    marks = []
    for strokes in (replace(stroke(), tilt=None), stroke(left=left)):
        hand = Hand(BLUE, **THERE)
        paint(hand, strokes)
        marks.append(hand.studio.canvas.wet.copy())
    if left == 0.0:
        assert marks[0].tobytes() == marks[1].tobytes()
    assert np.abs(marks[0] - marks[1]).max() < 1e-3 * marks[0].max()


def test_a_tilted_brush_loses_no_paint() -> None:
    hand = Hand(BLUE, drying_time=60.0, **THERE)
    for forward in (0, 20, -30):
        paint(hand, stroke(left=25, forward=forward))
        hand.studio.wait(10.0)
    balance = hand.studio.balance()
    assert balance.wet > 0 and abs(balance.missing) < 1e-4 * balance.drawn


def test_a_light_bristle_takes_little_of_the_paint_that_lies_there() -> None:
    hand = Hand(BLUE, **THERE)
    paint(hand, stroke())
    before = hand.studio.canvas.wet[..., 0].copy()
    paint(hand, stroke(left=40))
    assert hand.studio.canvas.wet[..., 0][before > 0.02].mean() > 0.8 * before[before > 0.02].mean()


def test_pressure_falls_from_the_tip_to_the_heel() -> None:
    brush = find_brush("broad")
    path = np.c_[np.arange(0, 30, 0.3), np.zeros(100), np.full(100, 0.6)]
    feet, travelled = Tuft(brush, np.random.default_rng(1)).feet(path)
    lean = np.tile((0.0, MAX_TILT), (len(path), 1))
    leaning, same, share = Tuft(brush, np.random.default_rng(1)).leaning_feet(path, lean)
    assert np.array_equal(travelled, same) and (share >= 0).all() and (share <= 1).all()
    order = np.argsort(feet[50, :, 1])  # from the right, at the tip, to the left, under the handle
    assert (np.diff(share[50, order]) <= 1e-6).all() and share[50, order[0]] > 0.9 and share[50, order[-1]] < 0.1
    assert leaning[50, :, 1].mean() > feet[50, :, 1].mean() + 2  # the belly lies beside the tip
    assert np.allclose(leaning[..., 0], feet[..., 0], atol=1e-4)


def test_a_studio_with_tilted_strokes_is_opened_again_as_it_was_left(tmp_path: Path) -> None:
    first, straight = Hand(BLUE, state=tmp_path / "studio.jsonl", **THERE), Hand(BLUE, **THERE)
    for hand in (first, straight):
        paint(hand, stroke(left=30, forward=-10))
    first.studio.close()
    again = Hand(state=tmp_path / "studio.jsonl", **THERE)
    for hand in (again, straight):
        paint(hand, stroke(left=-30))
    assert again.studio.canvas.wet.tobytes() == straight.studio.canvas.wet.tobytes()


def test_the_robot_of_the_studio_refuses_to_tilt_further_than_it_can() -> None:
    robot = Hand(BLUE, **THERE).easel.robot
    assert isinstance(robot, TiltingRobot) and robot.max_tilt == pytest.approx(MAX_TILT)
    place = np.array([robot.pose()])
    for lean in (np.array([[0.0, 0.8]]), np.array([[np.nan, 0.0]])):
        with pytest.raises(
            WorkspaceViolation, match="a tilted brush was wanted; this robot tilts it by at most 40 deg"
        ):
            robot.follow(Waypoints("tilted", place, 0.1, lean=lean))
    assert robot.motions == 0
