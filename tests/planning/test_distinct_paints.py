import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.palette import Palette, ciede2000, from_lab, to_lab
from frida_painter.planning.refine import HARDLY_APART, distinct, without_twins
from frida_painter.planning.variables import Paints


def nearest_pair(color: torch.Tensor) -> float:
    gap = ciede2000(to_lab(color)[:, None], to_lab(color)[None])
    return float(gap.fill_diagonal_(torch.inf).min())


@given(st.integers(1, 12), st.integers(0, 1000), st.sampled_from([HARDLY_APART, 5.0]))
def test_no_two_wells_are_twins_and_there_are_no_more_of_them(count: int, seed: int, apart: float) -> None:
    chance = torch.Generator().manual_seed(seed)
    color = torch.rand(40, 3, generator=chance) * torch.rand(3, generator=chance)
    weight = torch.rand(40, generator=chance)
    palette = distinct(Palette.cluster(color, weight, count, seed), color, weight, apart)
    assert 1 <= len(palette) <= count
    assert len(palette) == 1 or nearest_pair(palette.color) >= apart - 0.01
    assert bool((palette.lab()[:-1, 0] >= palette.lab()[1:, 0] - 1e-3).all()), "lightest first"


def test_a_well_that_twins_shared_goes_to_the_accent_that_was_drowned() -> None:
    """Two greens that nobody tells apart, and a small red for which there was no well."""
    greens = torch.tensor([[0x07, 0x7F, 0x4B], [0x06, 0x76, 0x46]]) / 255
    red = torch.tensor([[0.8, 0.1, 0.1]])
    color, weight = torch.cat((greens.repeat(10, 1), red)), torch.ones(21)
    palette = distinct(Palette(greens), color, weight, 5.0)
    assert len(palette) == 2 and float((palette.color - red).abs().sum(1).min()) < 1e-6
    assert torch.allclose(palette.color[palette.color[:, 1].argmax()], greens.mean(0), atol=5e-3)


def test_where_one_colour_is_all_there_is_one_well() -> None:
    color = torch.full((9, 3), 0.4)
    assert len(distinct(Palette.cluster(color, torch.ones(9), 5, 0), color, torch.ones(9), HARDLY_APART)) == 1


def test_paints_that_grew_alike_become_one_and_strokes_keep_theirs() -> None:
    color = from_lab(torch.tensor([[80.0, 0, 0], [50, 40, 0], [51, 40, 0], [20, 0, 0]]))
    paints = without_twins(Paints(color, torch.tensor([0, 1, 1, 2, 3])), HARDLY_APART)
    assert len(paints.color) == 3 and paints.paint.tolist() == [0, 1, 1, 1, 2]
    assert torch.allclose(paints.color[1], (2 * color[1] + color[2]) / 3, atol=1e-5)
    kept = without_twins(paints, HARDLY_APART)
    assert torch.equal(kept.color, paints.color) and torch.equal(kept.paint, paints.paint)
