import pytest
import torch

from frida_painter.objectives.sketch import broaden_lines, clean_drawing, color_drawing, ink


def sheet(rows: int = 120, columns: int = 160) -> torch.Tensor:
    """A black frame of two pixels' width on white paper, and a line beside it."""
    paper = torch.ones(3, rows, columns)
    paper[:, 30:90, 40:100] = 0
    paper[:, 32:88, 42:98] = 1
    paper[:, 20:100, 130:132] = 0
    return paper


def test_a_clean_drawing_stays_as_it_is() -> None:
    torch.testing.assert_close(clean_drawing(sheet()), sheet())


def test_uneven_light_and_the_colour_of_paper_vanish() -> None:
    y, x = torch.meshgrid(torch.linspace(0, 1, 120), torch.linspace(0, 1, 160), indexing="ij")
    light = (0.95 - 0.45 * x * y) * torch.tensor([1.0, 0.95, 0.85])[:, None, None]
    noise = 0.02 * torch.randn(3, 120, 160, generator=torch.Generator().manual_seed(0))
    photographed = ((0.15 + 0.8 * sheet()) * light + noise).clamp(0, 1)
    found = clean_drawing(photographed)
    assert float((ink(found) != ink(sheet())).float().mean()) < 1e-3
    assert float(found[:, ~ink(sheet())].mean()) > 0.99


def test_chalk_on_a_board_is_a_drawing_too() -> None:
    assert torch.equal(ink(clean_drawing(0.9 - 0.8 * sheet())), ink(sheet()))


def test_colored_lines_keep_their_colour() -> None:
    red = 1 - (1 - sheet()) * torch.tensor([0.1, 0.9, 0.9])[:, None, None]
    line = clean_drawing(red)[:, ink(sheet())]
    assert bool((line[0] > 0.8).all()) and bool((line[1:] < 0.1).all())


@pytest.mark.parametrize("value", [0.0, 0.4, 1.0])
def test_bare_paper_and_a_bare_board_have_no_ink(value: float) -> None:
    assert not bool(ink(clean_drawing(torch.full((3, 40, 50), value))).any())


def test_fine_lines_become_as_broad_as_asked_and_broad_ones_stay() -> None:
    broad = broaden_lines(sheet(), 0.1)
    line = ink(broad)[60, 115:150]
    assert 9 <= int(line.sum()) <= 14, "a tenth of 120 rows"
    assert float(line.float() @ torch.arange(115.0, 150.0) / line.sum()) == pytest.approx(130.5, abs=0.6)
    assert torch.equal(broaden_lines(broad, 0.05), broad)
    assert torch.equal(broaden_lines(torch.ones(3, 30, 40), 0.1), torch.ones(3, 30, 40))


def test_what_lines_enclose_is_filled_with_the_style_s_colors() -> None:
    bands = torch.tensor([[0.9, 0.9, 0.8], [0.9, 0.2, 0.1], [0.1, 0.1, 0.1]]).repeat_interleave(20, 0)
    style = bands.T[:, :, None].expand(-1, -1, 60)
    filled = color_drawing(broaden_lines(sheet(), 0.05), style)
    torch.testing.assert_close(filled[:, 5, 5], torch.tensor([0.9, 0.9, 0.8]), atol=0.05, rtol=0)
    torch.testing.assert_close(filled[:, 60, 131], torch.tensor([0.1, 0.1, 0.1]), atol=0.05, rtol=0)
    inside = filled[:, 60, 70]
    assert float(inside[0] - inside[2]) > 0.4, "the enclosed part is vivid"
