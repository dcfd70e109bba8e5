"""EfficientNet-Lite, a small classifier with a thousand classes.

Tan and Le 2019; the Lite variants are Google's. Batch normalisations are folded into the convolutions, which
halves the work.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.devices import half_precision
from frida_painter.errors import WeightsError

_STRIDES = (1, 2, 2, 2, 1, 2, 1)  # stride of the first block in each of the seven stages
_EPSILON = 1e-3
_MEAN, _SPREAD = 127 / 255, 128 / 255


@dataclass(frozen=True)
class _Convolution:
    """Convolution with folded normalisation: weight [out, in / groups, k, k], bias [out]."""

    weight: Tensor
    bias: Tensor
    stride: int = 1

    def __call__(self, x: Tensor) -> Tensor:
        kernel = self.weight.shape[-1]
        groups = x.shape[1] // self.weight.shape[1]
        if self.stride == 1:
            return functional.conv2d(x, self.weight.to(x), self.bias.to(x), padding=kernel // 2, groups=groups)
        # Padding as in TensorFlow: the odd row and column come last, so the last step reaches the edge.
        rows, columns = (max(0, (-(-n // self.stride) - 1) * self.stride + kernel - n) for n in x.shape[-2:])
        x = functional.pad(x, (columns // 2, columns - columns // 2, rows // 2, rows - rows // 2))
        return functional.conv2d(x, self.weight.to(x), self.bias.to(x), stride=self.stride, groups=groups)


@dataclass(frozen=True)
class _Block:
    """Inverted residual block: expand, depthwise convolution, project; with a skip connection if shapes match."""

    expand: _Convolution | None
    depthwise: _Convolution
    project: _Convolution

    def __call__(self, x: Tensor) -> Tensor:
        inner = x if self.expand is None else functional.relu6(self.expand(x))
        out = self.project(functional.relu6(self.depthwise(inner)))
        return out + x if out.shape == x.shape else out


class EfficientNetLite:
    """EfficientNet-Lite 0, 1 or 2 with frozen weights from the tensors of its published state dict.

    Raises WeightsError if the tensors do not fit.
    """

    def __init__(self, tensors: Mapping[str, Tensor]) -> None:
        try:
            self._stem = _fold(tensors, "_conv_stem", "_bn0", 2)
            self._stages = _stages(tensors)
            self._head = _fold(tensors, "_conv_head", "_bn1")
            self._classes = tensors["_fc.weight"], tensors["_fc.bias"]
        except KeyError as cause:
            raise WeightsError(
                f"The weights hold no {cause.args[0]!r}, so they are not EfficientNet-Lite's; fetch them again."
            ) from cause
        if len(self._stages) != len(_STRIDES):
            raise WeightsError(f"The weights have {len(self._stages)} stages; EfficientNet-Lite has {len(_STRIDES)}.")

    def features(self, views: Tensor) -> tuple[Tensor, Tensor]:
        """Returns two feature maps of views [n, 3, h, w], sRGB in [0, 1], before pooling.

        The first is that of stage five, [n, c, h / 16, w / 16]: parts of objects. The second is that of the
        last layer, [n, 1280, h / 32, w / 32].
        """
        with half_precision(views.device):
            x = functional.relu6(self._stem((views - _MEAN) / _SPREAD))
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


def _stages(tensors: Mapping[str, Tensor]) -> list[list[_Block]]:
    """Returns the blocks by stage; a stage begins at each change of the number of channels."""
    stages: list[list[_Block]] = []
    channels = number = 0
    while f"_blocks.{number}._project_conv.weight" in tensors:
        name = f"_blocks.{number}"
        project = _fold(tensors, f"{name}._project_conv", f"{name}._bn2")
        begins = len(project.bias) != channels
        if begins:
            stages.append([])
            channels = len(project.bias)
        stride = _STRIDES[min(len(stages), len(_STRIDES)) - 1] if begins else 1
        widens = f"{name}._expand_conv.weight" in tensors
        expand = _fold(tensors, f"{name}._expand_conv", f"{name}._bn0") if widens else None
        stages[-1].append(_Block(expand, _fold(tensors, f"{name}._depthwise_conv", f"{name}._bn1", stride), project))
        number += 1
    return stages


def _fold(tensors: Mapping[str, Tensor], convolution: str, norm: str, stride: int = 1) -> _Convolution:
    scale = tensors[f"{norm}.weight"] * torch.rsqrt(tensors[f"{norm}.running_var"] + _EPSILON)
    bias = tensors[f"{norm}.bias"] - tensors[f"{norm}.running_mean"] * scale
    return _Convolution(tensors[f"{convolution}.weight"] * scale[:, None, None, None], bias, stride)
