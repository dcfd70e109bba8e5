"""The studio's colour checker: a card of 24 patches that lies wherever somebody has put it."""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import ConfigError
from frida_painter.virtual.paint import to_linear

# sRGB of the mean of 30 cards that were measured (D. Pascale, BabelColor, 2012; given there as xyY under
# D50), row by row as the card is read.
_PATCHES = (
    (0.458, 0.321, 0.265), (0.780, 0.580, 0.506), (0.358, 0.481, 0.615),
    (0.352, 0.424, 0.254), (0.513, 0.504, 0.687), (0.367, 0.744, 0.674),
    (0.876, 0.488, 0.175), (0.273, 0.361, 0.659), (0.782, 0.328, 0.381),
    (0.362, 0.234, 0.406), (0.625, 0.740, 0.248), (0.905, 0.634, 0.150),
    (0.150, 0.248, 0.577), (0.268, 0.582, 0.288), (0.711, 0.188, 0.222),
    (0.941, 0.784, 0.085), (0.757, 0.330, 0.585), (0.000, 0.530, 0.657),
    (0.963, 0.961, 0.942), (0.787, 0.792, 0.789), (0.630, 0.635, 0.634),
    (0.470, 0.476, 0.475), (0.326, 0.332, 0.334), (0.196, 0.196, 0.199),
)  # fmt: skip
_ACROSS, _DOWN = 6, 4
_CARD_SRGB = (36, 35, 34)
# By how much a printed patch differs from the mean one: standard deviation in each band, share of its light.
_BATCH = 0.006
# The largest card that is sold, mm.
_CLASSIC = 280.0
# The card in units of a patch's side: from patch to patch, and the rim around them.
_PITCH, _RIM = 1.15, 0.32
_CELLS_PER_PATCH = 40


@dataclass(frozen=True)
class Checker:
    """A card on the table. Raises ConfigError where it is not from 30 to 400 mm wide, or lies nowhere.

    center: mm on the canvas's plane; turn: radians counter-clockwise; width: mm of its longer side;
    looks [rows, columns, 3]: linear reflectance, row 0 its upper edge.
    """

    center: tuple[float, float]
    turn: float
    width: float
    looks: NDArray[np.float32]

    def __post_init__(self) -> None:
        if not 30 <= self.width <= 400 or not np.isfinite([*self.center, self.turn]).all():
            raise ConfigError(
                f"A colour checker {self.width} mm wide at {self.center} mm, turned by {self.turn}, was given; it is "
                "30 to 400 mm wide and lies somewhere."
            )

    @classmethod
    def drawn_from(cls, random: np.random.Generator, width: float, height: float) -> Self:
        """A card that suits a canvas of that size (mm), lying on it as somebody in a hurry puts it down."""
        size = float(np.clip(0.62 * min(width, 1.4 * height), 30, _CLASSIC))
        x, y = random.uniform(-0.04, 0.04, 2)
        center = (float(width * (0.5 + x)), float(height * (0.5 + y)))
        return cls(center, float(random.uniform(-0.2, 0.2)), size, _printed(random))

    def laid(self, center: tuple[float, float], turn: float, width: float | None) -> Self:
        """The same card at another place, or one of another width."""
        return replace(self, center=center, turn=turn, width=width or self.width)

    def cells(self) -> NDArray[np.float64]:
        """The affine map [2, 3] from mm on the canvas's plane (x, y, 1) to the card's (column, row)."""
        rows, columns = self.looks.shape[:2]
        cos, sin = math.cos(self.turn), math.sin(self.turn)
        turned = np.array([[cos, sin], [sin, -cos]]) * columns / self.width  # y goes up, rows go down.
        middle = np.array([(columns - 1) / 2, (rows - 1) / 2])
        return np.c_[turned, middle - turned @ self.center]


def _printed(random: np.random.Generator) -> NDArray[np.float32]:
    """How one card looks, [rows, columns, 3]: no two are printed quite alike."""
    side, pitch, rim = _CELLS_PER_PATCH, round(_PITCH * _CELLS_PER_PATCH), round(_RIM * _CELLS_PER_PATCH)
    looks = np.empty(((_DOWN - 1) * pitch + side + 2 * rim, (_ACROSS - 1) * pitch + side + 2 * rim, 3), np.float32)
    looks[:] = to_linear(np.array(_CARD_SRGB) / 255)
    patches = to_linear(np.array(_PATCHES))
    patches *= 1 + random.normal(0, _BATCH, patches.shape)
    for number, reflectance in enumerate(patches):
        top, left = rim + number // _ACROSS * pitch, rim + number % _ACROSS * pitch
        looks[top : top + side, left : left + side] = reflectance
    return looks
