import math

import pytest
import torch

from frida_painter.lab.trials import (
    direction_agreement,
    edge_correlation,
    edge_score,
    exact_emd,
    feature_distance,
    near_borders,
    perceptual_distance,
    psnr,
)
from support.networks import QuickEncoders, QuickVgg
from support.planning import CANVAS, picture, some_strokes
from support.transport import exact_transport


def test_the_same_picture_is_perfect_by_every_measure() -> None:
    image = picture(120, 160)
    assert psnr(image, image) > 100
    assert edge_score(image, image) == 1 and edge_correlation(image, image) == pytest.approx(1)
    assert feature_distance(QuickEncoders().meaning(), image, image, 48) == pytest.approx(0, abs=1e-5)
    assert perceptual_distance(QuickVgg(), image, image) == pytest.approx(0, abs=1e-5)


def test_another_picture_is_not() -> None:
    image, other = picture(120, 160), picture(120, 160).flip(1).flip(2)
    assert psnr(image, torch.zeros_like(image)) < 10
    assert edge_score(image, other) < 0.6 and edge_score(image, torch.ones_like(image)) == 0
    assert edge_correlation(image, other) < 0.5
    assert feature_distance(QuickEncoders().meaning(), image, other, 48) > 0.01
    assert perceptual_distance(QuickVgg(), image, other) > 0.01


def test_an_edge_that_is_a_little_off_is_found_again() -> None:
    image = torch.ones(3, 256, 320)
    image[:, 100:] = 0.2
    near, far = (torch.roll(image, shift, 1) for shift in (4, 30))
    near[:, :50], far[:, :50] = 1, 1
    assert edge_score(near[:, :200], image[:, :200]) == 1 and edge_score(far[:, :200], image[:, :200]) == 0


def test_an_assignment_is_the_exact_transport_between_equal_weights() -> None:
    cost = torch.rand(30, 30, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    assert exact_emd(cost) == pytest.approx(exact_transport(cost.numpy()))


def test_borders_lie_between_regions_and_one_pixel_beside_them():
    regions = torch.zeros(6, 8, dtype=torch.long)
    regions[:, 5:] = 2
    regions[0, 0] = -1
    near = near_borders(regions)
    expected = torch.zeros(6, 8, dtype=torch.bool)
    expected[:, 4:6] = True
    expected[0, :2] = expected[1, 0] = True
    assert torch.equal(near, expected)
    assert not near_borders(torch.full((4, 4), 7)).any()


def test_strokes_agree_with_marks_that_go_their_way() -> None:
    stripes = (0.5 + 0.4 * torch.sin(torch.arange(120) / 2))[None, :, None].expand(3, -1, 160).contiguous()
    strokes = some_strokes(40)
    along, across = (strokes.with_groups(angle=torch.full((40,), angle)) for angle in (math.pi, math.pi / 2))
    assert direction_agreement(along, stripes, CANVAS) > 0.95
    assert direction_agreement(across, stripes, CANVAS) < -0.95
    assert abs(direction_agreement(strokes, stripes, CANVAS)) < 0.4
