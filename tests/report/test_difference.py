from collections.abc import Callable

import torch

from frida_painter.report.sheets import difference


def pair() -> tuple[torch.Tensor, torch.Tensor]:
    """A grey ramp, and the same with one square a little and one much lighter."""
    expected = torch.linspace(0.2, 0.6, 128).expand(3, 96, 128).clone()
    seen = expected.clone()
    seen[:, 20:50, 20:50] += 0.12
    seen[:, 40:80, 80:110] = torch.tensor([0.9, 0.2, 0.1])[:, None, None]
    return expected, seen


def test_what_is_as_expected_is_pale_and_what_is_not_is_red(snapshot: Callable[..., None]) -> None:
    picture = difference(*pair())
    assert picture.shape == (3, 96, 128) and bool(((picture >= 0) & (picture <= 1)).all())
    alike, little, much = picture[:, 85, 10], picture[:, 35, 35], picture[:, 60, 95]
    assert alike.max() - alike.min() < 1e-6 and alike.min() > 0.8
    assert little[2] < alike[2] - 0.05 and much.mean() < little.mean()
    snapshot("difference", picture)


def test_two_equal_pictures_have_no_color_at_all() -> None:
    scene = torch.rand(3, 40, 50, generator=torch.Generator().manual_seed(0))
    picture = difference(scene, scene)
    assert torch.allclose(picture[0], picture[1]) and torch.allclose(picture[0], picture[2])


def test_fine_grain_is_no_difference() -> None:
    scene = torch.full((3, 300, 400), 0.5)
    grain = 0.03 * torch.randn(1, 300, 400, generator=torch.Generator().manual_seed(0))
    picture = difference(scene, scene + grain)
    assert (picture.amax(0) - picture.amin(0)).mean() < 0.02
