import pytest
import torch

from downloads import fetched
from frida_painter import images, weights
from frida_painter.errors import WeightsError
from frida_painter.objectives.encoders.convolutional import Hed
from support.networks import random_hed_tensors


def test_edges_are_the_weighted_sum_of_the_sides() -> None:
    """With every side blind but one, and the fusion a factor, the edges are that side's own answer."""
    tensors = dict(random_hed_tensors())
    for side in range(2, 6):
        tensors[f"dsn{side}.weight"] = torch.zeros_like(tensors[f"dsn{side}.weight"])
        tensors[f"dsn{side}.bias"] = torch.zeros(1)
    tensors["dsn1.weight"] = torch.zeros(1, 64, 1, 1)
    tensors["dsn1.bias"] = torch.tensor([0.7])
    tensors["fuse.weight"] = torch.tensor([2.0, 1.0, 1.0, 1.0, 1.0]).reshape(1, 5, 1, 1)
    tensors["fuse.bias"] = torch.tensor([-0.4])
    edges = Hed(tensors).edges(torch.rand(3, 33, 20))
    torch.testing.assert_close(edges, torch.full((33, 20), 1.0).sigmoid().fill_(torch.tensor(1.0).sigmoid()))


def test_slopes_reach_the_picture() -> None:
    picture = torch.rand(3, 32, 32, requires_grad=True)
    (slope,) = torch.autograd.grad(Hed(random_hed_tensors()).edges(picture).sum(), picture)
    assert bool(torch.isfinite(slope).all()) and float(slope.abs().sum()) > 0


@pytest.mark.parametrize("missing", ["dsn3.weight", "fuse.bias"])
def test_weights_of_another_network_are_refused(missing: str) -> None:
    tensors = {name: tensor for name, tensor in random_hed_tensors().items() if name != missing}
    with pytest.raises(WeightsError, match=missing):
        Hed(tensors)


def test_published_weights_find_the_rim_of_a_cup() -> None:
    from support import data

    fetched("hed")
    picture = images.fit(images.from_uint8(data.coffee()), 120, 180)
    with torch.no_grad():
        edges = Hed(weights.tensors("hed")).edges(picture)
    assert float(edges.max()) > 0.9 and float(edges.mean()) < 0.3, "few pixels are edges, and some of those are certain"
    assert float(edges[90:, 165:].mean()) < 0.15, "the plain table beside the saucer has none"
