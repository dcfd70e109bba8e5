"""Paint, brushes and their bristles, and the compiled loops of all of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.errors import ConfigError
from frida_painter.virtual import bristles, camera, canvas
from frida_painter.virtual.bristles import Tuft, brush_names, find_brush
from frida_painter.virtual.paint import absorption_and_scattering, film_over, to_linear, to_srgb
from frida_painter.virtual.studio import load_kernels

from .hand import Hand

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


def test_brushes_grow_from_fine_to_broad_and_open_when_pressed():
    brushes = [find_brush(name) for name in brush_names()]
    assert brush_names() == ("fine", "medium", "broad")
    assert [b.radius(0.8) for b in brushes] == sorted(b.radius(0.8) for b in brushes)
    assert all(b.radius(0.05) < b.radius(0.5) < b.radius(1) for b in brushes)


def test_an_unknown_brush_is_refused_by_naming_the_known_ones():
    with pytest.raises(ConfigError, match=r"'mop'.*fine, medium, broad"):
        load_kernels("mop")


def loaded() -> dict[str, int]:
    """How many versions of each kernel are loaded."""
    kernels = (bristles._trail, canvas._settle, canvas._exchange, canvas._look, camera._lay, camera._develop)
    return {kernel.__name__: len(kernel.signatures) for kernel in kernels}


def test_nothing_is_left_to_load_when_painting_begins() -> None:
    load_kernels("fine")
    before = loaded()
    hand = Hand((0.2, 0.2, 0.3), (0.8, 0.7, 0.1), brush="broad")
    hand.dip(0)
    hand.stroke(0.03, 0.03, 0.04)
    hand.dip(1)
    hand.stroke(0.03, 0.035, 0.04, angle=0.4)
    hand.easel.camera.capture(0)
    assert loaded() == before and all(before.values())


channel = st.floats(0.0, 1.0)


@given(st.lists(channel, min_size=3, max_size=3))
def test_srgb_and_linear_light_are_inverse(color):
    assert np.allclose(to_srgb(to_linear(np.array(color))), color, atol=1e-6)


@given(st.lists(st.floats(0.1, 0.98), min_size=3, max_size=3), channel)
def test_a_thick_film_has_the_paint_s_own_colour_over_any_ground(color, ground):
    paint = absorption_and_scattering(np.array(color))
    seen = [film_over(paint[band], paint[3 + band], 50.0, ground) for band in range(3)]
    assert np.allclose(to_srgb(np.array(seen)), color, atol=2e-3)


@given(st.floats(0.1, 800), st.floats(1, 200), st.floats(0.001, 0.1), st.floats(0.001, 0.1), channel)
def test_two_films_of_one_paint_are_one_thicker_film(k, s, first, second, ground):
    stacked = film_over(k, s, second, film_over(k, s, first, ground))
    assert stacked == pytest.approx(film_over(k, s, first + second, ground), abs=1e-6)


def test_no_film_shows_the_ground_and_more_film_hides_more_of_it():
    white = absorption_and_scattering(np.array([1.0, 1.0, 1.0]))
    over_black = [film_over(white[0], white[3], thickness, 0.01) for thickness in (0.0, 0.01, 0.03, 0.06, 0.2)]
    assert over_black[0] == pytest.approx(0.01)
    assert np.all(np.diff(over_black) > 0)
    assert over_black[3] > 0.85


def test_yellow_and_blue_mix_to_green_and_white_lightens_black_to_a_middle_grey():
    paint = absorption_and_scattering(np.array([[1.0, 0.85, 0.1], [0.1, 0.3, 0.75], [1.0, 1, 1], [0.05, 0.05, 0.05]]))
    green, grey = (to_srgb(np.array([film_over(*mix[[b, 3 + b]], 9.0, 1.0) for b in range(3)]))
                   for mix in ((paint[0] + paint[1]) / 2, (paint[2] + paint[3]) / 2))  # fmt: skip
    assert green[1] > green[0] + 0.05
    assert green[1] > green[2] + 0.02
    assert 0.25 < grey[0] < 0.7
