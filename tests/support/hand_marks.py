"""Marks of three families as a person would draw them: one idea of a stroke, with a tremor and an uneven pressure."""

import math

import numpy as np
from numpy.typing import NDArray

from frida_painter_calibration.teaching.marks import TaughtMark

FAMILIES = ("comma", "zigzag", "flourish")
_POINTS = 160
_SIZES = {"comma": 0.032, "zigzag": 0.05, "flourish": 0.09}
Curve = NDArray[np.complex128]


def make_marks(family: str, count: int, seed: int = 0) -> list[TaughtMark]:
    """Returns marks of a family as a person would draw them: each a little different.

    family: one of FAMILIES
    """
    luck = np.random.default_rng([seed, FAMILIES.index(family)])
    return [_draw(family, luck, number) for number in range(count)]


def _draw(family: str, luck: np.random.Generator, number: int) -> TaughtMark:
    t = np.linspace(0, 1, _POINTS)
    curve, press = {"comma": _comma, "zigzag": _zigzag, "flourish": _flourish}[family](t, luck)
    size = float(np.abs(curve[:, None] - curve[None]).max())
    curve = curve / size * _SIZES[family] * math.exp(luck.normal(0, 0.15)) * np.exp(1j * luck.normal(0, 0.15))
    for frequency in (2, 3, 5):  # the tremor of a hand
        wave = luck.normal(0, 0.00025, 2) @ np.array([1, 1j])
        curve = curve + wave * np.sin(2 * np.pi * frequency * t + luck.uniform(0, 2 * np.pi))
    press = np.clip(press * luck.normal(1, 0.05) + 0.03 * np.sin(2 * np.pi * (2 * t + luck.uniform())), 0.03, 1)
    place = np.stack((curve.real, curve.imag), 1)
    return TaughtMark(place, press, seconds=1.5, name=f"{family} {number + 1}")


def _comma(t: NDArray[np.float64], luck: np.random.Generator) -> tuple[Curve, NDArray[np.float64]]:
    """A press that swells, turns and lifts off to a point."""
    turn = luck.normal(1.9, 0.35)
    heading = -turn * t ** luck.normal(1.4, 0.12)
    curve: Curve = np.cumsum(np.exp(1j * heading)).astype(np.complex128) / len(t)
    press = np.clip(1.05 * np.minimum(1, (t + 0.05) / 0.2) * (1 - t) ** 0.8, 0.04, 1)
    return curve, press


def _zigzag(t: NDArray[np.float64], luck: np.random.Generator) -> tuple[Curve, NDArray[np.float64]]:
    """A fill: seven strokes to and fro, each beside the one before."""
    legs = 7
    height = luck.normal(0.55, 0.1)
    leg = np.clip(t * legs, 0, legs - 1e-9)
    share = leg - np.floor(leg)
    share = np.where(np.floor(leg) % 2 == 0, share, 1 - share)
    lean = luck.normal(0.12, 0.05)
    growth = 1 + luck.normal(0, 0.15) * (t - 0.5)
    y = height * growth * (share - 0.5)
    curve: Curve = (t + lean * y + 1j * y).astype(np.complex128)
    smooth = np.ones(9) / 9
    padded = np.r_[[curve[0]] * 4, curve, [curve[-1]] * 4]
    press = np.interp(t, [0, 0.06, 0.94, 1], [0.25, 0.75, 0.7, 0.2])
    curve = np.convolve(padded, smooth, "valid").astype(np.complex128)
    return curve, press


def _flourish(t: NDArray[np.float64], luck: np.random.Generator) -> tuple[Curve, NDArray[np.float64]]:
    """A long calligraphic line: it swings up and down with swelling pressure, more like a bow or more like an S."""
    bow, swing = luck.normal(0.0, 0.5), luck.normal(0.5, 0.4)
    heading = bow * np.cos(np.pi * t) + swing * np.cos(2 * np.pi * t)
    curve: Curve = np.cumsum(np.exp(1j * heading)).astype(np.complex128) / len(t)
    press = 0.15 + 0.75 * np.sin(np.pi * np.clip(t, 0, 1)) ** 1.5
    return curve, press
