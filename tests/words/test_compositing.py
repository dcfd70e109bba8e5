import torch

from frida_painter.words.compositing import lay


def test_a_drawing_is_laid_large_in_the_middle_without_a_dark_seam() -> None:
    drawing = torch.zeros(4, 40, 20)
    drawing[:, :, 5:15] = 1.0
    laid = lay(drawing, torch.ones(3, 50, 100))
    assert torch.allclose(laid, torch.ones(3, 50, 100), atol=1e-5), "white on white stays white along the edge"
    laid = lay(_black(40, 20), torch.ones(3, 50, 100))
    rows, columns = (laid[0] < 0.5).any(1).sum(), (laid[0] < 0.5).any(0).sum()
    assert (int(rows), int(columns)) == (42, 21), "0.85 of the shorter side"


def _black(rows: int, columns: int) -> torch.Tensor:
    return torch.cat((torch.zeros(3, rows, columns), torch.ones(1, rows, columns)))
