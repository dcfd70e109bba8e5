import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.errors import CalibrationError
from frida_painter.perception.rectify import Fit, apply, fit_homography

PLACES = np.stack(np.meshgrid(np.linspace(0.04, 0.31, 4), np.linspace(0.03, 0.25, 4)), -1).reshape(-1, 2)
small = st.floats(-0.06, 0.06)


def matrix(a: float, b: float, c: float, d: float, x: float, y: float, u: float, v: float) -> np.ndarray:
    return np.array([[1 + a, b, x / 4], [c, 1 + d, y / 4], [u, v, 1]])


@given(st.tuples(*[small] * 8))
def test_a_homography_is_found_again_and_its_inverse_leads_back(numbers) -> None:
    true = matrix(*numbers)
    fit = fit_homography(PLACES, apply(true, PLACES))
    assert np.allclose(apply(fit.matrix, PLACES), apply(true, PLACES), atol=1e-6)
    assert fit.residual < 1e-6
    around = np.array([(0.0, 0.0), (0.36, 0.0), (0.36, 0.28), (0.0, 0.28), (0.1, 0.2)])
    assert np.allclose(apply(fit.inverse(), apply(fit.matrix, around)), around, atol=1e-9)


def noisy(true: np.ndarray, seed: int, noise: float = 0.0003) -> np.ndarray:
    return apply(true, PLACES) + np.random.default_rng(seed).normal(0, noise, PLACES.shape)


@pytest.mark.parametrize(
    ("true", "kind"),
    [
        (
            np.array([[np.cos(0.03), -np.sin(0.03), 0.004], [np.sin(0.03), np.cos(0.03), -0.002], [0, 0, 1]]),
            "similarity",
        ),
        (matrix(0.04, 0.03, 0.02, -0.04, 0.01, 0.01, 0, 0), "affine"),
        (matrix(0, 0, 0, 0, 0, 0, 0.2, -0.2), "homography"),
    ],
)
def test_the_simplest_map_that_explains_the_dots_is_taken(true: np.ndarray, kind: str) -> None:
    kinds = [fit_homography(PLACES, noisy(true, seed)).kind for seed in range(20)]
    assert kinds.count(kind) >= 15


def test_what_was_made_up_is_less_for_it() -> None:
    """Of noisy dots of a robot that stands askew, the fit is nearer to the truth than a free homography."""
    import cv2

    true = np.array([[0.9994, -0.0349, 0.004], [0.0349, 0.9994, 0.002], [0, 0, 1]])
    around = np.array([(0.01, 0.01), (0.35, 0.01), (0.35, 0.27), (0.01, 0.27)])

    def off(matrix: np.ndarray) -> float:
        return float(np.linalg.norm(apply(matrix, around) - apply(true, around), axis=1).mean())

    chosen = [off(fit_homography(PLACES, noisy(true, seed)).matrix) for seed in range(20)]
    free = [off(cv2.findHomography(PLACES, noisy(true, seed), 0)[0]) for seed in range(20)]
    assert np.mean(chosen) < 0.7 * np.mean(free)


def test_a_dot_far_off_the_others_does_not_count() -> None:
    true = matrix(0, 0.03, -0.03, 0, 0.01, 0, 0, 0)
    seen = noisy(true, 3)
    seen[5] += (0.004, -0.003)
    fit = fit_homography(PLACES, seen)
    assert not fit.used[5] and fit.used.sum() >= 14
    assert fit.off[5] > 0.003 and fit.residual < 0.001


@pytest.mark.parametrize(
    ("seen", "says"),
    [
        ((0.35, 0) + PLACES * (-1, 1), "mirrored"),
        ((0, 0.28) + PLACES * (1, -1), "mirrored"),
        (PLACES[:, ::-1], "mirrored"),
        (PLACES * (1, 0.02), "singular"),
        (PLACES * 0.1, "singular"),
        (np.full_like(PLACES, 0.1), "singular"),
        (PLACES * np.nan, "0 places"),
    ],
)
def test_an_impossible_fit_is_refused(seen: np.ndarray, says: str) -> None:
    with pytest.raises(CalibrationError, match=f"{says}.*[Rr]epeat the robot calibration"):
        fit_homography(PLACES, seen)


def test_too_few_dots_or_dots_on_one_line_are_refused() -> None:
    with pytest.raises(CalibrationError, match="4 places"):
        fit_homography(PLACES[:4], PLACES[:4])
    line = np.stack((np.linspace(0, 0.3, 12), np.linspace(0, 0.2, 12)), -1)
    with pytest.raises(CalibrationError, match="on one line"):
        fit_homography(line, line + 0.001)


def test_the_residual_is_that_of_the_places_used() -> None:
    fit = Fit(np.eye(3), "similarity", np.array([0.003, 0.004, 9.0]), np.array([True, True, False]))
    assert fit.residual == pytest.approx(np.sqrt((9 + 16) / 2) / 1000)
