"""How near a painting is to what it was to be, in ways that its planner did not optimise."""

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from torch import Tensor
from torch.nn import functional

from frida_painter import images
from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.objectives.augment import Views
from frida_painter.objectives.brushwork import directions
from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.vgg import Vgg16
from frida_painter.strokes import Strokes

_ROWS = 256  # of the pictures in which edges are sought
_BLUR = 1.6  # pixels of those
_LOW, _HIGH = 40, 100  # slopes, of 255, at which Canny's edges go on and begin
_TOLERANCE = 0.015  # of the picture's diagonal
_AREA = 12  # pixels of those, half the width over which a composition's edges are looked at
_VIEWS = 6


def mse(picture: Tensor, target: Tensor) -> float:
    """Mean squared difference of two pictures [3, H, W] in [0, 1]."""
    return float((picture - target).square().mean())


def psnr(picture: Tensor, target: Tensor) -> float:
    """Peak signal to noise of two pictures [3, H, W] in [0, 1], in dB."""
    return -10 * float((picture - target).square().mean().clamp(min=1e-12).log10())


def near_borders(regions: Tensor) -> Tensor:
    """Where a map [H, W] of regions has a border between two of them within one pixel, [H, W] of bool."""
    down, across = regions[1:] != regions[:-1], regions[:, 1:] != regions[:, :-1]
    border = functional.pad(down, (0, 0, 0, 1)) | functional.pad(down, (0, 0, 1, 0))
    border |= functional.pad(across, (0, 1)) | functional.pad(across, (1, 0))
    return border


@torch.no_grad()
def feature_distance(seer: Seer, picture: Tensor, target: Tensor, side: int, seed: int = 0) -> float:
    """Mean cosine distance, in [0, 2], of what a network sees where, over its layers and several views.

    picture, target: [3, H, W] in [0, 1]; side: pixels of a view.
    """
    views, which = Views(_VIEWS, side, seed), torch.arange(_VIEWS)
    seen, wanted = seer.features(views.of(picture, which)), seer.features(views.of(target, which))
    return float(np.mean([_cosine(a, b) for a, b in zip(seen, wanted, strict=True)]))


@torch.no_grad()
def perceptual_distance(vgg: Vgg16, picture: Tensor, target: Tensor) -> float:
    """A distance in the manner of LPIPS (Zhang et al. 2018), without its learned weights for channels.

    Squared differences of unit features of five layers of VGG16, each averaged over places.
    """
    layers = ("conv1_2", "conv2_2", "conv3_3", "conv4_3", "conv5_3")
    a, b = vgg.features(picture, layers), vgg.features(target, layers)
    return float(np.mean([2 * _cosine(x[None], y[None]) for x, y in zip(a, b, strict=True)]))


def edge_score(picture: Tensor, target: Tensor) -> float:
    """How well the edges of two pictures [3, H, W] agree: the F-score of Canny's edges, in [0, 1].

    An edge is found again where there is one within 1.5 % of the picture's diagonal.
    """
    found, wanted = _edges(picture), _edges(target)
    reach = _TOLERANCE * float(np.hypot(*wanted.shape))
    precision, recall = _share_near(found, wanted, reach), _share_near(wanted, found, reach)
    return 2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0


def edge_correlation(picture: Tensor, target: Tensor) -> float:
    """The correlation, in [-1, 1], of the coarse steps of lightness of two pictures, where they are.

    target is cropped as it fills the shape of `picture` [3, H, W].
    """
    steps = [_steps(images.fit(one, *_shape(picture)).mean(0)).flatten() for one in (picture, target)]
    return float(torch.corrcoef(torch.stack(steps))[0, 1])


def direction_agreement(strokes: Strokes, style: Tensor, size: CanvasSize) -> float:
    """How far strokes go the way of a style picture's marks where they lie: the circular correlation, in [-1, 1].

    It is the mean cosine of twice the angle between them (an angle and the opposite one are one direction), each stroke
    counting by its length and by how clear the direction of the style [3, H, W], cropped to the canvas, is there: 1 the
    same directions, 0 any, -1 across them.
    """
    filled = images.fit(style, _ROWS, round(_ROWS * size.width / size.height))
    doubled, coherence, _ = directions(filled)
    middle = PixelGrid(size, *doubled.shape).to_pixels(strokes.path(torch.tensor([0.5]))[:, 0]).round().long()
    columns, rows = (middle[:, axis].clamp(0, most - 1) for axis, most in enumerate(reversed(doubled.shape)))
    weight = coherence[rows, columns] * strokes.length
    return float((weight * torch.cos(2 * strokes.angle - doubled[rows, columns])).sum() / weight.sum().clamp(min=1e-9))


def exact_emd(cost: Tensor) -> float:
    """The Earth Mover's Distance for a square cost [n, n] between two clouds of n equal weights.

    Between equal weights the best transport is an assignment, so this is exact.
    """
    values = cost.detach().cpu().double().numpy()
    rows, columns = linear_sum_assignment(values)
    return float(values[rows, columns].mean())


def _cosine(a: Tensor, b: Tensor) -> float:
    return float((1 - functional.cosine_similarity(a, b, dim=1)).mean())


def _edges(picture: Tensor) -> NDArray[np.bool_]:
    """Canny's edges [h, w] of a picture, blurred first: the grain of a brush is no edge."""
    pixels = images.to_uint8(images.fit(picture, *_shape(picture)))
    gray = cv2.GaussianBlur(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), (0, 0), _BLUR)
    found: NDArray[np.bool_] = cv2.Canny(gray, _LOW, _HIGH, L2gradient=True) > 0
    return found


def _steps(gray: Tensor) -> Tensor:
    """How steeply lightness [h, w] changes over the size of an area rather than of a mark."""
    smooth = functional.avg_pool2d(gray[None, None], 2 * _AREA + 1, 1, _AREA, count_include_pad=False)[0, 0]
    across = smooth[_AREA:-_AREA, 2 * _AREA :] - smooth[_AREA:-_AREA, : -2 * _AREA]
    down = smooth[2 * _AREA :, _AREA:-_AREA] - smooth[: -2 * _AREA, _AREA:-_AREA]
    return (across.square() + down.square()).sqrt()


def _shape(picture: Tensor) -> tuple[int, int]:
    return _ROWS, round(_ROWS * picture.shape[2] / picture.shape[1])


def _share_near(edges: NDArray[np.bool_], others: NDArray[np.bool_], reach: float) -> float:
    """The share of edges that have one of the others within `reach` pixels."""
    if not edges.any() or not others.any():
        return 0.0
    away = cv2.distanceTransform((~others).astype(np.uint8), cv2.DIST_L2, 5)
    return float((away[edges] <= reach).mean())
