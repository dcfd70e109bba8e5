"""What a camera's lens does to straight lines, and how to undo it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import CalibrationError

_STRONGEST = 1.0
_ROUNDS = 60
_EXACT = 1e-3


@dataclass(frozen=True)
class Lens:
    """Radial and tangential distortion in OpenCV's model (D. Brown, "Close-range camera calibration", 1971).

    focal: focal length in pixels, along columns and along rows; middle: where the lens's axis meets
    the photograph, (column, row); coefficients: k1, k2, p1, p2, k3. Raises CalibrationError where
    they are not finite, or no lens is so strong.
    """

    focal: tuple[float, float]
    middle: tuple[float, float]
    coefficients: tuple[float, float, float, float, float]

    def __post_init__(self) -> None:
        numbers = np.array([*self.focal, *self.middle, *self.coefficients])
        sane = np.isfinite(numbers).all() and min(self.focal) > 0
        if not (sane and np.abs(self.coefficients).max() <= _STRONGEST):
            raise CalibrationError(
                f"A lens of focal length {self.focal} px and distortion {self.coefficients} cannot be true; "
                "repeat the canvas calibration."
            )

    def straightened(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where things seen at `pixels` [n, 2] (column, row) would be seen without distortion.

        Not a number where this lens shows nothing there.
        """
        # cv2.undistortPoints stops up to 0.006 px short where a lens is strong, and gives no sign of it.
        straight = np.array(pixels, np.float64)
        with np.errstate(all="ignore"):
            for _ in range(_ROUNDS):
                straight += pixels - self.bent(straight)
            unseen = ~(np.abs(self.bent(straight) - pixels).max(-1) < _EXACT)
        straight[unseen] = np.nan
        return straight

    def bent(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where things are seen that a lens without distortion would show at `pixels` [n, 2]."""
        x, y = ((pixels - self.middle) / self.focal).T
        k1, k2, p1, p2, k3 = self.coefficients
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        bent_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        bent_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.stack((bent_x, bent_y), -1) * self.focal + self.middle
