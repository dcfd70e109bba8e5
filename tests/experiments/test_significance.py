import numpy as np
import pytest

from frida_painter.experiments.significance import PairedTest


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
