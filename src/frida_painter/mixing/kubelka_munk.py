"""Kubelka and Munk's theory of paint: absorption K and scattering S, which add up when paints are mixed.

P. Kubelka, F. Munk, "Ein Beitrag zur Optik der Farbanstriche" (1931); for mixtures D. R. Duncan, "The
colour of pigment mixtures" (1940); for the surface J. L. Saunderson, "Calculation of the color of
pigmented plastics" (1942). All is per band of light, and for films so thick that nothing shows through,
unless said otherwise.
"""

import torch
from torch import Tensor

from frida_painter.mixing.finish import Finish

# Of the light outside and inside, what the surface of a dried matte paint sends back (Saunderson).
_OUTER, _INNER = 0.035, 0.6
_BLACKEST = 1e-3  # reflectance within a paint
_LEAST_SCATTERING = 1e-4
_OPAQUE = 1e-4  # difference between over white and over black: no film is that opaque in any measurement


def reflectance(absorption: Tensor, scattering: Tensor, finish: Finish = Finish.matte) -> Tensor:
    """What a thick film is seen to reflect, in (0, 1]: any shape."""
    ratio = absorption / scattering
    within = 1 + ratio - (ratio.square() + 2 * ratio).sqrt()
    beneath = (1 - _OUTER) * (1 - _INNER) * within / (1 - _INNER * within)
    return beneath + _OUTER if finish is Finish.matte else beneath


def ratio(reflected: Tensor) -> Tensor:
    """K / S of a thick matte film that is seen to reflect so much: any shape."""
    within = inside(reflected)
    return (1 - within).square() / (2 * within)


def inside(reflected: Tensor) -> Tensor:
    """What is reflected within a paint whose matte surface is seen to reflect so much: any shape."""
    beneath = (reflected - _OUTER) / (1 - _OUTER)
    return (beneath / (1 - _INNER + _INNER * beneath)).clamp(_BLACKEST, 1 - _BLACKEST)


def mixed(parts: Tensor, absorption: Tensor, scattering: Tensor, finish: Finish = Finish.matte) -> Tensor:
    """What mixtures are seen to reflect: parts [m, n] of n paints with K and S [n, b] each -> [m, b]."""
    return reflectance(parts @ absorption, parts @ scattering, finish)


def film_over(over_white: Tensor, over_black: Tensor, ground: Tensor) -> tuple[Tensor, Tensor]:
    """K and S [b] per thickness of a film that was seen over white and over black.

    over_white, over_black: what the film reflects over a ground that reflects `ground`, and over one
    that reflects nothing, where it must not be lighter (Kubelka's hyperbolic solution, 1948).
    """
    over_black, ground = inside(over_black), inside(ground)
    white = torch.maximum(inside(over_white), over_black + _OPAQUE)
    a = (white + (over_black - white + ground) / (over_black * ground)) / 2
    a = a.clamp(min=1 + 1e-6)
    b = (a.square() - 1).sqrt()
    scattering = torch.atanh((b * over_black / (1 - a * over_black)).clamp(max=1 - 1e-9)) / b
    scattering = scattering.clamp(min=_LEAST_SCATTERING)
    return scattering * (a - 1), scattering
