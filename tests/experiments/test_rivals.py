import numpy as np
import pytest
import torch

from frida_painter.experiments.rivals import BEZIER, MEAN, RIVALS, ZEROS, errors, fingerprint, learn
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


def test_the_same_seed_learns_the_same_and_never_from_the_test(strokes):
    first, second = (learn("param2stroke", strokes[:16], seed=3, quick=True)(strokes[16:]) for _ in range(2))
    assert torch.equal(first, second)


def test_another_pixel_is_another_library(strokes):
    changed = library(24)
    assert fingerprint(changed) == fingerprint(strokes)
    changed.magnitude[3, 5, 7] ^= 1
    assert fingerprint(changed) != fingerprint(strokes)
