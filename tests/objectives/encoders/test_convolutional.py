import pytest
import torch
from torch.nn import functional

from downloads import fetched
from frida_painter.errors import WeightsError
from frida_painter.objectives import weights
from frida_painter.objectives.encoders.convolutional import EfficientNetLite, Hed, Vgg16
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.system import images
from support.networks import random_hed_tensors, random_lite_tensors, random_vgg_tensors


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


@pytest.mark.parametrize(
    ("network", "tensors", "missing"),
    [
        (Vgg16.of_torchvision, random_vgg_tensors, "features.10.bias"),
        *((Hed, random_hed_tensors, missing) for missing in ("dsn3.weight", "fuse.bias")),
        *((EfficientNetLite, random_lite_tensors, missing) for missing in ("_conv_stem.weight", "_bn1.bias",
                                                                           "_fc.weight", "_blocks.2._bn1.bias")),
    ],
)  # fmt: skip
def test_weights_of_another_network_are_refused(network, tensors, missing: str) -> None:
    with pytest.raises(WeightsError, match=missing.removesuffix(".bias")):
        network({name: tensor for name, tensor in tensors().items() if name != missing})
    with pytest.raises(WeightsError, match="not those of VGG16"):
        Vgg16.of_torchvision({**random_vgg_tensors(), "features.5.weight": torch.zeros(7, 64, 3, 3)})


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


def test_published_weights_find_the_rim_of_a_cup() -> None:
    from support import data

    fetched("hed")
    picture = images.fit(images.from_uint8(data.coffee()), 120, 180)
    with torch.no_grad():
        edges = Hed(weights.tensors("hed")).edges(picture)
    assert float(edges.max()) > 0.9 and float(edges.mean()) < 0.3, "few pixels are edges, and some of those are certain"
    assert float(edges[90:, 165:].mean()) < 0.15, "the plain table beside the saucer has none"


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


@pytest.mark.parametrize(("variant", "side"), [(0, 224), (1, 240), (2, 260)])
def test_published_weights_recognise_photographs(variant: int, side: int) -> None:
    name = f"efficientnet-lite{variant}"
    fetched(name)
    from frida_painter.system import images
    from support import data

    espresso, cats = 967, range(281, 286)
    network = EfficientNetLite(weights.tensors(name))
    with torch.no_grad():
        seen = [
            int(network.logits(images.fit(images.from_uint8(picture), side, side)[None]).argmax())
            for picture in (data.coffee(), data.cat())
        ]
    assert seen[0] == espresso and seen[1] in cats
