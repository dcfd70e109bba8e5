"""HED: where a person would draw the edges of a picture (Xie and Tu 2015).

A side output looks at each of VGG16's five blocks, from fine to coarse; a weighted sum fuses them.
"""

from collections.abc import Mapping

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.errors import WeightsError
from frida_painter.objectives.encoders.vgg import Vgg16

_SEEN = ("conv1_2", "conv2_2", "conv3_3", "conv4_3", "conv5_3")
_SIDES = tuple(f"dsn{number}" for number in range(1, 6))


class Hed:
    """The edge detector with frozen weights, by the tensors of the weights `hed`. Raises WeightsError."""

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
        """How likely each pixel of sRGB [3, H, W] in [0, 1] lies on an edge, [H, W] in [0, 1]; differentiable."""
        size = list(picture.shape[1:])
        sides = []
        for seen, (weight, bias) in zip(self._trunk.features(picture, _SEEN), self._sides, strict=True):
            side = functional.conv2d(seen[None], weight.to(seen), bias.to(seen))
            sides.append(functional.interpolate(side, size, mode="bilinear", align_corners=False))
        weight, bias = self._fuse
        fused = functional.conv2d(torch.cat(sides, 1), weight.to(picture), bias.to(picture))
        return torch.sigmoid(fused)[0, 0]
