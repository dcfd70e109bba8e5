"""Paint after Kubelka and Munk: films that absorb and scatter, in three channels of linear light.

A paint has an absorption K and a scattering S per millimetre of film. Mixing adds K and S by volume. The
reflectance of a film over a ground is the hyperbolic solution (P. Kubelka, F. Munk, "Ein Beitrag zur Optik der
Farbanstriche", 1931; W. Baxter et al., "IMPaSTo", NPAR 2004).
"""

import math

import numba
import numpy as np
from numpy.typing import NDArray

BANDS = 3

# Limits of the reflectance: soot still reflects, and gesso is the white reference.
_DARKEST, _LIGHTEST = 0.006, 0.985
# Scattering of titanium white, per millimetre: a film of 0.06 mm over black reflects 0.92.
_WHITE_SCATTERING = 200.0
# Deep colours hold less white pigment and scatter less. With 0, all paints would have the same scattering, and
# black would drown white in a mixture. With 1, all would have the same extinction, and no mixture would be vivid.
_SCATTERING_FALL = 0.5


def to_linear(srgb: NDArray[np.floating]) -> NDArray[np.float64]:
    """Returns linear light for sRGB in [0, 1], any shape (IEC 61966-2-1)."""
    value = np.clip(np.asarray(srgb, dtype=np.float64), 0, 1)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def to_srgb(linear: NDArray[np.floating]) -> NDArray[np.float64]:
    """Returns sRGB in [0, 1] for linear light, any shape; values outside are clipped."""
    value = np.clip(np.asarray(linear, dtype=np.float64), 0, 1)
    return np.where(value <= 0.0031308, value * 12.92, 1.055 * value ** (1 / 2.4) - 0.055)


def absorption_and_scattering(srgb: NDArray[np.floating]) -> NDArray[np.float64]:
    """Returns K and S per millimetre, [..., 6], of a paint whose thick film has the colour sRGB [..., 3].

    K / S = (1 - R)^2 / 2R fixes their ratio. The scattering falls with this ratio, as in mixed studio paints.
    """
    reflectance = np.clip(to_linear(srgb), _DARKEST, _LIGHTEST)
    ratio = (1 - reflectance) ** 2 / (2 * reflectance)
    scattering = _WHITE_SCATTERING * (1 + ratio) ** -_SCATTERING_FALL
    return np.concatenate((ratio * scattering, scattering), axis=-1)


@numba.njit(cache=True, nogil=True)
def film_over(absorption: float, scattering: float, thickness: float, ground: float) -> float:
    """Returns the reflectance of one channel of a film over a ground of known reflectance.

    absorption, scattering: K and S, per millimetre
    thickness: millimetres
    """
    depth = scattering * thickness
    if depth < 1e-9:
        return ground
    a = 1.0 + absorption / scattering
    b = math.sqrt(max(a * a - 1.0, 1e-8))
    if b * depth > 7.0:  # The ground is invisible: exp(-14) is below a millionth.
        return a - b
    decay = math.exp(-2.0 * b * depth)
    b_coth = b * (1.0 + decay) / (1.0 - decay)
    return (1.0 - ground * (a - b_coth)) / (a - ground + b_coth)
