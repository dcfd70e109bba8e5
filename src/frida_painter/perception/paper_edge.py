"""The edge of a sheet of paper in a photograph: whether the paper moved since, and whether the picture is sharp.

Every photograph has it, also the first one of a bare sheet, and nobody paints on it.
"""

import math
from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from frida_painter.calibration import Corners
from frida_painter.perception.light import light_of_bytes

_PLACES = 48  # looked at along each side
_MARGIN = 0.06  # of a side, left out at its ends
_FINE = 2  # samples a pixel across the edge
_LEAST_STEP = 0.06  # of linear light, between table and paper
_LEAST_SEEN = 0.5  # of the places of a side
_LEAST_LEFT = 0.2
_DIMMEST = 0.01  # linear light: the camera's noise
_OTHER_LIGHT = 0.3  # natural logarithm of the light beside the edge, against that of all places
_ROUNDS = 6


@dataclass(frozen=True)
class PaperEdge:
    """Where the edge of the paper is seen.

    place, outward [4 x 48, 2]: points (column, row) around the paper and the way out of it; offset
    [4 x 48]: how many pixels outwards of its point the edge lies, NaN where it is not seen; width
    [4 x 48]: pixels within which it passes from a fifth to four fifths of its step, NaN likewise; table
    [4 x 48]: linear light just beyond it; inside [4 x 48]: the same just within it; softness: the median width, NaN
    where it is not visible; visible: whether the edge is seen at most places of every side.
    """

    place: NDArray[np.float64]
    outward: NDArray[np.float64]
    offset: NDArray[np.float64]
    softness: float
    visible: bool
    width: NDArray[np.float64]
    table: NDArray[np.float64]
    inside: NDArray[np.float64]

    @classmethod
    def read(cls, photograph: NDArray[np.uint8], corners: Corners, reach: float) -> Self:
        """Looks within `reach` pixels of the four sides between the corners, which go round clockwise.

        photograph [rows, columns, 3] uint8 sRGB.
        """
        start = np.array(corners, np.float64)
        way = np.roll(start, -1, 0) - start
        outward = np.stack((way[:, 1], -way[:, 0]), 1) / np.linalg.norm(way, axis=1, keepdims=True)
        along = np.linspace(_MARGIN, 1 - _MARGIN, _PLACES)
        place = (start[:, None] + along[:, None] * way[:, None]).reshape(-1, 2)
        outward = np.repeat(outward, _PLACES, 0)
        step = np.arange(-reach, reach + 0.5 / _FINE, 1 / _FINE)
        samples = (place[:, None] + step[:, None] * outward[:, None]).astype(np.float32)
        seen = cv2.remap(
            photograph, samples[..., 0], samples[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        light = light_of_bytes(np.asarray(seen, np.uint8)).mean(2)  # [places, steps]
        light = cv2.blur(light, (_FINE + 1, 1))
        outside = np.median(light[:, -len(step) // 5 :], 1)
        inside = np.median(light[:, : len(step) // 3], 1)
        rise = np.where(np.abs(inside - outside) >= _LEAST_STEP, inside - outside, np.nan)
        height = (light - outside[:, None]) / rise[:, None]  # 0 the table, 1 the paper
        offset, near, far = (_first_above(height, level, step) for level in (0.5, 0.8, 0.2))
        soft = far - near
        visible = bool((np.isfinite(offset).reshape(4, _PLACES).mean(1) >= _LEAST_SEEN).all())
        return cls(
            place, outward, offset, float(np.nanmedian(soft)) if visible else math.nan, visible, soft, outside, inside
        )

    @property
    def beside(self) -> float:
        """How many pixels the farthest corner lies beside where it was looked for; NaN where that cannot be told."""
        return self._motion(self.offset) if self.visible else math.nan

    def moved_since(self, earlier: Self) -> float:
        """By how many pixels the farthest corner moved, of a paper that was seen `earlier` with the same corners.

        Infinite where it is not seen any more, NaN where it was not seen before either.
        """
        if not earlier.visible:
            return math.nan
        if not self.visible:
            return math.inf
        return self._motion(self.offset - earlier.offset)

    def blurring_since(self, earlier: Self) -> float:
        """How many pixels wider the edge is, in the middle of all places; NaN where too little of it is left."""
        wider = self.width - earlier.width
        return float(np.nanmedian(wider)) if _enough(wider) else math.nan

    def covered_since(self, earlier: Self) -> int:
        """At how many places in a row something reaches over the edge that was not there, whatever the light is now."""
        strange = _is_other(self.table, earlier.table, self._brighter_than(earlier))
        longest = run = 0
        for place in np.concatenate((strange, strange)):  # round the paper, over its first corner
            run = run + 1 if place else 0
            longest = max(longest, run)
        return min(longest, len(strange))

    def _brighter_than(self, earlier: Self) -> float:
        """How many times as bright the lamps are as they were, by the table in the middle of all places."""
        return float(np.median((self.table + _DIMMEST) / (earlier.table + _DIMMEST)))

    def _motion(self, outwards: NDArray[np.float64]) -> float:
        """The largest way of a corner under the shift and turn that move the places outwards [n] so."""
        known = np.isfinite(outwards)
        place, outward, outwards = self.place[known], self.outward[known], outwards[known]
        middle = self.place.mean(0)
        scale = float(np.abs(self.place - middle).max())
        arm = (place - middle) / scale
        turning = outward[:, 1] * arm[:, 0] - outward[:, 0] * arm[:, 1]
        terms = np.c_[outward, turning]
        weight = np.ones(len(outwards))
        motion = np.zeros(3)
        for _ in range(_ROUNDS):  # least squares, in which what does not fit counts less and less
            root = np.sqrt(weight)
            motion = np.linalg.lstsq(root[:, None] * terms, root * outwards, rcond=None)[0]
            off = np.abs(terms @ motion - outwards)
            weight = 1 / (1 + (off / (3 * np.median(off) + 0.05)) ** 2) ** 2
        corner = (self.place[:: _PLACES - 1] - middle) / scale
        ways = motion[:2] + motion[2] * np.stack((-corner[:, 1], corner[:, 0]), 1)
        return float(np.linalg.norm(ways, axis=1).max())


def _is_other(light: NDArray[np.float64], earlier: NDArray[np.float64], brighter: float) -> NDArray[np.bool_]:
    """At which places the light is another than it was, the lamps being so many times as bright."""
    share = (light + _DIMMEST) / (earlier + _DIMMEST) / brighter
    return np.asarray(np.abs(np.log(share)) > _OTHER_LIGHT)


def _enough(values: NDArray[np.float64]) -> bool:
    """Whether values [4 x 48] are known at a fifth of the places of three sides, or more."""
    return bool((np.isfinite(values).reshape(4, _PLACES).mean(1) >= _LEAST_LEFT).sum() >= 3)


def _first_above(height: NDArray[np.float64], level: float, step: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where each row of heights, seen from its end, first passes the level, between its samples; NaN for never."""
    backwards = height[:, ::-1]
    above = backwards >= level
    index = above.argmax(1)
    row = np.arange(len(height))
    crossed = above[row, index] & (index > 0)
    before = np.maximum(index - 1, 0)
    low, high = backwards[row, before], backwards[row, index]
    share = (level - low) / np.where(high > low, high - low, 1)
    place = step[::-1][before] + share * (step[::-1][index] - step[::-1][before])
    return np.where(crossed, place, np.nan)
