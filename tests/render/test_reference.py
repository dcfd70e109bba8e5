"""The oracle itself, against what can be worked out by hand."""

import torch

from frida_painter.render.reference import bilinear, composite

F64 = torch.float64


def test_a_full_mark_on_whole_pixels_replaces_the_canvas_by_its_color() -> None:
    magnitude = torch.ones(1, 2, 3, dtype=F64)
    affine = torch.tensor([[[1.0, 0.0, -4.0], [0.0, 1.0, -1.0]]], dtype=F64)
    color = torch.tensor([[0.1, 0.5, 0.9]], dtype=F64)
    canvas = torch.ones(3, 5, 8, dtype=F64)
    picture = composite(magnitude, affine, color, canvas)
    expected = canvas.clone()
    expected[:, 1:3, 4:7] = color[0, :, None, None]
    torch.testing.assert_close(picture, expected)


def test_coverage_mixes_and_later_strokes_lie_on_top() -> None:
    magnitude = torch.full((2, 1, 1), 0.5, dtype=F64)
    affine = torch.tensor([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]], dtype=F64).expand(2, 2, 3)
    color = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], dtype=F64)
    picture = composite(magnitude, affine, color, torch.zeros(3, 1, 1, dtype=F64))
    assert picture.flatten().tolist() == [0.25, 0.0, 0.5]


def test_samples_between_cells_and_beyond_the_rim_are_bilinear() -> None:
    mark = torch.tensor([[1.0, 2.0], [3.0, 5.0]], dtype=F64)
    column = torch.tensor([0.5, 0.25, -0.5, 1.75, -1.0, 2.0], dtype=F64)
    row = torch.tensor([0.5, 0.0, 0.0, 1.0, 0.0, 0.0], dtype=F64)
    assert bilinear(mark, column, row).tolist() == [2.75, 1.25, 0.5, 1.25, 0.0, 0.0]
