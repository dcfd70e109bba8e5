import pytest
import torch

from composites import scene, with_gradients
from frida_painter.render import plain


def test_batches_of_strokes_leave_the_result_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    tensors = scene(40, (12, 20), (60, 50))
    whole = with_gradients(plain.composite, tensors)
    monkeypatch.setattr(plain, "BATCH_PIXELS", 300)
    for one, other in zip(whole, with_gradients(plain.composite, tensors), strict=True):
        torch.testing.assert_close(one, other, rtol=1e-12, atol=1e-12)
