from collections.abc import Iterator

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from composites import scene, with_gradients
from frida_painter.render import scanline
from frida_painter.render.kernels import Spans, find_spans, painted_boxes, whole_maps


def pixels_of(spans: Spans, stroke: int, height: int, width: int) -> np.ndarray:
    covered = np.zeros((height, width), bool)
    for y in range(spans.top[stroke], spans.bottom[stroke]):
        k = spans.segment[stroke] + y - spans.top[stroke]
        covered[y, spans.first[k] : spans.first[k] + spans.offset[k + 1] - spans.offset[k]] = True
    return covered


def touched(affine: np.ndarray, box: np.ndarray, height: int, width: int) -> np.ndarray:
    x = np.arange(width, dtype=affine.dtype)
    y = np.arange(height, dtype=affine.dtype)[:, None]
    column = affine[0, 0] * x + affine[0, 1] * y + affine[0, 2]
    row = affine[1, 0] * x + affine[1, 1] * y + affine[1, 2]
    top, bottom, left, right = box
    return (row >= top - 1) & (row < bottom) & (column >= left - 1) & (column < right)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@given(
    cells=st.tuples(st.integers(1, 9), st.integers(1, 9)),
    pixels=st.tuples(st.integers(1, 30), st.integers(1, 30)),
    scale=st.sampled_from((1e-4, 0.05, 1.0, 20.0)),
    seed=st.integers(0, 2**31),
)
def test_spans_are_exactly_the_pixels_that_touch(
    dtype: torch.dtype, cells: tuple[int, int], pixels: tuple[int, int], scale: float, seed: int
) -> None:
    tensors = scene(8, cells, pixels, seed, scale=scale, dtype=dtype)
    affine, magnitude = tensors.affine.numpy(), tensors.magnitude.numpy()
    for boxes in (whole_maps(magnitude), painted_boxes(magnitude)):
        spans = find_spans(affine, boxes, *pixels)
        for i, box in enumerate(boxes):
            wanted = touched(affine[i], box, *pixels) if box[1] > box[0] else np.zeros(pixels, bool)
            assert np.array_equal(pixels_of(spans, i, *pixels), wanted)


def test_the_border_of_a_map_on_whole_pixels_counts_on_one_side_only() -> None:
    affine = np.array([[[1.0, 0.0, -4.0], [0.0, 1.0, -5.0]]])
    spans = find_spans(affine, np.array([[0, 3, 0, 2]]), 12, 12)
    covered = pixels_of(spans, 0, 12, 12)
    assert covered[4:8, 3:6].all()
    assert covered.sum() == 4 * 3


@pytest.mark.parametrize("entry", [np.nan, np.inf, -np.inf])
def test_a_place_that_is_not_finite_covers_nothing(entry: float) -> None:
    affine = np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, entry]]])
    assert find_spans(affine, np.array([[0, 3, 0, 2]]), 5, 5).pixels == 0


def test_painted_boxes_hold_every_cell_that_is_not_zero() -> None:
    magnitude = np.zeros((4, 6, 7), np.float32)
    magnitude[0, 2, 3] = 0.5
    magnitude[1, 1, 5] = magnitude[1, 4, 2] = -1e-30
    magnitude[3, 5, 6] = np.nan
    assert painted_boxes(magnitude).tolist() == [[2, 3, 3, 4], [1, 5, 2, 6], [0, 0, 0, 0], [5, 6, 6, 7]]


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
