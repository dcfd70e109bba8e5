import numpy as np
import pytest
import torch

from frida_painter.errors import FrameRejected
from frida_painter.perception.flatfield import FlatField
from frida_painter.system.images import to_linear, to_srgb


def room(rows: int, columns: int) -> torch.Tensor:
    """Uneven light with a cast: a lamp to the left, a vignette; [3, rows, columns]."""
    down = torch.linspace(-1, 1, rows)[:, None]
    across = torch.linspace(-1, 1, columns)
    falloff = 0.9 * (1 - 0.2 * across - 0.1 * down) * (1 - 0.15 * (across**2 + down**2)) / 1.2
    return torch.tensor([0.98, 0.9, 0.75])[:, None, None] * falloff


def photographed(canvas: torch.Tensor, noise: float = 0.0) -> torch.Tensor:
    light = room(*canvas.shape[1:])
    chance = torch.Generator().manual_seed(0)
    return to_srgb(to_linear(canvas) * light + noise * torch.randn(canvas.shape, generator=chance))


def flat(color, rows: int = 90, columns: int = 120) -> torch.Tensor:
    return torch.tensor(color)[:, None, None].expand(3, rows, columns)


@pytest.mark.parametrize("ground", [(1.0, 1.0, 1.0), (0.8, 0.7, 0.5)])
def test_colours_are_what_they_are_everywhere(ground):
    light = FlatField.learn(photographed(flat(ground), noise=0.004), ground)
    for color in ((0.9, 0.2, 0.1), (0.1, 0.3, 0.8), (0.05, 0.05, 0.05)):
        seen = light.correct(photographed(flat(color)))
        assert (seen - flat(color)).abs().max() < 0.015


def test_it_serves_pictures_of_every_size():
    light = FlatField.learn(photographed(flat((1.0, 1.0, 1.0))), (1.0, 1.0, 1.0))
    seen = light.correct(photographed(flat((0.4, 0.5, 0.6), 301, 211)))
    assert (seen - flat((0.4, 0.5, 0.6), 301, 211)).abs().max() < 0.015


def test_specks_on_the_canvas_are_not_mistaken_for_shadows():
    bare = flat((1.0, 1.0, 1.0)).clone()
    bare[:, 20:26, 30:36] = 0.2
    light = FlatField.learn(photographed(bare), (1.0, 1.0, 1.0))
    seen = light.correct(photographed(flat((0.5, 0.5, 0.5))))
    assert (seen - 0.5).abs().max() < 0.02


def test_a_painted_canvas_is_not_taken_for_a_bare_one():
    painted = torch.from_numpy(np.random.default_rng(0).random((3, 6, 8))).float()
    painted = torch.nn.functional.interpolate(painted[None], size=(90, 120))[0]
    with pytest.raises(FrameRejected, match="bare"):
        FlatField.learn(photographed(painted), (1.0, 1.0, 1.0))


def test_too_little_and_too_much_light_are_refused():
    with pytest.raises(FrameRejected, match="too dark"):
        FlatField.learn(flat((0.1, 0.1, 0.1)), (1.0, 1.0, 1.0))
    with pytest.raises(FrameRejected, match="overexposed"):
        FlatField.learn(flat((1.0, 1.0, 1.0)), (1.0, 1.0, 1.0))


@pytest.mark.parametrize(
    ("gain", "lean"), [((0.7, 0.7, 0.7), (0.0, 0.0)), ((1.0, 0.9, 0.6), (0.0, 0.0)), ((0.9, 0.9, 0.9), (0.3, -0.2))]
)
def test_another_light_is_followed_by_what_is_still_bare(gain, lean):
    down, across = torch.meshgrid(torch.linspace(-1, 1, 90), torch.linspace(-1, 1, 120), indexing="ij")
    first = (0.7 - 0.1 * across - 0.05 * down**2) * torch.tensor([0.95, 0.9, 0.8])[:, None, None]
    field = FlatField.learn(to_srgb(first), (1.0, 1.0, 1.0))
    later = first * torch.tensor(gain)[:, None, None] * (1 + lean[0] * across + lean[1] * down)
    painted = torch.rand(90, 120, generator=torch.Generator().manual_seed(0)) < 0.3
    light = torch.where(painted, 0.05 * later, later)
    renewed = field.refit(light, ~painted, (1.0, 1.0, 1.0)).light(90, 120)
    assert (renewed / later - 1).abs().max() < 0.02


def test_where_nothing_is_bare_the_light_stays_as_it_was():
    field = FlatField.learn(torch.full((3, 90, 120), 0.8), (1.0, 1.0, 1.0))
    again = field.refit(torch.full((3, 90, 120), 0.1), torch.zeros(90, 120, dtype=torch.bool), (1.0, 1.0, 1.0))
    assert again is field
