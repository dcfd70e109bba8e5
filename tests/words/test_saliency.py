import pytest
import torch

from frida_painter.words.composition import saliency


@pytest.mark.parametrize(("top", "left"), [(20, 100), (100, 30)])
def test_what_is_unlike_the_edges_is_found(top: int, left: int) -> None:
    picture = torch.rand(3, 200, 220, generator=torch.Generator().manual_seed(2)) * 0.1
    picture[:, :100] += 0.8  # a sky
    picture[0, top : top + 60, left : left + 60] = 0.9
    picture[1:, top : top + 60, left : left + 60] = 0.1
    where = saliency(picture)
    assert where.shape == (200, 220) and float(where.min()) >= 0 and float(where.max()) <= 1
    assert float(where[top + 15 : top + 45, left + 15 : left + 45].min()) > 0.8
    assert float(where.mean()) < 0.3


def test_of_a_picture_that_is_alike_everywhere_all_counts() -> None:
    assert float(saliency(torch.full((3, 40, 30), 0.5)).min()) == 1
