from itertools import pairwise

import pytest
import torch
from torch.nn import functional

from downloads import fetched
from frida_painter import weights
from frida_painter.errors import WeightsError
from frida_painter.objectives.encoders.convolutional import EfficientNetLite
from support.networks import random_lite_tensors


def test_the_folded_stem_is_the_convolution_and_its_normalisation() -> None:
    """A network whose later parts are seen through: the first stage's block sees relu6(norm(conv(x)))."""
    tensors = random_lite_tensors()
    views = torch.rand(1, 3, 32, 32, generator=torch.Generator().manual_seed(1))
    padded = functional.pad((views * 255 - 127) / 128, (0, 1, 0, 1))
    plain = functional.conv2d(padded, tensors["_conv_stem.weight"], stride=2)
    norm = [tensors[f"_bn0.{name}"] for name in ("running_mean", "running_var", "weight", "bias")]
    wanted = functional.batch_norm(plain, *norm, eps=1e-3).clamp(0, 6)
    torch.testing.assert_close(
        functional.relu6(EfficientNetLite(tensors)._stem((views - 127 / 255) / (128 / 255))), wanted
    )


@pytest.mark.parametrize(("rows", "columns"), [(64, 64), (50, 75)])
def test_features_are_a_sixteenth_and_a_thirty_second(rows: int, columns: int) -> None:
    parts, last = EfficientNetLite(random_lite_tensors()).features(torch.rand(2, 3, rows, columns))
    assert parts.shape == (2, 8, -(-rows // 16), -(-columns // 16))
    assert last.shape == (2, 16, -(-rows // 32), -(-columns // 32))


def test_each_view_is_seen_for_itself_and_slopes_reach_it() -> None:
    network = EfficientNetLite(random_lite_tensors())
    views = torch.rand(3, 3, 48, 48, requires_grad=True)
    logits = network.logits(views)
    torch.testing.assert_close(logits[1:2], network.logits(views[1:2]), rtol=1e-4, atol=1e-5)
    (slope,) = torch.autograd.grad(logits[1].sum(), views)
    assert float(slope[1].abs().sum()) > 0 and float(slope[[0, 2]].abs().sum()) == 0


@pytest.mark.parametrize("missing", ["_conv_stem.weight", "_bn1.bias", "_fc.weight", "_blocks.2._bn1.bias"])
def test_weights_of_another_network_are_refused(missing: str) -> None:
    tensors = {name: tensor for name, tensor in random_lite_tensors().items() if name != missing}
    with pytest.raises(WeightsError, match=missing):
        EfficientNetLite(tensors)


def test_too_few_stages_are_refused() -> None:
    tensors = {name: tensor for name, tensor in random_lite_tensors().items() if not name.startswith("_blocks.7")}
    with pytest.raises(WeightsError, match="6 stages"):
        EfficientNetLite(tensors)


@pytest.mark.parametrize(("variant", "side"), [(0, 224), (1, 240), (2, 260)])
def test_published_weights_recognise_photographs(variant: int, side: int) -> None:
    name = f"efficientnet-lite{variant}"
    fetched(name)
    from frida_painter import images
    from support import data

    espresso, cats = 967, range(281, 286)
    network = EfficientNetLite(weights.tensors(name))
    with torch.no_grad():
        seen = [
            int(network.logits(images.fit(images.from_uint8(picture), side, side)[None]).argmax())
            for picture in (data.coffee(), data.cat())
        ]
    assert seen[0] == espresso and seen[1] in cats


def test_the_random_network_is_wide_awake() -> None:
    """Its stages differ in channels, so that each is told from the next."""
    found = [len(tensor) for name, tensor in random_lite_tensors().items() if name.endswith("project_conv.weight")]
    assert sum(one != other for one, other in pairwise(found)) == 6
