import torch
from torch import Tensor

from frida_painter.drawing.composition import simplify


def roughness(picture: Tensor) -> float:
    return float(picture.diff(dim=1).abs().mean() + picture.diff(dim=2).abs().mean())


def test_texture_goes_and_edges_stay() -> None:
    flat = torch.full((3, 96, 120), 0.2)
    flat[:, :, 60:] = torch.tensor([0.9, 0.6, 0.1])[:, None, None]
    textured = (flat + 0.04 * torch.randn(3, 96, 120, generator=torch.Generator().manual_seed(0))).clamp(0, 1)
    simple = simplify(textured)
    assert simple.shape == flat.shape and roughness(simple) < 0.35 * roughness(textured)
    assert float((simple - flat).abs().mean()) < 0.02
    edge = (simple[:, :, 60] - simple[:, :, 59]).mean(1)
    assert torch.allclose(edge, flat[:, 0, 60] - flat[:, 0, 59], atol=0.02)


def test_what_is_flat_stays() -> None:
    flat = torch.zeros(3, 64, 64)
    flat[0, 16:48, 16:48] = 1
    assert torch.allclose(simplify(flat), flat, atol=1 / 255)
