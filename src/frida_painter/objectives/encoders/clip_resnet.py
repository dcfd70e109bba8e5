"""Image tower of CLIP's ResNet variants; the paper compares its last convolutional layer (Radford et al. 2021).

It is a ResNet with three changes. The stem has three convolutions and an average pool. Each stride is an average
pool before a convolution of stride one, which avoids aliasing. Attention replaces the mean at the end. Batch
normalisations are folded into the convolutions.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.devices import Constant, half_precision
from frida_painter.errors import WeightsError

MEAN, SPREAD = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)
"""Statistics of the sRGB channels in the training of all variants of CLIP."""
_PREFIX = "visual."
_EPSILON = 1e-5
_EXPANSION = 4  # output channels of a block, relative to those inside
_HEAD = 64  # channels of one attention head
_CELL = 32  # pixels of a side that one feature of the last layer covers


@dataclass(frozen=True)
class _Convolution:
    """Convolution with folded normalisation: weight [out, in, k, k], bias [out]."""

    weight: Tensor
    bias: Tensor

    def __call__(self, x: Tensor, stride: int = 1) -> Tensor:
        reach = self.weight.shape[-1] // 2
        return functional.conv2d(x, self.weight.to(x), self.bias.to(x), stride=stride, padding=reach)


@dataclass(frozen=True)
class _Block:
    """Bottleneck block: narrow, convolve, widen, with a skip connection that is adapted to the shape if needed."""

    narrow: _Convolution
    look: _Convolution
    widen: _Convolution
    beside: _Convolution | None
    stride: int

    def __call__(self, x: Tensor) -> Tensor:
        inner = functional.relu(self.look(functional.relu(self.narrow(x))))
        out = self.widen(_pool(inner, self.stride))
        return functional.relu(out + (x if self.beside is None else self.beside(_pool(x, self.stride))))


class ClipResNet:
    """Image tower with frozen weights from the tensors of OpenAI's state dict (`visual.conv1.weight` and so on).

    The tensors set the size: RN50, RN101, RN50x4 and so on. Raises WeightsError if they do not fit.
    """

    def __init__(self, tensors: Mapping[str, Tensor], name: str = "CLIP ResNet") -> None:
        self.name = name
        self._statistics = Constant(torch.tensor((MEAN, SPREAD))[..., None, None])
        mine = {key.removeprefix(_PREFIX): tensor.float() for key, tensor in tensors.items() if key.startswith(_PREFIX)}
        try:
            self._stem = [_fold(mine, f"conv{number}", f"bn{number}") for number in (1, 2, 3)]
            self._stages = [_stage(mine, number) for number in (1, 2, 3, 4)]
            parts = ("q_proj", "k_proj", "v_proj", "c_proj")
            self._attention = {part: (mine[f"attnpool.{part}.weight"], mine[f"attnpool.{part}.bias"]) for part in parts}
            self._places = mine["attnpool.positional_embedding"]  # [1 + cells, channels]
        except KeyError as cause:
            raise WeightsError(
                f"The weights hold no {_PREFIX + str(cause.args[0])!r}, so they are not those of CLIP's ResNet kind; "
                "give the state dict of an image tower such as RN50, or the folder of another kind."
            ) from cause
        self.side = _CELL * round((len(self._places) - 1) ** 0.5)
        channels = self._stages[-1][-1].widen.weight.shape[0]
        if self._places.shape != (1 + (self.side // _CELL) ** 2, channels) or channels % _HEAD:
            raise WeightsError(
                f"The weights have {len(self._places)} places for {channels} channels, which is not CLIP's ResNet kind."
            )

    def features(self, views: Tensor) -> tuple[Tensor, Tensor]:
        """Returns feature maps of views [n, 3, h, w], sRGB in [0, 1]: the last layers of stages three and four.

        Returns [n, c / 2, h / 16, w / 16] and [n, c, h / 32, w / 32]. Differentiable.
        """
        mean, spread = self._statistics.like(views)
        x = (views - mean) / spread
        with half_precision(views.device):
            for number, convolution in enumerate(self._stem):
                x = functional.relu(convolution(x, stride=1 if number else 2))
            x = _pool(x, 2)
            seen = []
            for stage in self._stages:
                for block in stage:
                    x = block(x)
                seen.append(x)
        return seen[2].to(views), seen[3].to(views)

    def embed_pictures(self, pictures: Tensor) -> Tensor:
        """Returns embeddings of pictures [n, 3, h, w], sRGB in [0, 1]: [n, d], each of unit length. Differentiable."""
        size = [self.side, self.side]
        seen = self.features(functional.interpolate(pictures, size, mode="bicubic", antialias=True).clamp(0, 1))[1]
        cells = seen.flatten(2).transpose(1, 2)  # [n, cells, c]
        cells = torch.cat((cells.mean(1, keepdim=True), cells), 1) + self._places.to(cells)
        query, key, value = (self._project(part, cells) for part in ("q_proj", "k_proj", "v_proj"))
        heads = cells.shape[2] // _HEAD
        query, key, value = (x.reshape(*x.shape[:2], heads, _HEAD).transpose(1, 2) for x in (query[:, :1], key, value))
        summed = functional.scaled_dot_product_attention(query, key, value)  # [n, heads, 1, channels of a head]
        return functional.normalize(self._project("c_proj", summed.flatten(1)), dim=1)

    def _project(self, part: str, x: Tensor) -> Tensor:
        weight, bias = self._attention[part]
        return functional.linear(x, weight.to(x), bias.to(x))


def _stage(tensors: Mapping[str, Tensor], number: int) -> list[_Block]:
    """Returns the blocks of one stage; each stage but the first halves the picture in its first block."""
    blocks: list[_Block] = []
    while not blocks or f"layer{number}.{len(blocks)}.conv1.weight" in tensors:
        name = f"layer{number}.{len(blocks)}"
        narrow, look, widen = (_fold(tensors, f"{name}.conv{part}", f"{name}.bn{part}") for part in (1, 2, 3))
        if len(widen.bias) != _EXPANSION * len(narrow.bias):
            raise WeightsError(f"Block {name} widens to {len(widen.bias)} channels, which is not CLIP's ResNet kind.")
        has_beside = f"{name}.downsample.0.weight" in tensors
        beside = _fold(tensors, f"{name}.downsample.0", f"{name}.downsample.1") if has_beside else None
        blocks.append(_Block(narrow, look, widen, beside, stride=2 if number > 1 and not blocks else 1))
    return blocks


def _fold(tensors: Mapping[str, Tensor], convolution: str, norm: str) -> _Convolution:
    scale = tensors[f"{norm}.weight"] * torch.rsqrt(tensors[f"{norm}.running_var"] + _EPSILON)
    bias = tensors[f"{norm}.bias"] - tensors[f"{norm}.running_mean"] * scale
    return _Convolution(tensors[f"{convolution}.weight"] * scale[:, None, None, None], bias)


def _pool(x: Tensor, stride: int) -> Tensor:
    return functional.avg_pool2d(x, stride) if stride > 1 else x
