import torch

from frida_painter.drawing.compositing import recolor
from frida_painter.palette import to_lab

BLUE = torch.tensor([0.16, 0.36, 0.75])


def drawing(*stripes: tuple[float, float, float], opacity: float = 1.0) -> torch.Tensor:
    """Colours side by side, each ten columns wide."""
    colors = torch.tensor(stripes).T[:, None, :].repeat_interleave(10, 2).expand(3, 10, -1)
    return torch.cat((colors, torch.full((1, 10, colors.shape[2]), opacity)))


def test_the_main_colour_and_its_shades_change_and_all_else_stays() -> None:
    brown, shade, outline, beak = (0.65, 0.47, 0.22), (0.42, 0.28, 0.12), (0.0, 0.0, 0.0), (0.2, 0.7, 0.3)
    changed = recolor(drawing(brown, brown, shade, outline, beak), BLUE)
    assert torch.allclose(changed[:3, 5, 5], BLUE, atol=0.02)
    red, _, blue = changed[:3, 5, 25].tolist()
    assert blue > red and blue < float(BLUE[2]), "a darker blue"
    assert torch.allclose(changed[:3, 5, 35:].flatten(1).unique(dim=1).T, torch.tensor([outline, beak]), atol=0.01)
    assert torch.equal(changed[3], torch.ones(10, 50))


def test_what_becomes_white_has_gray_shades() -> None:
    changed = recolor(drawing((0.65, 0.47, 0.22), (0.65, 0.47, 0.22), (0.42, 0.28, 0.12)), torch.ones(3))
    assert float(changed[:3, 5, 25].max() - changed[:3, 5, 25].min()) < 0.03


def test_white_things_and_black_ones_can_be_coloured_and_nothing_stays_nothing() -> None:
    for gray in (0.95, 0.02):
        assert torch.allclose(recolor(drawing((gray,) * 3), BLUE)[:3, 5, 5], BLUE, atol=0.02)
    nothing = drawing((0.5, 0.5, 0.5), opacity=0.0)
    assert torch.equal(recolor(nothing, BLUE), nothing)


def test_a_toy_of_many_colours_becomes_one_of_a_colour() -> None:
    toy = drawing((0.8, 0.1, 0.1), (0.1, 0.6, 0.2), (0.9, 0.8, 0.1), (0.6, 0.2, 0.7), (0.02, 0.02, 0.02))
    changed = to_lab(recolor(toy, BLUE)[:3, 5, [5, 15, 25, 35]].T)
    assert bool((changed[:, 2] < -10).all())
    assert torch.allclose(recolor(toy, BLUE)[:3, 5, 45], toy[:3, 5, 45], atol=0.02), "an outline"
