import pytest
import torch
from torch import Tensor

from frida_painter.words.composition import saliency


@pytest.mark.parametrize(("top", "left"), [(20, 100), (200, 30)])
def test_what_the_words_are_seen_in_is_found(top: int, left: int) -> None:
    picture = torch.rand(3, 300, 220, generator=torch.Generator().manual_seed(2))

    def distance(seen: Tensor) -> Tensor:
        rows, columns = seen.shape[1:]
        near = seen[
            :, top * rows // 300 : (top + 60) * rows // 300, left * columns // 220 : (left + 60) * columns // 220
        ]
        return 1 - near.square().mean()

    where = saliency(picture, distance, 0)
    assert where.shape == (300, 220) and float(where.min()) >= 0 and float(where.max()) <= 1
    assert float(where[top + 15 : top + 45, left + 15 : left + 45].min()) > 0.8
    assert float(where.mean()) < 0.3
    with torch.no_grad():
        assert torch.equal(where, saliency(picture, distance, 0))


def test_where_nothing_changes_anything_everything_counts() -> None:
    where = saliency(torch.full((3, 40, 30), 0.5), lambda seen: 0 * seen.sum(), 0)
    assert float(where.min()) == 1
