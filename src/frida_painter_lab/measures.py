"""Measures of the distance between a painting and its goal that its planner did not optimise."""

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from torch import Tensor
from torch.nn import functional

from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.convolutional import Vgg16
from frida_painter.objectives.semantic import Views
from frida_painter.system import images

# The windows of SSIM (Wang et al. 2004): Gaussian, of 11 pixels; the border of a picture has none.
_SIGMA, _RADIUS = 1.5, 5  # pixels
_MEAN_FLOOR, _CONTRAST_FLOOR = 0.01**2, 0.03**2  # (K L)^2 as published, for the range L = 1
_ROWS = 256  # of the pictures in which edges are detected
_BLUR = 1.6  # its pixels
_LOW, _HIGH = 40, 100  # of 255: slopes at which Canny's edges continue and start
_TOLERANCE = 0.015  # of the picture's diagonal
_VIEWS = 6


def mse(picture: Tensor, target: Tensor) -> float:
    """Returns the mean squared difference of two pictures [3, H, W] in [0, 1]."""
    return float((picture - target).square().mean())


def psnr(picture: Tensor, target: Tensor) -> float:
    """Returns the peak signal-to-noise ratio of two pictures [3, H, W] in [0, 1], in dB."""
    return -10 * float((picture - target).square().mean().clamp(min=1e-12).log10())


def ssim(picture: Tensor, target: Tensor) -> float:
    """Returns the structural similarity of two pictures [3, H, W] in [0, 1], mean over channels and windows.

    The windows are Gaussian, as published (Wang et al. 2004).
    """
    one, other = (each.detach().double().numpy() for each in (picture, target))

    def smooth(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(gaussian_filter(values, (0, _SIGMA, _SIGMA), radius=(0, _RADIUS, _RADIUS)), np.float64)

    mean, its_mean = smooth(one), smooth(other)
    variances = smooth(one**2) - mean**2 + smooth(other**2) - its_mean**2
    covariance = smooth(one * other) - mean * its_mean
    found = (2 * mean * its_mean + _MEAN_FLOOR) * (2 * covariance + _CONTRAST_FLOOR)
    found /= (mean**2 + its_mean**2 + _MEAN_FLOOR) * (variances + _CONTRAST_FLOOR)
    return float(found[:, _RADIUS:-_RADIUS, _RADIUS:-_RADIUS].mean())


@torch.no_grad()
def feature_distance(seer: Seer, picture: Tensor, target: Tensor, side: int, seed: int = 0) -> float:
    """Returns the mean cosine distance, in [0, 2], of a network's features, over layers, places and several views.

    picture, target: [3, H, W] in [0, 1]
    side: pixels of a view
    """
    views, which = Views(_VIEWS, side, seed), torch.arange(_VIEWS)
    seen, wanted = seer.features(views.of(picture, which)), seer.features(views.of(target, which))
    return float(np.mean([_cosine(a, b) for a, b in zip(seen, wanted, strict=True)]))


@torch.no_grad()
def perceptual_distance(vgg: Vgg16, picture: Tensor, target: Tensor) -> float:
    """Returns a distance like LPIPS (Zhang et al. 2018), without its learned weights of channels.

    It is the mean squared difference of unit features of five layers of VGG16, averaged over places and layers.
    """
    layers = ("conv1_2", "conv2_2", "conv3_3", "conv4_3", "conv5_3")
    a, b = vgg.features(picture, layers), vgg.features(target, layers)
    return float(np.mean([2 * _cosine(x[None], y[None]) for x, y in zip(a, b, strict=True)]))


def edge_score(picture: Tensor, target: Tensor) -> float:
    """Returns the agreement of the edges of two pictures [3, H, W]: the F-score of Canny's edges, in [0, 1].

    Two edges match if their distance is at most 1.5 % of the picture's diagonal.
    """
    found, wanted = _edges(picture), _edges(target)
    reach = _TOLERANCE * float(np.hypot(*wanted.shape))
    precision, recall = _share_near(found, wanted, reach), _share_near(wanted, found, reach)
    return 2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0


def _cosine(a: Tensor, b: Tensor) -> float:
    return float((1 - functional.cosine_similarity(a, b, dim=1)).mean())


def _edges(picture: Tensor) -> NDArray[np.bool_]:
    """Returns Canny's edges [h, w] of a blurred picture; the blur removes the grain of a brush."""
    pixels = images.to_uint8(images.fit(picture, _ROWS, round(_ROWS * picture.shape[2] / picture.shape[1])))
    gray = cv2.GaussianBlur(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), (0, 0), _BLUR)
    found: NDArray[np.bool_] = cv2.Canny(gray, _LOW, _HIGH, L2gradient=True) > 0
    return found


def _share_near(edges: NDArray[np.bool_], others: NDArray[np.bool_], reach: float) -> float:
    """Returns the share of edges that have another edge within `reach` pixels."""
    if not edges.any() or not others.any():
        return 0.0
    away = cv2.distanceTransform((~others).astype(np.uint8), cv2.DIST_L2, 5)
    return float((away[edges] <= reach).mean())
