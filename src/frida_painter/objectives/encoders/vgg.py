"""VGG16's convolutions, whose layers describe style (Simonyan and Zisserman 2014), and the edge detector HED."""

from collections.abc import Mapping, Sequence
from typing import Self

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.devices import Constant, half_precision
from frida_painter.errors import WeightsError

_BLOCKS = (2, 2, 3, 3, 3)  # convolutions in each block; the picture is halved between blocks
_NAMES = tuple(f"conv{block}_{layer}" for block, count in enumerate(_BLOCKS, 1) for layer in range(1, count + 1))
_IMAGENET_MEAN, _IMAGENET_SPREAD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
_CAFFE_MEAN, _CAFFE_SPREAD = (123.68 / 255, 116.779 / 255, 103.939 / 255), (1 / 255,) * 3
_POSITIONS = (0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28)


class Vgg16:
    """The thirteen convolutions of VGG16 with frozen weights.

    convolutions: weight [out, in, 3, 3] and bias [out] of each
    mean, spread: statistics of the sRGB channels in training
    Raises WeightsError if the shapes are not those of VGG16.
    """

    def __init__(
        self, convolutions: Sequence[tuple[Tensor, Tensor]], mean: tuple[float, ...], spread: tuple[float, ...]
    ) -> None:
        sizes = [64] * 2 + [128] * 2 + [256] * 3 + [512] * 6
        expected = [(size, before, 3, 3) for before, size in zip([3, *sizes], sizes, strict=False)]
        if [tuple(weight.shape) for weight, _ in convolutions] != expected:
            raise WeightsError("The convolutions given are not those of VGG16; fetch its weights again.")
        self._convolutions = [(weight.detach(), bias.detach()) for weight, bias in convolutions]
        self._mean = Constant(torch.tensor(mean)[:, None, None])
        self._spread = Constant(torch.tensor(spread)[:, None, None])

    @classmethod
    def of_hed(cls, tensors: Mapping[str, Tensor]) -> Self:
        """Returns the trunk of a HED network, which was trained on blue, green, red minus their means."""
        (first, bias), *others = _trunk(tensors)
        return cls([(first.flip(1), bias), *others], _CAFFE_MEAN, _CAFFE_SPREAD)

    @classmethod
    def of_torchvision(cls, tensors: Mapping[str, Tensor]) -> Self:
        """Returns the trunk of torchvision's ImageNet classifier."""
        return cls(_trunk(tensors), _IMAGENET_MEAN, _IMAGENET_SPREAD)

    def features(self, picture: Tensor, layers: Sequence[str]) -> list[Tensor]:
        """Returns feature maps [c, h, w], after the rectifier, of layers like "conv3_3", for sRGB [3, H, W] in [0, 1].

        Stops at the last of these layers. Raises ValueError if a layer is unknown.
        """
        unknown = set(layers) - set(_NAMES)
        if unknown:
            raise ValueError(f"{sorted(unknown)} are no layers; there are {', '.join(_NAMES)}")
        found: dict[str, Tensor] = {}
        x = ((picture - self._mean.like(picture)) / self._spread.like(picture))[None]
        with half_precision(picture.device):
            for name, (weight, bias) in zip(_NAMES, self._convolutions, strict=True):
                if name.endswith("_1") and name != _NAMES[0]:
                    x = functional.max_pool2d(x, 2, ceil_mode=True)
                x = functional.relu(functional.conv2d(x, weight.to(x), bias.to(x), padding=1))
                if name in layers:
                    found[name] = x[0].to(picture)
                if len(found) == len(set(layers)):
                    break
        return [found[name] for name in layers]


def _trunk(tensors: Mapping[str, Tensor]) -> list[tuple[Tensor, Tensor]]:
    """Returns the convolutions, by their names in torchvision."""
    return [_layer(tensors, f"features.{position}") for position in _POSITIONS]


def _layer(tensors: Mapping[str, Tensor], name: str) -> tuple[Tensor, Tensor]:
    """Returns weight and bias of one convolution."""
    try:
        return tensors[f"{name}.weight"], tensors[f"{name}.bias"]
    except KeyError as cause:
        raise WeightsError(f"The weights hold no {name!r}, so they are not VGG16's; fetch them again.") from cause


# HED: probable edges in a picture, as a person would draw them (Xie and Tu 2015)
#
# A side output reads each of VGG16's five blocks, from fine to coarse. A weighted sum combines them.

_SEEN = ("conv1_2", "conv2_2", "conv3_3", "conv4_3", "conv5_3")
_SIDES = tuple(f"dsn{number}" for number in range(1, 6))


class Hed:
    """Edge detector HED with frozen weights from the tensors of the weights `hed`. Raises WeightsError."""

    def __init__(self, tensors: Mapping[str, Tensor]) -> None:
        self._trunk = Vgg16.of_hed(tensors)
        try:
            self._sides = [(tensors[f"{side}.weight"], tensors[f"{side}.bias"]) for side in _SIDES]
            self._fuse = tensors["fuse.weight"], tensors["fuse.bias"]
        except KeyError as cause:
            raise WeightsError(
                f"The weights hold no {cause.args[0]!r}, so they are not HED's; fetch them again."
            ) from cause

    def edges(self, picture: Tensor) -> Tensor:
        """Returns the edge probability of each pixel of sRGB [3, H, W] in [0, 1]: [H, W] in [0, 1]. Differentiable."""
        size = list(picture.shape[1:])
        sides = []
        for seen, (weight, bias) in zip(self._trunk.features(picture, _SEEN), self._sides, strict=True):
            side = functional.conv2d(seen[None], weight.to(seen), bias.to(seen))
            sides.append(functional.interpolate(side, size, mode="bilinear", align_corners=False))
        weight, bias = self._fuse
        fused = functional.conv2d(torch.cat(sides, 1), weight.to(picture), bias.to(picture))
        return torch.sigmoid(fused)[0, 0]
