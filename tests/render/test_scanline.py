from collections.abc import Iterator

import pytest
import torch

from composites import scene, with_gradients
from frida_painter.render import scanline


@pytest.fixture
def threads() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


@pytest.mark.usefixtures("threads")
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("strokes", [1, 150])
def test_any_number_of_threads_computes_the_same_bits(dtype: torch.dtype, strokes: int) -> None:
    tensors = scene(strokes, (12, 20), (70, 90), dtype=dtype)
    results = []
    for count in (1, 2, 5):
        torch.set_num_threads(count)
        results.append(with_gradients(scanline.composite, tensors))
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(results[0], other, strict=True))


def test_batches_of_strokes_leave_the_bits_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    tensors = scene(40, (12, 20), (60, 50))
    whole = with_gradients(scanline.composite, tensors)
    monkeypatch.setattr(scanline, "_BATCH", 300)
    in_parts = with_gradients(scanline.composite, tensors)
    assert all(torch.equal(a, b) for a, b in zip(whole, in_parts, strict=True))
    with torch.no_grad():
        assert torch.equal(scanline.composite(*tensors), whole[0])


def test_a_canvas_of_another_precision_decides() -> None:
    tensors = scene(4, (5, 5), (9, 9))
    picture = scanline.composite(*(tensor.float() for tensor in tensors[:3]), tensors.canvas)
    assert picture.dtype == torch.float64
