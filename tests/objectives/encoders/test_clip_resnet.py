"""CLIP's ResNet tower against a plain restatement in `torch.nn`, and the published shapes of RN50."""

from collections import OrderedDict

import pytest
import torch
from torch import nn

from frida_painter.errors import WeightsError
from frida_painter.objectives.encoders.convolutional import CLIP_MEAN, CLIP_SPREAD, ClipResNet
from tiny_clip import resnet_tensors


class Bottleneck(nn.Module):
    def __init__(self, before: int, inner: int, stride: int) -> None:
        super().__init__()
        self.conv1, self.bn1 = nn.Conv2d(before, inner, 1, bias=False), nn.BatchNorm2d(inner)
        self.conv2, self.bn2 = nn.Conv2d(inner, inner, 3, padding=1, bias=False), nn.BatchNorm2d(inner)
        self.conv3, self.bn3 = nn.Conv2d(inner, 4 * inner, 1, bias=False), nn.BatchNorm2d(4 * inner)
        self.pool = nn.AvgPool2d(stride)
        self.downsample = None
        if stride > 1 or before != 4 * inner:
            parts = {"-1": nn.AvgPool2d(stride), "0": nn.Conv2d(before, 4 * inner, 1, bias=False)}
            self.downsample = nn.Sequential(OrderedDict({**parts, "1": nn.BatchNorm2d(4 * inner)}))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        out = self.bn2(self.conv2(self.bn1(self.conv1(x)).relu())).relu()
        out = self.bn3(self.conv3(self.pool(out)))
        return (out + (x if self.downsample is None else self.downsample(x))).relu()


