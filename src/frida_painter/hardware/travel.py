"""Limits of a machine's travel, as its controller tells them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_TOLERANCE = 1e-5  # metres: controllers round to hundredths of a millimetre


@dataclass(frozen=True)
class TravelLimits:
    """Limits within which a machine keeps its tip by itself, as its controller tells them (soft limits, endstops).

    lower, upper: corners in metres of the robot's frame; infinite along an axis without a limit
    zero_known: False if only the distance between the corners can be trusted, because the zero is not known
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    zero_known: bool = True

    def describe(self, axis: int) -> str:
        """Returns the limits along an axis, as part of a sentence."""
        low, high = 1000 * self.lower[axis], 1000 * self.upper[axis]
        return f"{low:.1f} to {high:.1f} mm" if self.zero_known else f"{high - low:.1f} mm of travel"

    def beyond(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns True for each coordinate of positions [k, 3] (m) that is beyond the limits: [k, 3].

        If the zero is not known, all coordinates along an axis are beyond if together they need more travel than
        there is.
        """
        lower, upper = np.array(self.lower) - _TOLERANCE, np.array(self.upper) + _TOLERANCE
        if not self.zero_known:
            within = np.ptp(position, axis=0) <= upper - lower
            return np.broadcast_to(~within, position.shape)
        return ~((position >= lower) & (position <= upper))
