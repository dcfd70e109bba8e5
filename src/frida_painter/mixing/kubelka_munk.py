"""Theory of Kubelka and Munk: absorption K and scattering S of paints, which add up in mixtures.

P. Kubelka, F. Munk, "Ein Beitrag zur Optik der Farbanstriche" (1931); for mixtures D. R. Duncan, "The colour of
pigment mixtures" (1940); for the surface J. L. Saunderson, "Calculation of the color of pigmented plastics"
(1942). All values are for each band of light. Films are opaque unless stated otherwise.
"""

import torch
from torch import Tensor

from frida_painter.mixing import Finish

# Reflection by the surface of a dry matte paint for light from outside and from inside (Saunderson).
_OUTER, _INNER = 0.035, 0.6
_BLACKEST = 1e-3  # smallest reflectance inside a paint
_MIN_SCATTERING = 1e-4
_OPAQUE = 1e-4  # smallest difference between white and black ground


def reflectance(absorption: Tensor, scattering: Tensor, finish: Finish = Finish.matte) -> Tensor:
    """Returns the visible reflectance of an opaque film in (0, 1], any shape."""
    ratio = absorption / scattering
    within = 1 + ratio - (ratio.square() + 2 * ratio).sqrt()
    beneath = (1 - _OUTER) * (1 - _INNER) * within / (1 - _INNER * within)
    return beneath + _OUTER if finish is Finish.matte else beneath


def ratio(reflected: Tensor) -> Tensor:
    """Returns K / S of an opaque matte film with this visible reflectance, any shape."""
    within = inside(reflected)
    return (1 - within).square() / (2 * within)


def inside(reflected: Tensor) -> Tensor:
    """Returns the reflectance inside a paint from the visible reflectance of its matte surface, any shape."""
    beneath = (reflected - _OUTER) / (1 - _OUTER)
    return (beneath / (1 - _INNER + _INNER * beneath)).clamp(_BLACKEST, 1 - _BLACKEST)


def mix_reflectance(parts: Tensor, absorption: Tensor, scattering: Tensor, finish: Finish = Finish.matte) -> Tensor:
    """Returns the visible reflectance [m, b] of mixtures.

    parts [m, n]: amounts of n paints
    absorption, scattering [n, b]: K and S of the paints
    """
    return reflectance(parts @ absorption, parts @ scattering, finish)


def film_over(over_white: Tensor, over_black: Tensor, ground: Tensor) -> tuple[Tensor, Tensor]:
    """Returns K and S [b], for the thickness of the film, from measurements over white and over black.

    over_white, over_black: reflectance of the film on a ground of reflectance `ground`, and on a black ground.
    The second must not be larger than the first (Kubelka's hyperbolic solution, 1948).
    """
    over_black, ground = inside(over_black), inside(ground)
    white = torch.maximum(inside(over_white), over_black + _OPAQUE)
    a = (white + (over_black - white + ground) / (over_black * ground)) / 2
    a = a.clamp(min=1 + 1e-6)
    b = (a.square() - 1).sqrt()
    scattering = torch.atanh((b * over_black / (1 - a * over_black)).clamp(max=1 - 1e-9)) / b
    scattering = scattering.clamp(min=_MIN_SCATTERING)
    return scattering * (a - 1), scattering
