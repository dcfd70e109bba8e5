import numpy as np
import pytest
import torch

from frida_painter.lab.stroke_models import BEZIER, MEAN, RIVALS, ZEROS, PairedTest, errors, fingerprint, learn
from marks import small_library as library


@pytest.fixture(scope="module")
def strokes():
    return library(24)


@pytest.mark.parametrize("rival", RIVALS)
def test_every_rival_predicts_the_crops_as_they_are_stored(strokes, rival):
    predict = learn(rival, strokes[:16], seed=0, quick=True)
    maps = predict(strokes[16:])
    assert maps.shape == strokes[16:].magnitude.shape
    assert float(maps.min()) >= 0 and float(maps.max()) <= 1


def test_errors_are_means_over_the_whole_crop(strokes):
    zeros = errors(learn(ZEROS, strokes, seed=0), strokes)
    np.testing.assert_allclose(zeros, strokes.magnitude.mean((1, 2)) / 255, rtol=1e-5)
    mean = errors(learn(MEAN, strokes, seed=0), strokes)
    wanted = np.abs(strokes.magnitude - strokes.magnitude.mean(0)).mean((1, 2)) / 255
    np.testing.assert_allclose(mean, wanted, rtol=1e-5)


def test_the_fitted_bezier_knows_more_than_nothing(strokes):
    zeros, bezier = (errors(learn(rival, strokes[:16], seed=0, quick=True), strokes[16:]) for rival in (ZEROS, BEZIER))
    assert bezier.mean() < 0.4 * zeros.mean()


@pytest.mark.slow
def test_the_same_seed_learns_the_same_and_never_from_the_test(strokes):
    first, second = (learn("param2stroke", strokes[:16], seed=3, quick=True)(strokes[16:]) for _ in range(2))
    assert torch.equal(first, second)


def test_another_pixel_is_another_library(strokes):
    changed = library(24)
    assert fingerprint(changed) == fingerprint(strokes)
    changed.magnitude[3, 5, 7] ^= 1
    assert fingerprint(changed) != fingerprint(strokes)


def test_a_textbook_example():
    """Student's own data, "The probable error of a mean" (1908): hours of sleep gained by two drugs; t = -4.06."""
    first = np.array([0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0])
    second = np.array([1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4])
    test = PairedTest.of(first, second)
    assert test.difference == pytest.approx(-1.58)
    assert test.better == 9
    assert test.t_p == pytest.approx(0.00283, abs=1e-5)
    assert test.wilcoxon_p < 0.01


def test_noise_is_not_significant_and_equals_are_equal():
    chance = np.random.default_rng(0)
    first, second = chance.normal(size=(2, 40))
    assert min(PairedTest.of(first, second).t_p, PairedTest.of(first, second).wilcoxon_p) > 0.05
    assert PairedTest.of(first, first) == PairedTest(0.0, 0, 1.0, 1.0)
