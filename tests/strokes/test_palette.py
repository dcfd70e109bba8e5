import math

import cv2
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.errors import ConfigError
from frida_painter.strokes.palette import Palette, ciede2000, from_lab, to_hex, to_lab


def random_colors(count: int, seed: int) -> torch.Tensor:
    return torch.rand(count, 3, generator=torch.Generator().manual_seed(seed))


def lab_of_opencv(colors: torch.Tensor) -> torch.Tensor:
    return torch.from_numpy(cv2.cvtColor(colors[None].numpy(), cv2.COLOR_RGB2Lab)[0])


@given(st.integers(0, 2**31))
def test_lab_is_the_cie_lab_of_another_library_and_comes_back(seed: int) -> None:
    colors = random_colors(50, seed)
    assert torch.allclose(to_lab(colors), lab_of_opencv(colors), atol=0.6)
    assert torch.allclose(from_lab(to_lab(colors)), colors, atol=8e-3)


def test_lab_keeps_shape_precision_and_emptiness() -> None:
    assert to_lab(torch.rand(2, 5, 3).double()).shape == (2, 5, 3)
    assert to_lab(torch.rand(4, 3).double()).dtype == torch.float64
    assert to_lab(torch.zeros(0, 3)).shape == (0, 3)


def test_lab_outside_srgb_comes_to_its_nearest_side() -> None:
    wild = from_lab(torch.tensor([[50.0, 120.0, -120.0], [150.0, 0.0, 0.0]]))
    assert bool(((wild >= 0) & (wild <= 1)).all())


@given(st.integers(1, 64), st.integers(0, 2**31))
def test_a_palette_goes_from_light_to_dark(count: int, seed: int) -> None:
    colors = random_colors(count, seed)
    palette = Palette.sort_light_to_dark(colors)
    lightness = palette.lab()[:, 0]
    assert bool((lightness[:-1] >= lightness[1:]).all())
    assert sorted(map(tuple, palette.color.tolist())) == sorted(map(tuple, colors.tolist()))


@given(st.integers(1, 12), st.integers(0, 2**31))
def test_the_nearest_paint_of_a_paint_is_itself(count: int, seed: int) -> None:
    palette = Palette.sort_light_to_dark(random_colors(count, seed))
    assert torch.equal(palette.nearest(palette.color), torch.arange(count))


def test_clusters_are_found_weighted_and_repeatable() -> None:
    centers = torch.tensor([[0.9, 0.9, 0.8], [0.8, 0.2, 0.1], [0.05, 0.1, 0.3]])
    noise = torch.randn(300, 3, generator=torch.Generator().manual_seed(0)) * 0.01
    colors = (centers.repeat(100, 1) + noise).clamp(0, 1)
    palette = Palette.cluster(colors, torch.ones(300), 3, seed=0)
    assert torch.allclose(palette.color, centers, atol=0.02)
    assert torch.equal(palette.color, Palette.cluster(colors, torch.ones(300), 3, seed=0).color)
    heavy = Palette.cluster(torch.tensor([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]), torch.tensor([1.0, 9.0]), 1, seed=0)
    assert heavy.color[0].tolist() == pytest.approx([0.9, 0.9, 0.9], abs=0.005)


@pytest.mark.parametrize("count", [1, 2, 5, 64])
def test_there_are_always_as_many_paints_as_were_asked_for(count: int) -> None:
    two = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]).repeat(5, 1)
    palette = Palette.cluster(two, torch.ones(10), count, seed=0)
    assert len(palette) == count
    assert bool((palette.lab()[:-1, 0] >= palette.lab()[1:, 0] - 1e-3).all())


@pytest.mark.parametrize("color", [torch.zeros(0, 3), torch.zeros(65, 3), torch.zeros(3), torch.zeros(2, 4)])
def test_a_palette_has_1_to_64_paints(color: torch.Tensor) -> None:
    with pytest.raises(ConfigError, match="1 to 64 colours"):
        Palette(color)


@pytest.mark.parametrize("value", [-0.01, 1.01, math.nan, math.inf])
def test_a_color_outside_srgb_is_refused(value: float) -> None:
    with pytest.raises(ConfigError, match=r"outside \[0, 1\]"):
        Palette(torch.tensor([[0.5, 0.5, value]]))


def test_hex() -> None:
    assert to_hex(torch.tensor([1.0, 0.5, 0.0])) == "#ff8000"


PAIRS = (  # of Sharma, Wu and Dalal, 2005, table 1
    ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
    ((50.0, -1.3802, -84.2814), (50.0, 0.0, -82.7485), 1.0),
    ((50.0, 0.0, 0.0), (50.0, -1.0, 2.0), 2.3669),
    ((50.0, 2.49, -0.001), (50.0, -2.49, 0.0009), 7.1792),
    ((50.0, 2.49, -0.001), (50.0, -2.49, 0.0011), 7.2195),
    ((50.0, -0.001, 2.49), (50.0, 0.0009, -2.49), 4.8045),
    ((50.0, -0.001, 2.49), (50.0, 0.0011, -2.49), 4.7461),
    ((50.0, 2.5, 0.0), (50.0, 0.0, -2.5), 4.3065),
    ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
    ((50.0, 2.5, 0.0), (56.0, -27.0, -3.0), 31.9030),
    ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ((22.7233, 20.0904, -46.6940), (23.0331, 14.9730, -42.5619), 2.0373),
    ((90.9257, -0.5406, -0.9208), (88.6381, -0.8985, -0.7239), 1.5381),
    ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
)


def test_differences_are_those_that_the_authors_of_the_formula_published() -> None:
    one, other, published = (torch.tensor(part, dtype=torch.float64) for part in zip(*PAIRS, strict=True))
    torch.testing.assert_close(ciede2000(one, other), published, rtol=0, atol=5e-5)
    torch.testing.assert_close(ciede2000(other, one), published, rtol=0, atol=5e-5)
    assert ciede2000(one[:, None], other[None]).shape == (len(PAIRS), len(PAIRS))
