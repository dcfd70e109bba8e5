"""Printed paper on the studio's table: what a printer, scissors and a person's hands make of a page.

The studio knows nothing of the page's purpose. It prints, cuts rectangles out, and lays them down, all with errors.
"""

import math
from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from frida_painter.virtual.paint import to_linear
from frida_painter.virtual.tabletop import Checker

_CELL = 0.25  # mm; ink on paper has no finer edges
_PAPER = (0.955, 0.955, 0.965)  # sRGB of printer's paper


@dataclass(frozen=True)
class Printer:
    """Printer with its errors.

    scale: length of a printed millimetre.
    stretch: the same across the page, relative to along it.
    saturation: share of a colour's distance from grey that its inks reach.
    tone [3]: exponents of the channels' light.
    ink: standard deviation of a channel's light, share of it, for each colour by itself.
    hand: standard deviation of a laid piece along x and y in mm; it is turned by as much at its ends.
    seed: of the colours' and the hand's errors.
    """

    scale: float = 1.0
    stretch: float = 1.0
    saturation: float = 1.0
    tone: tuple[float, float, float] = (1.0, 1.0, 1.0)
    ink: float = 0.0
    hand: float = 0.0
    seed: int = 0

    @classmethod
    def sample(cls, seed: int) -> Self:
        """Returns a usual printer: 0.3 % off in scale, with its own inks; pieces are laid to 0.2 mm."""
        random = np.random.default_rng(seed)
        red, green, blue = random.normal(1, 0.12, 3).tolist()
        scale, stretch = random.normal(1, 0.003), random.normal(1, 0.001)
        return cls(scale, stretch, random.uniform(0.8, 1.0), (red, green, blue), 0.12, 0.2 / math.sqrt(2), seed)

    def print(self, page: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Returns the linear reflectance of a printed page [rows, columns, 3], sRGB bytes."""
        random = np.random.default_rng((self.seed, 1))
        number = page.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
        colors, place = np.unique(number, return_inverse=True)
        light = to_linear(np.stack([colors >> 16, colors >> 8 & 255, colors & 255], 1) / 255)
        grey = light.mean(1, keepdims=True)
        light = np.clip(grey + self.saturation * (light - grey), 0, 1) ** np.array(self.tone)
        light *= np.where(light < 0.99, random.normal(1, self.ink, light.shape), 1)  # no ink on white
        ink = 0.012 + (1 - 0.012) * np.clip(light, 0, 1)  # no ink is quite black
        return (ink * to_linear(np.array(_PAPER)))[place.ravel()].reshape(page.shape).astype(np.float32)

    def lay(
        self, page: NDArray[np.float32], dots: float, box: tuple[float, float, float, float],
        point: tuple[float, float], at: tuple[float, float], turn: float = 0.0,
    ) -> Checker:  # fmt: skip
        """Returns a rectangle of a printed page on the table.

        dots: of the page per millimetre.
        box: left, top, right and bottom, mm on the page; the scissors follow it.
        point, at: a place on the page (mm), and where on the canvas's plane (mm) the person puts it.
        """
        number = np.random.default_rng((self.seed, 2, *(round(each) for each in box)))
        left, top, right, bottom = box
        rows, columns = (slice(round(low * dots), round(high * dots)) for low, high in ((top, bottom), (left, right)))
        shape = round((right - left) / _CELL), round((bottom - top) / _CELL * self.stretch)
        looks = np.asarray(cv2.resize(page[rows, columns], shape, interpolation=cv2.INTER_AREA), np.float32)
        x, y = number.normal(0, self.hand, 2) + np.array(at)
        turn += float(number.normal(0, self.hand)) / ((right - left) / 2)
        middle = self.scale * np.array([(left + right) / 2 - point[0], self.stretch * (point[1] - (top + bottom) / 2)])
        cos, sin = math.cos(turn), math.sin(turn)
        center = np.array([x, y]) + np.array([[cos, -sin], [sin, cos]]) @ middle
        return Checker((float(center[0]), float(center[1])), turn, self.scale * (right - left), looks)