class AttentionPool(nn.Module):
    def __init__(self, cells: int, channels: int, out: int) -> None:
        super().__init__()
        self.positional_embedding = nn.Parameter(torch.zeros(cells + 1, channels))
        self.q_proj, self.k_proj, self.v_proj = (nn.Linear(channels, channels) for _ in range(3))
        self.c_proj = nn.Linear(channels, out)

    def forward(self, x: torch.Tensor, heads: int) -> torch.Tensor:
        tokens = x.flatten(2).permute(2, 0, 1)  # [cells, n, c]
        tokens = torch.cat([tokens.mean(0, keepdim=True), tokens]) + self.positional_embedding[:, None]
        q, k, v = self.q_proj(tokens[:1]), self.k_proj(tokens), self.v_proj(tokens)
        n, c = q.shape[1:]
        out = torch.empty(n, c)
        for head in range(heads):
            part = slice(head * c // heads, (head + 1) * c // heads)
            for one in range(n):
                score = (k[:, one, part] @ q[0, one, part]) / (c // heads) ** 0.5
                out[one, part] = score.softmax(0) @ v[:, one, part]
        return self.c_proj(out)


class Tower(nn.Module):
    """As the paper describes it: every layer a module of its own, nothing folded."""

    def __init__(self, width: int, depths: tuple[int, ...], side: int, out: int) -> None:
        super().__init__()
        half = width // 2
        self.conv1, self.bn1 = nn.Conv2d(3, half, 3, stride=2, padding=1, bias=False), nn.BatchNorm2d(half)
        self.conv2, self.bn2 = nn.Conv2d(half, half, 3, padding=1, bias=False), nn.BatchNorm2d(half)
        self.conv3, self.bn3 = nn.Conv2d(half, width, 3, padding=1, bias=False), nn.BatchNorm2d(width)
        before = width
        for number, depth in enumerate(depths, 1):
            inner = width * 2 ** (number - 1)
            blocks = []
            for block in range(depth):
                blocks.append(Bottleneck(before, inner, 2 if number > 1 and block == 0 else 1))
                before = 4 * inner
            setattr(self, f"layer{number}", nn.Sequential(*blocks))
        self.attnpool = AttentionPool((side // 32) ** 2, before, out)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        for number in (1, 2, 3):
            x = getattr(self, f"bn{number}")(getattr(self, f"conv{number}")(x)).relu()
        x = nn.functional.avg_pool2d(x, 2)
        for number in (1, 2, 3, 4):
            x = getattr(self, f"layer{number}")(x)
        return x


WIDTH, DEPTHS, SIDE = 16, (2, 1, 1, 1), 64


def restated() -> Tower:
    tower = Tower(WIDTH, DEPTHS, SIDE, 4 * WIDTH * 8 // 2).eval()
    tower.load_state_dict({name.removeprefix("visual."): tensor for name, tensor in resnet_tensors().items()})
    return tower


def test_it_is_the_network_of_the_paper() -> None:
    views = torch.rand(2, 3, SIDE, SIDE, generator=torch.Generator().manual_seed(1))
    network, plain = ClipResNet(resnet_tensors()), restated()
    normal = (views - torch.tensor(CLIP_MEAN)[:, None, None]) / torch.tensor(CLIP_SPREAD)[:, None, None]
    with torch.no_grad():
        last = plain(normal)
        torch.testing.assert_close(network.features(views)[1], last, rtol=1e-3, atol=1e-4)
        wanted = nn.functional.normalize(plain.attnpool(last, heads=4 * WIDTH * 8 // 64), dim=1)
        torch.testing.assert_close(network.embed_pictures(views), wanted, rtol=1e-3, atol=1e-4)


def test_features_are_a_sixteenth_and_a_thirty_second_and_slopes_reach_the_picture() -> None:
    views = torch.rand(2, 3, 96, 64, requires_grad=True)
    parts, last = ClipResNet(resnet_tensors()).features(views)
    assert parts.shape == (2, 4 * WIDTH * 4, 6, 4) and last.shape == (2, 4 * WIDTH * 8, 3, 2)
    (slope,) = torch.autograd.grad(last[1].sum(), views)
    assert float(slope[1].abs().sum()) > 0 and float(slope[0].abs().sum()) == 0


def test_the_published_shapes_of_rn50() -> None:
    """Radford et al. 2021, table of ResNet hyperparameters: RN50 embeds 224 pixels a side in 1024 numbers."""
    shapes = {name: tuple(tensor.shape) for name, tensor in resnet_tensors(64, (3, 4, 6, 3), 224).items()}
    published = {
        "visual.conv1.weight": (32, 3, 3, 3),
        "visual.conv3.weight": (64, 32, 3, 3),
        "visual.layer1.0.downsample.0.weight": (256, 64, 1, 1),
        "visual.layer1.2.conv3.weight": (256, 64, 1, 1),
        "visual.layer2.3.conv2.weight": (128, 128, 3, 3),
        "visual.layer3.5.conv1.weight": (256, 1024, 1, 1),
        "visual.layer4.0.conv1.weight": (512, 1024, 1, 1),
        "visual.layer4.0.downsample.0.weight": (2048, 1024, 1, 1),
        "visual.layer4.2.bn3.running_var": (2048,),
        "visual.attnpool.positional_embedding": (50, 2048),
        "visual.attnpool.q_proj.weight": (2048, 2048),
        "visual.attnpool.c_proj.weight": (1024, 2048),
    }
    assert published.items() <= shapes.items()
    network = ClipResNet(resnet_tensors(64, (3, 4, 6, 3), 224))
    with torch.no_grad():
        assert network.features(torch.rand(1, 3, 224, 224))[1].shape == (1, 2048, 7, 7)
        embedded = network.embed_pictures(torch.rand(1, 3, 200, 260))
    assert embedded.shape == (1, 1024) and float(embedded.norm()) == pytest.approx(1)


@pytest.mark.parametrize("missing", ["conv1.weight", "layer3.0.bn2.bias", "attnpool.q_proj.weight"])
def test_weights_of_another_network_are_refused(missing: str) -> None:
    tensors = {name: tensor for name, tensor in resnet_tensors().items() if name != f"visual.{missing}"}
    with pytest.raises(WeightsError, match=missing):
        ClipResNet(tensors)
    with pytest.raises(WeightsError, match="not CLIP's ResNet kind"):
        ClipResNet({**resnet_tensors(), "visual.attnpool.positional_embedding": torch.zeros(7, 512)})
