import pytest
import torch

from frida_painter.perception.color import fit_color, true_color
from frida_painter.strokes.palette import difference
from frida_painter.system.images import to_linear, to_srgb
from photographs import calibration


def colors(count: int = 24, seed: int = 0) -> torch.Tensor:
    """Linear light of colours from all over sRGB, [n, 3]."""
    return to_linear(torch.rand(count, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64))


def leaking(light: torch.Tensor, stray: float = 0.004) -> torch.Tensor:
    """As a camera sees it whose bands leak into each other, and that stray light reaches."""
    mix = torch.tensor([[0.80, 0.10, 0.05], [0.08, 0.70, 0.10], [0.02, 0.12, 0.60]], dtype=light.dtype)
    return light @ mix.T + stray


def test_the_affine_map_is_applied_to_the_light_of_every_pixel_and_kept_in_range():
    swapped = calibration(color=((0, 1, 0, 0), (1, 0, 0, 0.1), (0, 0, 2, -0.5)))
    light = torch.tensor([0.2, 0.4, 0.9])
    picture = to_srgb(light)[:, None, None].expand(3, 4, 5)
    wanted = to_srgb(torch.tensor([0.4, 0.3, 1.0]))[:, None, None].expand(3, 4, 5)
    torch.testing.assert_close(true_color(picture, swapped), wanted)


def test_the_default_changes_nothing():
    picture = torch.rand(3, 4, 5, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(true_color(picture, calibration()), picture)


def test_what_the_camera_does_to_light_is_undone_for_colours_it_never_saw():
    known, others = colors(), colors(50, seed=1)
    fit = fit_color(leaking(known), known)
    assert float(fit.before.mean()) > 7
    assert float(fit.held_out.max()) < 0.01
    record = calibration(color=tuple(map(tuple, fit.affine.tolist())))
    seen = to_srgb(leaking(others)).T[:, None]  # [3, 1, n]
    torch.testing.assert_close(true_color(seen, record), to_srgb(others).T[:, None], atol=1e-4, rtol=0)


def test_a_patch_that_is_not_what_it_should_be_shows_among_those_held_out_more_than_among_those_fitted():
    known = colors()
    perceived = leaking(known)
    perceived[7] = torch.tensor([0.5, 0.1, 0.1])
    fit = fit_color(perceived, known)
    mapped = perceived[7] @ fit.affine[:, :3].T + fit.affine[:, 3]
    assert int(fit.held_out.argmax()) == 7
    assert float(fit.held_out[7]) > float(difference(to_srgb(mapped), to_srgb(known[7]))) > 3


@pytest.mark.parametrize("held", [0, 23])
def test_held_out_is_what_a_fit_without_that_colour_says_of_it(held):
    chance = torch.Generator().manual_seed(2)
    known = colors()
    perceived = leaking(known) * (1 + 0.05 * torch.randn(24, 3, generator=chance, dtype=torch.float64))
    rest = torch.arange(24) != held
    without = fit_color(perceived[rest], known[rest]).affine
    alone = perceived[held] @ without[:, :3].T + without[:, 3]
    expected = float(difference(to_srgb(alone), to_srgb(known[held])))
    assert float(fit_color(perceived, known).held_out[held]) == pytest.approx(expected, abs=1e-6)


def test_faults_of_the_darkest_patches_are_not_taken_for_stray_light():
    """Where there is none, black stays black, though the chart's dark patches are not quite what is published."""
    known = colors()
    known[:3] = torch.tensor([0.03, 0.05, 0.08], dtype=torch.float64)[:, None]
    printed = known.clone()
    printed[:3] *= 1.08
    assert (fit_color(leaking(printed, stray=0.0), known).affine[:, 3] == 0).all()
    assert (fit_color(leaking(printed, stray=0.01), known).affine[:, 3] < -0.005).all()
