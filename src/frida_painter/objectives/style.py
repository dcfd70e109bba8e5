"""The style objective: have the colours, textures and marks of another picture, wherever they lie."""

import torch
from torch import Tensor

from frida_painter.devices import Constant, sent
from frida_painter.images import sized
from frida_painter.objectives.encoders.vgg import Vgg16
from frida_painter.objectives.transport import cosine_cost, euclidean_cost, moment_distance, relaxed_emd

LAYERS = ("conv1_2", "conv2_2", "conv3_1", "conv3_3", "conv4_3")
_PIXELS = 16_000  # of the picture in which styles are compared, about 112 x 143
_BALANCE = 0.04  # against the squared difference to a picture, when both have a weight of 1
_SAMPLES = 1024  # places at which features are compared
# Rows of the matrix that turns sRGB into lightness and two colour differences, which vary independently.
_DECORRELATE = ((0.577, 0.577, 0.577), (-0.577, 0.789, -0.211), (0.577, 0.211, -0.789))


class Style:
    """l_style of the paper (Eq. "style"), as in STROTSS: relaxed Earth Mover's Distances, and moments.

    style [3, H, W] in [0, 1]: whose style is wanted; vgg: sees it. Places are sampled once, from
    `seed`, so that the same picture always has the same distance.
    """

    def __init__(self, style: Tensor, vgg: Vgg16, seed: int) -> None:
        self._vgg = vgg
        self._seed = seed
        self._decorrelate = Constant(torch.tensor(_DECORRELATE))
        with torch.no_grad():
            self._clouds = self._see(style)

    def __call__(self, picture: Tensor) -> Tensor:
        """picture [3, H, W] in [0, 1] -> its distance in style, 0 for the style picture itself; differentiable."""
        (colors, *seen), (wanted, *layers) = self._see(picture), self._clouds
        total = relaxed_emd(euclidean_cost(colors, wanted.to(colors))) + moment_distance(colors, wanted.to(colors))
        for cloud, aim in zip(seen, layers, strict=True):
            aim = aim.to(cloud)
            total = total + (relaxed_emd(cosine_cost(cloud, aim)) + moment_distance(cloud, aim)) / len(LAYERS)
        return _BALANCE * total

    def _see(self, picture: Tensor) -> list[Tensor]:
        """Colours, then the features of each layer, at sampled places: [n, c] each."""
        small = sized(picture, _PIXELS)
        maps = [small, *self._vgg.features(small, LAYERS)]
        clouds = [_sampled(one, self._seed) for one in maps]
        clouds[0] = clouds[0] @ self._decorrelate.like(clouds[0]).T
        # Features of one layer are brought to one size: their own units mean nothing.
        return [clouds[0], *(cloud / (cloud.detach().square().mean().sqrt() + 1e-6) for cloud in clouds[1:])]


def _sampled(features: Tensor, seed: int) -> Tensor:
    """Features [c, h, w] at no more than so many places, [n, c]: the same places for every map of that shape."""
    rows = features.flatten(1).T
    if len(rows) <= _SAMPLES:
        return rows
    places = torch.randperm(len(rows), generator=torch.Generator().manual_seed(seed))[:_SAMPLES]
    return rows[sent(places, rows.device)]
