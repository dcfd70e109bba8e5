"""What paint does on the canvas, told through the motions of a hand."""

from itertools import pairwise

import numpy as np
import pytest

from .hand import Hand

pytestmark = pytest.mark.usefixtures("small_world")  # nobody looks at the canvas
WHITE, YELLOW, BLUE, BLACK = [1.0, 1, 1], [0.98, 0.85, 0.1], [0.1, 0.3, 0.72], [0.08, 0.08, 0.08]


def covered(hand, before, after, color):
    """Share of full paint over the whole canvas that was added, in square millimetres."""
    full = 3 - np.sum(color)
    return float((before - after).clip(0).sum()) / full / 4


def test_volume_is_conserved():
    hand = Hand(YELLOW, BLUE, drying_time=60.0)
    for well, y in ((1, 0.03), (0, 0.035), (1, 0.06), (0, 0.055)):
        hand.dip(well)
        hand.stroke(0.02, y, 0.06, bend=0.01)
        hand.clean()
    hand.dip(0)
    hand.easel.operator.let_dry(20.0)
    hand.stroke(0.10, 0.02, 0.05, angle=np.pi)  # Over half-dry paint.
    hand.stroke(0.08, 0.05, 0.06)  # Runs over the edge of the canvas.
    balance = hand.studio.balance()
    assert min(balance.brush, balance.wet, balance.dry, balance.water, balance.rag) > 0
    assert abs(balance.missing) < 1e-4 * balance.drawn


def test_a_fresh_stroke_is_opaque_in_its_middle():
    hand = Hand(BLUE)
    hand.dip(0)
    hand.stroke(0.03, 0.045, 0.05)
    assert np.allclose(hand.around(0.055, 0.045), BLUE, atol=0.06)


@pytest.mark.parametrize("dries", [False, True])
def test_a_wet_layer_is_picked_up_and_mixed_and_a_dry_one_is_not(dries):
    hand = Hand(YELLOW, BLUE)
    hand.dip(1)
    hand.stroke(0.06, 0.08, 0.06, angle=-np.pi / 2)
    hand.clean()
    if dries:
        hand.easel.operator.let_dry(3600.0)
        assert hand.studio.balance().wet == 0
    dry = hand.studio.balance().dry
    hand.dip(0)
    hand.stroke(0.03, 0.045, 0.06)
    assert np.allclose(hand.around(0.036, 0.045), YELLOW, atol=0.08)
    (red, green, blue), after = hand.around(0.058, 0.045), hand.around(0.085, 0.045)
    if dries:
        assert hand.studio.balance().dry == dry
        assert red > 0.85 and np.allclose(after, YELLOW, atol=0.06)
    else:
        assert green > red + 0.02  # Yellow itself has 0.13 more red than green.
        assert green > blue + 0.1 and after[0] < 0.8


def test_a_second_stroke_without_a_refill_is_paler_and_a_refill_restores_it():
    hand = Hand(BLUE)
    hand.dip(0)
    images = [hand.truth()]
    for y in (0.075, 0.055, 0.035):
        if y == 0.035:
            hand.dip(0)
        hand.stroke(0.02, y, 0.06, thickness=1.0)
        images.append(hand.truth())
    first, second, third = (covered(hand, a, b, BLUE) for a, b in pairwise(images))
    assert second < 0.88 * first
    assert third > 0.9 * first


def test_a_stroke_ends_drier_than_it_starts():
    hand = Hand(BLUE)
    hand.dip(0)
    hand.stroke(0.03, 0.045, 0.06, thickness=1.0)
    film = hand.studio.canvas.wet[:, :, 0]
    half = film[:, 70:110].sum() / film[:, 130:170].sum()  # 35 to 55 mm against 65 to 85 mm.
    assert half > 1.05


def test_thin_paint_dries_before_thick_paint():
    hand = Hand(BLUE, drying_time=300.0)
    hand.dip(0)
    hand.stroke(0.03, 0.045, 0.06)
    film = hand.studio.canvas.wet[:, :, 0].copy()
    hand.easel.operator.let_dry(100.0)
    left = hand.studio.canvas.wet[:, :, 0]
    thin, thick = (film > 0) & (film < 0.01), film > 0.04
    assert thin.any() and thick.any()
    assert (left[thin] == 0).all()
    assert (left[thick] > 0).all()
    assert hand.studio.balance().dry > 0


def test_water_takes_most_of_the_paint_and_with_the_rag_white_after_black_stays_nearly_white():
    hand = Hand(WHITE, BLACK)
    hand.dip(1)
    loaded = hand.studio.balance().brush
    hand.follow("rinse", [hand.easel.workspace.water])
    assert 0.02 * loaded < hand.studio.balance().brush < 0.5 * loaded
    hand.clean()
    assert hand.studio.balance().brush < 0.005 * loaded
    hand.dip(0)
    hand.stroke(0.03, 0.045, 0.05)
    assert hand.around(0.055, 0.045).min() > 0.9


@pytest.mark.parametrize("brush", ["fine", "medium", "broad"])
def test_the_harder_press_leaves_the_wider_mark(brush):
    hand = Hand(BLACK, brush=brush)
    widths = []
    for y, thickness in ((0.075, 0.0), (0.055, 0.5), (0.025, 1.0)):
        hand.dip(0)
        before = hand.truth()
        hand.stroke(0.03, y, 0.05, thickness=thickness)
        middle = (before - hand.truth()).mean(2)[:, 110:118].mean(1)
        widths.append((middle > 0.4).sum() / 2)
    assert widths[0] < widths[1] < widths[2]
    expected = {"fine": (2.5, 11.0), "medium": (2.5, 16.0), "broad": (4.0, 28.0)}[brush]
    assert widths[0] > expected[0] and widths[2] < expected[1]


def test_ends_are_more_torn_than_starts():
    """Roughness of an outline: how far it jumps from one row of pixels to the next."""
    start, end = [], []
    for seed in range(3):
        hand = Hand(BLACK, brush="broad", seed=seed)
        for y in (0.065, 0.025):
            hand.dip(0)
            before = hand.truth()
            hand.stroke(0.03, y, 0.06, thickness=0.6)
            mark = (before - hand.truth()).mean(2) > 0.4
            body = mark[np.flatnonzero(mark.sum(1) > 80)]
            first, last = body.argmax(1), body.shape[1] - body[:, ::-1].argmax(1)
            start.append(np.abs(np.diff(first)).mean())
            end.append(np.abs(np.diff(last)).mean())
    assert np.mean(end) > 1.3 * np.mean(start)
