import torch

from frida_painter.objectives.compositing import lay, resized, side_by_side


def test_a_drawing_is_laid_large_in_the_middle_without_a_dark_seam() -> None:
    drawing = torch.zeros(4, 40, 20)
    drawing[:, :, 5:15] = 1.0
    laid = lay(drawing, torch.ones(3, 50, 100))
    assert torch.allclose(laid, torch.ones(3, 50, 100), atol=1e-5), "white on white stays white along the edge"
    laid = lay(_black(40, 20), torch.ones(3, 50, 100))
    rows, columns = (laid[0] < 0.5).any(1).sum(), (laid[0] < 0.5).any(0).sum()
    assert (int(rows), int(columns)) == (42, 21), "0.85 of the shorter side"


def test_what_is_raised_is_smaller_and_higher_and_what_is_wide_fills_the_longer_side() -> None:
    ground = torch.ones(3, 50, 100)
    raised = (lay(_black(20, 20), ground, raised=True)[0] < 0.5).any(1).nonzero().flatten()
    assert len(raised) == 28 and float(raised.float().mean()) < 20
    wide = lay(_black(20, 60), ground, wide=True)
    assert int((wide[0] < 0.5).any(0).sum()) == 85


def test_several_stand_on_one_floor_and_copies_differ_in_size_and_look_at_each_other() -> None:
    drawing = _black(40, 40)
    drawing[0, :, :20] = 1.0  # red on the left
    together = side_by_side([drawing, drawing])
    assert bool((together[3, -1] > 0.5).all())
    top = (together[3] > 0.5).int().argmax(0)
    assert int(top[5]) == 0 and 45 <= int(top[-5]) <= 55
    red = together[0, -5] > 0.5
    assert bool(red[5]) and not bool(red[200]) and not bool(red[260]) and bool(red[-5])


def test_narrowed_drawings_keep_their_height() -> None:
    assert resized(_black(40, 20), 1.0, 0.6).shape == (4, 40, 12)


def _black(rows: int, columns: int) -> torch.Tensor:
    return torch.cat((torch.zeros(3, rows, columns), torch.ones(1, rows, columns)))
