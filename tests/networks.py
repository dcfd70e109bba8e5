"""Small or random networks in place of those that are fetched."""

from collections.abc import Sequence
from functools import cache

import torch
from torch.nn.functional import avg_pool2d

from frida_painter.objectives.encoders.shelf import Choice, Encoders
from frida_painter.objectives.encoders.vgg import Vgg16


@cache
def random_vgg_tensors() -> dict[str, torch.Tensor]:
    """Tensors of the shapes and names of VGG16's convolutions, of random weights that keep signals alive."""
    chance = torch.Generator().manual_seed(0)
    sizes = [3, 64, 64, 128, 128, 256, 256, 256, 512, 512, 512, 512, 512, 512]
    tensors = {}
    for position, before, size in zip((0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28), sizes, sizes[1:], strict=False):
        tensors[f"features.{position}.weight"] = (
            torch.randn(size, before, 3, 3, generator=chance) * (2 / (9 * before)) ** 0.5
        )
        tensors[f"features.{position}.bias"] = torch.zeros(size)
    return tensors


class QuickVgg(Vgg16):
    """Random mixtures of colours, coarser from layer to layer, in place of convolutions."""

    def __init__(self) -> None:
        pass

    def features(self, picture: torch.Tensor, layers: Sequence[str]) -> list[torch.Tensor]:
        chance = torch.Generator().manual_seed(0)
        mixtures = [torch.randn(8, 3, generator=chance) for _ in layers]
        return [
            torch.einsum("oc,chw->ohw", mixture, avg_pool2d(picture, 4 + 2 * depth)).relu()
            for depth, mixture in enumerate(mixtures)
        ]


class QuickEncoders(Encoders):
    """Sees through random mixtures: enough for everything but judging what is seen."""

    def style(self) -> Vgg16:
        if not self.choices:
            self.choices.append(Choice("style", "random mixtures", "VGG16"))
        return QuickVgg()


class NoEncoders(Encoders):
    """Fails the test when any network is asked for."""

    def style(self) -> Vgg16:
        raise AssertionError("a network was asked for")
