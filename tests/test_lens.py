import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.errors import CalibrationError
from frida_painter.frames import Lens

coefficient = st.floats(-0.05, 0.05)


@given(st.tuples(coefficient, coefficient, st.just(0.001), st.just(-0.002), coefficient))
def test_straightening_undoes_bending(coefficients) -> None:
    lens = Lens((900.0, 880.0), (640.0, 360.0), coefficients)
    pixels = np.stack(np.meshgrid(np.linspace(0, 1279, 9), np.linspace(0, 719, 7)), -1).reshape(-1, 2)
    assert np.allclose(lens.undistort(lens.distort(pixels)), pixels, atol=1e-6)
    assert np.allclose(lens.distort(lens.undistort(pixels)), pixels, atol=1e-6)


@given(st.tuples(coefficient, coefficient, coefficient, coefficient, coefficient))
def test_a_lens_bends_as_opencv_says(coefficients) -> None:
    lens = Lens((900.0, 880.0), (640.0, 360.0), coefficients)
    pixels = np.stack(np.meshgrid(np.linspace(0, 1279, 9), np.linspace(0, 719, 7)), -1).reshape(-1, 2)
    rays = np.concatenate(((pixels - lens.middle) / lens.focal, np.ones((len(pixels), 1))), 1)
    matrix = np.array([[900.0, 0, 640.0], [0, 880.0, 360.0], [0, 0, 1]])
    wanted, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, np.array(coefficients))
    assert np.abs(lens.distort(pixels) - wanted.reshape(-1, 2)).max() < 1e-9


def test_a_barrel_draws_the_corner_inwards_and_leaves_the_middle() -> None:
    lens = Lens((1000.0, 1000.0), (799.5, 599.5), (-0.006, 0.0, 0.0, 0.0, 0.0))
    corner, middle = lens.distort(np.array([(0.0, 0.0), (799.5, 599.5)]))
    assert 4 < corner[0] < 6 and 3 < corner[1] < 5
    assert middle.tolist() == [799.5, 599.5]


def test_where_the_lens_shows_nothing_there_is_no_number() -> None:
    lens = Lens((200.0, 200.0), (159.5, 119.5), (-0.3, 0.0, 0.0, 0.0, 0.0))
    far, near = lens.undistort(np.array([(0.0, 0.0), (100.0, 100.0)]))
    assert np.isnan(far).all() and np.isfinite(near).all()


@pytest.mark.parametrize(
    ("focal", "coefficients"),
    [
        ((0.0, 900.0), (0.0,) * 5),
        ((900.0, float("nan")), (0.0,) * 5),
        ((900.0, 900.0), (2.0, 0.0, 0.0, 0.0, 0.0)),
        ((900.0, 900.0), (float("inf"), 0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_a_lens_that_cannot_be_is_refused(focal, coefficients) -> None:
    with pytest.raises(CalibrationError, match="repeat the canvas"):
        Lens(focal, (640.0, 360.0), coefficients)
