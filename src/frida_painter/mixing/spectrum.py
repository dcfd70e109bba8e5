"""Reflectance in sixteen bands of light, the colour that it has, and the smoothest one that has a given colour.

Three numbers are too few to mix paints by: what two paints both reflect only shows band by band.
"""

import torch
from torch import Tensor

from frida_painter.perception.light import to_linear, to_srgb

BANDS = tuple(range(400, 701, 20))
"""Middles of the bands, nanometres."""
# CIE 1931 colour matching functions and the power of daylight D65 at the bands (ISO/CIE 11664-1 and -2).
_X = (
    0.01431,
    0.13438,
    0.34828,
    0.2908,
    0.09564,
    0.0049,
    0.06327,
    0.2904,
    0.5945,
    0.9163,
    1.0622,
    0.85445,
    0.4479,
    0.1649,
    0.04677,
    0.01136,
)
_Y = (0.0004, 0.004, 0.023, 0.06, 0.13902, 0.323, 0.71, 0.954, 0.995, 0.87, 0.631, 0.381, 0.175, 0.061, 0.017, 0.0041)
_Z = (
    0.06785,
    0.6456,
    1.74706,
    1.6692,
    0.81295,
    0.272,
    0.07825,
    0.0203,
    0.0039,
    0.00165,
    0.0008,
    0.00019,
    0.00002,
    0.0,
    0.0,
    0.0,
)
_D65 = (
    82.75,
    93.43,
    104.87,
    117.81,
    115.92,
    109.35,
    104.79,
    104.41,
    100.0,
    95.79,
    90.01,
    87.7,
    83.7,
    80.21,
    78.28,
    71.61,
)
_XYZ_TO_RGB = ((3.2406, -1.5372, -0.4986), (-0.9689, 1.8758, 0.0415), (0.0557, -0.2040, 1.0570))
# No paint reflects less or more: beyond, spectra with that colour grow wild, and no paint is like them.
_DARKEST, _LIGHTEST = 0.003, 0.95
_ROUNDS = 60
_EXACT = 1e-9


def color_of(reflectance: Tensor) -> Tensor:
    """sRGB [..., 3] in [0, 1] of reflectances [..., 16] in daylight; what sRGB cannot hold is brought to its side."""
    return to_srgb(reflectance @ _light(reflectance).T)


def reflectance_of(color: Tensor) -> Tensor:
    """The smoothest reflectance [..., 16] between 0 and 1 that has the colour sRGB [..., 3].

    Least squares of the slope of its inverse hyperbolic tangent, by Newton's method (S. A. Burns,
    "Generating reflectance curves from sRGB triplets", arXiv 1710.05732, 2017). Colours that are
    darker or lighter than any paint are brought to where paints end.
    """
    linear = to_linear(color.detach().double()).clamp(_DARKEST, _LIGHTEST)
    flat = linear.reshape(-1, 3)
    found = torch.stack([_smoothest(one) for one in flat]) if len(flat) else flat.new_zeros(0, len(BANDS))
    return found.reshape(*color.shape[:-1], len(BANDS))


def _smoothest(linear: Tensor) -> Tensor:
    """The reflectance [16] with that linear light [3]."""
    bands, light = len(BANDS), _light(linear)
    slope = torch.diff(torch.eye(bands, dtype=linear.dtype), dim=0)
    stiffness = 2 * slope.T @ slope
    height, price = linear.new_full((bands,), float(torch.atanh(2 * linear.mean() - 1))), linear.new_zeros(3)
    for _ in range(_ROUNDS):
        curve = torch.tanh(height)
        steep = light * (1 - curve**2) / 2  # [3, 16], how the light answers to the heights
        bent = torch.diag(-curve * (1 - curve**2) * (light.T @ price))
        left = torch.cat((stiffness @ height + steep.T @ price, light @ (curve + 1) / 2 - linear))
        if float(left.abs().max()) < _EXACT:
            break
        system = torch.zeros(bands + 3, bands + 3, dtype=linear.dtype)
        system[:bands, :bands] = stiffness + bent
        system[:bands, bands:] = steep.T
        system[bands:, :bands] = steep
        step = torch.linalg.solve(system, -left)
        pace = min(1.0, 1.5 / float(step[:bands].abs().max().clamp(min=1e-12)))  # where tanh is flat, steps are wild
        height, price = height + pace * step[:bands], price + pace * step[bands:]
    return (torch.tanh(height) + 1) / 2


def _light(like: Tensor) -> Tensor:
    """Linear light of each band in red, green and blue [3, 16]; all bands together are white."""
    matching = torch.tensor((_X, _Y, _Z), dtype=like.dtype) * torch.tensor(_D65, dtype=like.dtype)
    light = torch.tensor(_XYZ_TO_RGB, dtype=like.dtype) @ matching
    return light / light.sum(1, keepdim=True)
