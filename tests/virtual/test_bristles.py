import numpy as np
import pytest

from frida_painter.virtual.bristles import Tuft, find_brush
from frida_painter.virtual.paint import absorption_and_scattering

BLUE = absorption_and_scattering(np.array([0.1, 0.2, 0.7]))


@pytest.fixture
def tuft():
    return Tuft(find_brush("broad"), np.random.default_rng(1))


def straight(depth, length=60.0, lift=True):
    x = np.arange(0, length, 0.3)
    path = np.c_[x, np.zeros_like(x), np.full_like(x, depth)]
    if lift:
        up = np.linspace(depth, -0.05, 20)
        path = np.r_[path, np.c_[np.full_like(up, x[-1]), np.zeros_like(up), up]]
    return path


def width(feet):
    middle = feet[len(feet) // 2]
    return np.ptp(middle[middle[:, 2] > 0, 1])


def test_the_harder_the_press_the_wider_the_mark_and_the_more_bristles_touch(tuft):
    feet = [tuft.feet(straight(depth))[0] for depth in (0.05, 0.4, 0.8)]
    assert width(feet[0]) < width(feet[1]) < width(feet[2])
    touching = [(part[100, :, 2] > 0).sum() for part in feet]
    assert touching[0] < touching[1] <= touching[2]


def test_in_the_air_no_bristle_touches(tuft):
    assert (tuft.feet(straight(-0.01, lift=False))[0][..., 2] <= 0).all()


def test_the_tuft_trails_behind_the_tip_and_cuts_corners(tuft):
    there = np.arange(0, 40, 0.3)
    corner = np.r_[np.c_[there, 0 * there], np.c_[0 * there + there[-1], there]]
    feet, _ = tuft.feet(np.c_[corner, np.full(len(corner), 0.6)])
    behind = corner[100, 0] - feet[100, :, 0].mean()
    assert behind > 2.0
    after_the_turn = len(there) + 10
    assert feet[after_the_turn, :, 0].mean() < corner[after_the_turn, 0] - 1.0


def test_locks_tear_off_one_after_another(tuft):
    feet, _ = tuft.feet(straight(0.4))
    lifted = [int(np.flatnonzero(feet[:, i, 2] > 0)[-1]) for i in range(feet.shape[1])]
    assert len(set(lifted)) > 8


def test_filling_keeping_and_settling_account_for_every_microlitre(tuft):
    taken = tuft.fill(BLUE)
    assert 0.7 * tuft.brush.capacity < taken <= tuft.brush.capacity
    assert tuft.volume == pytest.approx(taken)
    pigment = tuft.pigment.sum(0)
    tuft.settle()
    assert tuft.volume == pytest.approx(taken)
    assert np.allclose(tuft.pigment.sum(0), pigment)
    assert tuft.keep(0.25) == pytest.approx(0.75 * taken)
    assert tuft.volume == pytest.approx(0.25 * taken)
