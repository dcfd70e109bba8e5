import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.virtual.paint import absorption_and_scattering, film_over, to_linear, to_srgb

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
