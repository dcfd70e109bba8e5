import pytest
import torch
from torch.nn import functional

from downloads import fetched
from frida_painter.errors import WeightsError
from frida_painter.objectives.encoders.convolutional import Vgg16
from frida_painter.objectives.encoders.loading import EncoderRegistry
from support.networks import random_vgg_tensors


def test_layers_are_what_the_convolutions_make_one_after_the_other() -> None:
    tensors = random_vgg_tensors()
    picture = torch.rand(3, 21, 30, generator=torch.Generator().manual_seed(1))
    low, high = Vgg16.of_torchvision(tensors).features(picture, ["conv1_2", "conv2_1"])
    x = (picture - torch.tensor([0.485, 0.456, 0.406])[:, None, None]) / torch.tensor([0.229, 0.224, 0.225])[
        :, None, None
    ]
    for position in (0, 2):
        x = functional.conv2d(x, tensors[f"features.{position}.weight"], padding=1).clamp(min=0)
    torch.testing.assert_close(low, x)
    assert high.shape == (128, 11, 15), "an odd row keeps its place when the picture is halved"


def test_the_trunk_of_the_edge_detector_sees_blue_green_red() -> None:
    tensors = random_vgg_tensors()
    picture = torch.rand(3, 8, 8, generator=torch.Generator().manual_seed(2))
    (seen,) = Vgg16.of_hed(tensors).features(picture, ["conv1_1"])
    mean = torch.tensor([103.939, 116.779, 123.68])[:, None, None]
    wanted = functional.conv2d(255 * picture.flip(0) - mean, tensors["features.0.weight"], padding=1).clamp(min=0)
    torch.testing.assert_close(seen, wanted, rtol=1e-4, atol=1e-2)


def test_layers_come_in_the_order_asked_and_unknown_ones_are_refused() -> None:
    vgg = Vgg16.of_torchvision(random_vgg_tensors())
    picture = torch.rand(3, 16, 16)
    two, one = vgg.features(picture, ["conv2_1", "conv1_1"])
    assert two.shape[0] == 128 and one.shape[0] == 64
    with pytest.raises(ValueError, match="conv6_1"):
        vgg.features(picture, ["conv6_1"])


def test_weights_of_another_network_are_refused() -> None:
    tensors = dict(random_vgg_tensors())
    with pytest.raises(WeightsError, match="not those of VGG16"):
        Vgg16.of_torchvision({**tensors, "features.5.weight": torch.zeros(7, 64, 3, 3)})
    del tensors["features.10.bias"]
    with pytest.raises(WeightsError, match=r"features\.10"):
        Vgg16.of_torchvision(tensors)


def test_without_weights_the_sentence_says_how_to_get_them(tmp_path: pytest.TempPathFactory) -> None:
    with pytest.raises(WeightsError, match="frida-painter models fetch hed"):
        EncoderRegistry(tmp_path).style()


def test_textures_are_told_apart() -> None:
    """Halves of one photograph are nearer to each other in style than to another texture."""
    from frida_painter.objectives.style import Style
    from support import data

    fetched("hed")
    textures = {name: data.grey(name) for name in ("tissue", "galaxies", "coins")}
    encoders = EncoderRegistry()
    vgg = encoders.style()
    assert encoders.choices[0].purpose == "style"
    for name, texture in textures.items():
        style = Style(texture[:, :, :256], vgg, 0)
        with torch.no_grad():
            distances = {other: float(style(textures[other][:, :, 256:])) for other in textures}
        assert min(distances, key=distances.__getitem__) == name
