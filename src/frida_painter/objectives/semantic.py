"""The semantic replication objective: show what a picture shows, as a network sees it, rather than its pixels."""

import torch
from torch import Tensor

from frida_painter.objectives.augment import Views
from frida_painter.objectives.encoders.efficientnet import EfficientNetLite

_VIEWS = 12
_AT_A_TIME = 2
_SIDE = 176  # pixels of a view
_BALANCE = 0.05  # against the squared difference to a picture, when both have a weight of 1


class Semantic:
    """Mean squared difference of deep spatial features (paper, Eq. "clip_conv_loss"), over augmented views.

    image [3, H, W] in [0, 1]: what is to be shown; seer: the network whose features are compared,
    each map relative to the strength of the target's. What the target looks like in each of the
    views is prepared once. Every call looks in the next two of them, in an order drawn from `seed`.
    """

    def __init__(self, image: Tensor, seer: EfficientNetLite, seed: int) -> None:
        self._seer = seer
        self._views = Views(_VIEWS, _SIDE, seed)
        self._generator = torch.Generator().manual_seed(seed)
        with torch.no_grad():
            self._targets = seer.features(self._views.of(image, torch.arange(_VIEWS)))

    def __call__(self, picture: Tensor) -> Tensor:
        """picture [3, H, W] in [0, 1] -> its distance in two random views; differentiable."""
        return self._distance(picture, torch.randperm(_VIEWS, generator=self._generator)[:_AT_A_TIME])

    def judge(self, picture: Tensor) -> Tensor:
        """The same for all of the picture at once, always the same."""
        return self._distance(picture, torch.zeros(1, dtype=torch.long))

    def _distance(self, picture: Tensor, which: Tensor) -> Tensor:
        total = picture.new_zeros(())
        for seen, targets in zip(self._seer.features(self._views.of(picture, which)), self._targets, strict=True):
            wanted = targets[which].to(seen)
            total = total + (seen - wanted).square().mean() / wanted.square().mean().clamp(min=1e-8)
        return _BALANCE * total
