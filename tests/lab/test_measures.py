import numpy as np
import pytest
import torch

from frida_painter_lab.measures import (
    edge_score,
    feature_distance,
    perceptual_distance,
    psnr,
    ssim,
)
from support.networks import QuickEncoders, QuickVgg
from support.planning import picture


def test_the_same_picture_is_perfect_by_every_measure() -> None:
    image = picture(120, 160)
    assert psnr(image, image) > 100
    assert edge_score(image, image) == 1
    assert feature_distance(QuickEncoders().meaning(), image, image, 48) == pytest.approx(0, abs=1e-5)
    assert perceptual_distance(QuickVgg(), image, image) == pytest.approx(0, abs=1e-5)


def test_another_picture_is_not() -> None:
    image, other = picture(120, 160), picture(120, 160).flip(1).flip(2)
    assert psnr(image, torch.zeros_like(image)) < 10
    assert edge_score(image, other) < 0.6 and edge_score(image, torch.ones_like(image)) == 0
    assert feature_distance(QuickEncoders().meaning(), image, other, 48) > 0.01
    assert perceptual_distance(QuickVgg(), image, other) > 0.01


def test_an_edge_that_is_a_little_off_is_found_again() -> None:
    image = torch.ones(3, 256, 320)
    image[:, 100:] = 0.2
    near, far = (torch.roll(image, shift, 1) for shift in (4, 30))
    near[:, :50], far[:, :50] = 1, 1
    assert edge_score(near[:, :200], image[:, :200]) == 1 and edge_score(far[:, :200], image[:, :200]) == 0


def test_structural_similarity_is_the_published_one() -> None:
    """The numbers are those of scikit-image 0.26: Gaussian windows, sigma 1.5, population variances."""
    y, x = np.mgrid[0:48, 0:64] / np.array([47, 63])[:, None, None]
    one = torch.from_numpy(np.stack((x, y, 0.5 + 0.4 * np.sin(9 * x * y))))
    other = torch.from_numpy(np.stack((x**1.5, 0.8 * y, 0.5 + 0.4 * np.sin(9 * x * y + 0.6))))
    known = [(other, 0.8236398348655053), (other.flip(1), 0.2938106762219849)]
    for seen, wanted in [*known, (torch.full_like(other, 0.5), 0.42744665946380866), (one, 1.0)]:
        assert ssim(one, seen) == pytest.approx(wanted, abs=1e-12)
        assert ssim(seen, one) == pytest.approx(ssim(one, seen), abs=1e-12)
