import math

import cv2
import numpy as np
import pytest

from frida_painter.errors import ConfigError
from frida_painter.hardware.faults import Bump, Faults
from frida_painter.virtual.camera import CameraSpec

from .hand import Hand

IDEAL = CameraSpec.ideal(480, 640)
YELLOW, BLUE_GREEN, BLACK = (240, 200, 22), (94, 190, 172), (50, 50, 51)


def photograph(hand):
    hand.easel.robot.home()
    return hand.easel.camera.capture(0.0).image.astype(float)


def color_at(hand, image, x, y):
    """sRGB (0-255) where the camera sees a place of the canvas's plane, metres."""
    size = hand.easel.canvas
    around = np.array([(0, size.height), (size.width, size.height), (size.width, 0), (0, 0)], np.float32)
    view = cv2.getPerspectiveTransform(around, np.array(hand.easel.calibration.corners, np.float32))
    column, row = cv2.perspectiveTransform(np.array([[[x, y]]]), view)[0, 0].round().astype(int)
    return image[row - 2 : row + 3, column - 2 : column + 3].mean((0, 1))


def on_card(column, row, width, turn, center):
    """Where a patch's middle lies, metres: a patch is 1 wide, the next one 1.15 further, the rim 0.32."""
    unit = width / (5 * 1.15 + 1 + 2 * 0.32)
    across, up = (column - 2.5) * 1.15 * unit, (1.5 - row) * 1.15 * unit
    cos, sin = math.cos(turn), math.sin(turn)
    return center[0] + cos * across - sin * up, center[1] + sin * across + cos * up


@pytest.mark.parametrize("turn", [0.0, 0.4, math.pi, math.pi / 2 + 0.1])
def test_a_card_lies_where_it_was_laid_and_turned_as_it_was_turned(turn):
    hand = Hand(camera=IDEAL)
    center, width = (0.055, 0.05), 0.07
    hand.studio.lay_checker(center, turn, width)
    image = photograph(hand)
    for (column, row), color in (((3, 2), YELLOW), ((5, 0), BLUE_GREEN), ((5, 3), BLACK)):
        seen = color_at(hand, image, *on_card(column, row, width, turn, center))
        assert np.abs(seen - color).max() < 9


def test_the_attendant_lays_it_on_the_canvas_and_takes_it_away_and_lays_it_where_it_was_put_before():
    hand = Hand(camera=IDEAL)
    bare = photograph(hand)
    assert hand.easel.operator.lay_checker()
    laid = photograph(hand)
    assert 0.05 < (np.abs(laid - bare).max(2) > 30).mean() < 0.6
    assert hand.easel.operator.take_checker_away()
    assert np.abs(photograph(hand) - bare).max() < 30
    hand.studio.lay_checker((0.05, 0.04), math.pi)
    there = photograph(hand)
    hand.easel.operator.take_checker_away()
    hand.easel.operator.lay_checker()
    assert np.abs(photograph(hand) - there).max() < 30


def test_a_knock_against_the_canvas_does_not_move_the_card():
    hand = Hand(camera=IDEAL, faults=Faults(bumps=(Bump(0, (0.004, 0.0)),)))
    hand.studio.lay_checker((0.06, 0.045), 0.0, 0.06)
    before = hand.easel.camera.capture(0.0).image.astype(float)
    after = photograph(hand)
    place = on_card(3, 2, 0.06, 0.0, (0.06, 0.045))
    assert np.abs(color_at(hand, before, *place) - color_at(hand, after, *place)).max() < 3
    assert (np.abs(before - after).max(2) > 60).mean() > 0.01


def test_no_two_cards_are_printed_alike_and_a_seed_prints_the_same():
    first, same, other = (Hand(seed=seed).easel.operator.checker.looks for seed in (0, 0, 1))
    assert np.array_equal(first, same)
    assert 0 < np.abs(first - other).mean() < 0.02


@pytest.mark.parametrize(
    ("center", "turn", "width"), [((0, 0), 0, 0.01), ((math.nan, 0), 0, 0.1), ((0, 0), 0, math.nan)]
)
def test_a_card_that_lies_nowhere_or_has_no_size_is_refused(center, turn, width):
    with pytest.raises(ConfigError, match="checker"):
        Hand().studio.lay_checker(center, turn, width)
