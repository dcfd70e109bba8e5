import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.mixing.paint import BANDS, color_of, reflectance_of

parts = st.floats(0.08, 0.96)
colors = st.tuples(parts, parts, parts).map(lambda color: torch.tensor(color, dtype=torch.float64))


@given(colors)
def test_the_smoothest_reflectance_has_the_colour_it_was_made_for(color: torch.Tensor) -> None:
    found = reflectance_of(color)
    assert found.shape == (len(BANDS),) and bool(((found > 0) & (found < 1)).all())
    assert torch.allclose(color_of(found), color, atol=1e-6)


def test_grey_reflects_alike_everywhere_and_all_of_it_is_white() -> None:
    grey = reflectance_of(torch.full((3,), 0.5, dtype=torch.float64))
    assert float(grey.max() - grey.min()) < 1e-6
    assert torch.allclose(color_of(torch.ones(16, dtype=torch.float64)), torch.ones(3, dtype=torch.float64))


def test_every_colour_even_the_purest_has_one() -> None:
    corners = torch.cartesian_prod(*3 * [torch.tensor([0.0, 1.0], dtype=torch.float64)])
    found = reflectance_of(corners)
    assert found.shape == (8, 16) and bool(torch.isfinite(found).all())
    assert float((color_of(found) - corners).abs().max()) < 0.05, "brought to where paints end"


def test_a_yellow_reflects_long_waves_and_a_blue_short_ones() -> None:
    yellow, blue = reflectance_of(torch.tensor([[0.95, 0.85, 0.1], [0.15, 0.2, 0.7]], dtype=torch.float64))
    assert float(yellow[8:].mean()) > 3 * float(yellow[:4].mean())
    assert float(blue[:4].mean()) > 3 * float(blue[10:].mean())


def test_none_at_all_gives_none() -> None:
    assert reflectance_of(torch.zeros(0, 3)).shape == (0, 16)
