"""Convolutional networks with frozen weights: VGG16, HED and EfficientNet-Lite."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Self

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.errors import WeightsError
from frida_painter.system.devices import Constant, half_precision


class _Weights(dict[str, Tensor]):
    """Tensors by name. Raises WeightsError for a missing one: then they are not those of `network`."""

    def __init__(self, tensors: Mapping[str, Tensor], network: str) -> None:
        super().__init__(tensors)
        self._network = network

    def __missing__(self, name: str) -> Tensor:
        raise WeightsError(f"The weights hold no {name!r}, so they are not {self._network}; fetch them again.")

    def pair(self, name: str) -> tuple[Tensor, Tensor]:
        """Returns weight and bias of a layer."""
        return self[f"{name}.weight"], self[f"{name}.bias"]


# VGG16, whose layers describe style (Simonyan and Zisserman 2014)

_BLOCKS = (2, 2, 3, 3, 3)  # convolutions in each block; the picture is halved between blocks
_NAMES = tuple(f"conv{block}_{layer}" for block, count in enumerate(_BLOCKS, 1) for layer in range(1, count + 1))
_IMAGENET_MEAN, _IMAGENET_SPREAD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
_CAFFE_MEAN, _CAFFE_SPREAD = (123.68 / 255, 116.779 / 255, 103.939 / 255), (1 / 255,) * 3
_POSITIONS = (0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28)


class Vgg16:
    """The thirteen convolutions of VGG16.

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
        self._mean, self._spread = (Constant(torch.tensor(part)[:, None, None]) for part in (mean, spread))

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
    weights = _Weights(tensors, "VGG16's")
    return [weights.pair(f"features.{position}") for position in _POSITIONS]


_SEEN = ("conv1_2", "conv2_2", "conv3_3", "conv4_3", "conv5_3")


class Hed:
    """Edge detector HED: probable edges in a picture, as a person would draw them (Xie and Tu 2015).

    A side output reads each of VGG16's five blocks, from fine to coarse. A weighted sum combines them. Raises
    WeightsError if the tensors are not those of the weights `hed`.
    """

    def __init__(self, tensors: Mapping[str, Tensor]) -> None:
        self._trunk, weights = Vgg16.of_hed(tensors), _Weights(tensors, "HED's")
        self._sides = [weights.pair(f"dsn{number}") for number in range(1, 6)]
        self._fuse = weights.pair("fuse")

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


# EfficientNet-Lite, whose batch normalisations are folded into the convolutions: that halves the work


@dataclass(frozen=True)
class _Convolution:
    """Convolution with folded normalisation: weight [out, in / groups, k, k], bias [out].

    As in TensorFlow, an odd row and column of padding come last, so the last step reaches the edge.
    """

    weight: Tensor
    bias: Tensor
    stride: int

    @classmethod
    def fold(cls, weights: _Weights, convolution: str, norm: str, stride: int = 1) -> Self:
        scale = weights[f"{norm}.weight"] * torch.rsqrt(weights[f"{norm}.running_var"] + 1e-3)
        bias = weights[f"{norm}.bias"] - weights[f"{norm}.running_mean"] * scale
        return cls(weights[f"{convolution}.weight"] * scale[:, None, None, None], bias, stride)

    def __call__(self, x: Tensor) -> Tensor:
        kernel, padding = self.weight.shape[-1], self.weight.shape[-1] // 2
        groups = x.shape[1] // self.weight.shape[1]
        if self.stride > 1:
            rows, columns = (max(0, (-(-n // self.stride) - 1) * self.stride + kernel - n) for n in x.shape[-2:])
            x = functional.pad(x, (columns // 2, columns - columns // 2, rows // 2, rows - rows // 2))
            padding = 0
        weight, bias = self.weight.to(x), self.bias.to(x)
        return functional.conv2d(x, weight, bias, stride=self.stride, padding=padding, groups=groups)


_STRIDES = (1, 2, 2, 2, 1, 2, 1)  # stride of the first block in each of the seven stages
_LITE_MEAN, _LITE_SPREAD = 127 / 255, 128 / 255


@dataclass(frozen=True)
class _InvertedResidual:
    """Inverted residual block: expand, depthwise convolution, project; with a skip connection if shapes match."""

    expand: _Convolution | None
    depthwise: _Convolution
    project: _Convolution

    def __call__(self, x: Tensor) -> Tensor:
        inner = x if self.expand is None else functional.relu6(self.expand(x))
        out = self.project(functional.relu6(self.depthwise(inner)))
        return out + x if out.shape == x.shape else out


class EfficientNetLite:
    """EfficientNet-Lite 0, 1 or 2, a classifier with a thousand classes, from the tensors of its state dict.

    Tan and Le 2019; the Lite variants are Google's. Raises WeightsError if the tensors do not fit.
    """

    def __init__(self, tensors: Mapping[str, Tensor]) -> None:
        weights = _Weights(tensors, "EfficientNet-Lite's")
        fold = partial(_Convolution.fold, weights)
        self._stem, self._head = fold("_conv_stem", "_bn0", 2), fold("_conv_head", "_bn1")
        self._classes = weights.pair("_fc")
        self._stages: list[list[_InvertedResidual]] = []
        channels = number = 0
        while f"_blocks.{number}._project_conv.weight" in weights:
            name = f"_blocks.{number}"
            project, stride = fold(f"{name}._project_conv", f"{name}._bn2"), 1
            if len(project.bias) != channels:  # a stage begins at each change of the number of channels
                channels, stride = len(project.bias), _STRIDES[min(len(self._stages), len(_STRIDES) - 1)]
                self._stages.append([])
            widens = f"{name}._expand_conv.weight" in weights
            expand = fold(f"{name}._expand_conv", f"{name}._bn0") if widens else None
            depthwise = fold(f"{name}._depthwise_conv", f"{name}._bn1", stride)
            self._stages[-1].append(_InvertedResidual(expand, depthwise, project))
            number += 1
        if len(self._stages) != len(_STRIDES):
            raise WeightsError(f"The weights have {len(self._stages)} stages; EfficientNet-Lite has {len(_STRIDES)}.")

    def features(self, views: Tensor) -> tuple[Tensor, Tensor]:
        """Returns two feature maps of views [n, 3, h, w], sRGB in [0, 1], before pooling.

        The first is that of stage five, [n, c, h / 16, w / 16]: parts of objects. The second is that of the
        last layer, [n, 1280, h / 32, w / 32].
        """
        with half_precision(views.device):
            x = functional.relu6(self._stem((views - _LITE_MEAN) / _LITE_SPREAD))
            parts = x
            for number, stage in enumerate(self._stages, 1):
                for block in stage:
                    x = block(x)
                if number == 5:
                    parts = x
            return parts.to(views), functional.relu6(self._head(x)).to(views)

    def logits(self, views: Tensor) -> Tensor:
        """Returns logits [n, 1000] of ImageNet's classes for views [n, 3, h, w], sRGB in [0, 1]."""
        deepest = self.features(views)[1]
        weight, bias = self._classes
        return deepest.mean((2, 3)) @ weight.to(deepest).T + bias.to(deepest)
