"""Charts of measurements: lines with bands or error bars, each named where it ends."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from PIL import Image, ImageDraw
from torch import Tensor

from frida_painter import images
from frida_painter.report.figure_sheet import INK, LINE, PAPER, SOFT, font

_FINER = 3  # drawn so many times larger and then made smaller, which smooths every edge
_WIDTH, _HEIGHT = 940, 540
_LEFT, _RIGHT, _TOP, _BOTTOM = 84, 190, 104, 66
_TITLE, _TEXT, _TICK = 25, 16, 15
# Told apart without colour vision too (Okabe and Ito).
_COLORS = ((0, 114, 178), (213, 94, 0), (0, 138, 100), (171, 92, 150), (98, 93, 85))
_THIN = 48  # opacity of bands, of 255
_INSET = 14  # of the first and last point from the ends of the x axis
_BESIDE = 5.0  # between the error bars of one line and the next
_FEW = 7
_Color = tuple[int, int, int]


@dataclass(frozen=True)
class Series:
    """One line: its name, its points, and how far each may be off.

    low, high: as many as there are points, or none; drawn as a band where `band`, otherwise as
    error bars.
    """

    name: str
    x: Sequence[float]
    y: Sequence[float]
    low: Sequence[float] = field(default=())
    high: Sequence[float] = field(default=())
    band: bool = True


def chart(title: str, x_label: str, y_label: str, series: Sequence[Series], *, logarithmic: bool = False) -> Tensor:
    """Up to five series in one picture [3, 540, 940]; `logarithmic`: the y axis, all values above 0.

    y_label stands above the axis. A linear y axis begins at 0 or below.
    """
    frame = _Frame.around(series, logarithmic)
    sheet = Image.new("RGB", (_WIDTH * _FINER, _HEIGHT * _FINER), PAPER)
    pen = _Pen(ImageDraw.Draw(sheet, "RGBA"), frame)  # bands let each other shine through
    pen.words(_LEFT, 46, title, _TITLE, INK, "ls")
    pen.words(_LEFT, 78, y_label, _TEXT, SOFT, "ls")
    pen.words((_LEFT + _WIDTH - _RIGHT) / 2, _HEIGHT - 16, x_label, _TEXT, SOFT, "ms")
    for value in frame.y_ticks:
        y = frame.down(value)
        pen.line([(_LEFT, y), (_WIDTH - _RIGHT, y)], LINE, 1)
        pen.words(_LEFT - 10, y, f"{value:g}", _TICK, SOFT, "rm")
    for value in frame.x_ticks:
        pen.words(frame.across(value), _HEIGHT - _BOTTOM + 10, f"{value:g}", _TICK, SOFT, "ma")
    colored = list(zip(series, _COLORS, strict=False))
    for one, color in colored:
        if len(one.low) and one.band:
            pen.band(one, color)
    for number, (one, color) in enumerate(colored):
        aside = 0.0 if one.band else _BESIDE * (number - (len(series) - 1) / 2)
        pen.series(one, color, aside)
    for y, (one, color) in zip(_apart([frame.down(one.y[-1]) for one in series]), colored, strict=True):
        pen.words(_WIDTH - _RIGHT + 14, y, one.name, _TEXT, color, "lm")
    small = sheet.resize((_WIDTH, _HEIGHT), Image.Resampling.BOX)
    return images.from_uint8(np.asarray(small))


@dataclass(frozen=True)
class _Frame:
    """Where values lie on the picture."""

    x: tuple[float, float]
    y: tuple[float, float]
    scale: Callable[[float], float]
    x_ticks: tuple[float, ...]
    y_ticks: tuple[float, ...]

    @classmethod
    def around(cls, series: Sequence[Series], logarithmic: bool) -> "_Frame":
        xs = [x for one in series for x in one.x]
        ys = [y for one in series for y in (*one.y, *one.low, *one.high)]
        measured = tuple(sorted(set(xs)))
        x_ticks = measured if len(measured) <= _FEW else _steps(min(xs), max(xs))
        if logarithmic:
            low, high = math.log10(min(ys)), math.log10(max(ys))
            margin = max(0.03, 0.06 * (high - low))
            bounds = low - margin, high + margin
            return cls((min(xs), max(xs)), bounds, math.log10, x_ticks, _decades(*bounds))
        low, high = min(0.0, *ys), max(ys) * 1.06
        return cls((min(xs), max(xs)), (low, high), float, x_ticks, _steps(low, high))

    def across(self, value: float) -> float:
        least, most = self.x
        room = _WIDTH - _RIGHT - _LEFT - 2 * _INSET
        return _LEFT + _INSET + (value - least) / max(most - least, 1e-12) * room

    def down(self, value: float) -> float:
        least, most = self.y
        return _TOP + (most - self.scale(value)) / max(most - least, 1e-12) * (_HEIGHT - _BOTTOM - _TOP)


class _Pen:
    """Draws on the larger sheet in the picture's own pixels."""

    def __init__(self, draw: ImageDraw.ImageDraw, frame: _Frame) -> None:
        self._draw, self._frame = draw, frame

    def words(self, x: float, y: float, text: str, size: int, color: _Color, anchor: str) -> None:
        self._draw.text((x * _FINER, y * _FINER), text, fill=color, font=font(size * _FINER), anchor=anchor)

    def line(self, points: Sequence[tuple[float, float]], color: _Color, width: float) -> None:
        finer = [(x * _FINER, y * _FINER) for x, y in points]
        self._draw.line(finer, fill=color, width=round(width * _FINER), joint="curve")

    def band(self, series: Series, color: _Color) -> None:
        edge = [*self._points(series.x, series.high), *reversed(self._points(series.x, series.low))]
        self._draw.polygon([(x * _FINER, y * _FINER) for x, y in edge], fill=(*color, _THIN))

    def series(self, series: Series, color: _Color, aside: float) -> None:
        points = [(x + aside, y) for x, y in self._points(series.x, series.y)]
        if not series.band:
            ends = zip(self._points(series.x, series.low), self._points(series.x, series.high), strict=False)
            for (x, low), (_, high) in (((a[0] + aside, a[1]), b) for a, b in ends):
                self.line([(x, low), (x, high)], color, 1.4)
                for y in (low, high):
                    self.line([(x - 5, y), (x + 5, y)], color, 1.4)
        self.line(points, color, 2.4)
        if len(points) <= 24:
            for x, y in points:
                self._dot(x, y, color)

    def _dot(self, x: float, y: float, color: _Color) -> None:
        box = [(part + reach) * _FINER for reach in (-3.6, 3.6) for part in (x, y)]
        self._draw.ellipse(box, fill=color, outline=PAPER, width=_FINER)

    def _points(self, x: Sequence[float], y: Sequence[float]) -> list[tuple[float, float]]:
        return [(self._frame.across(a), self._frame.down(b)) for a, b in zip(x, y, strict=True)]


def _steps(least: float, most: float) -> tuple[float, ...]:
    """Round values from `least` to `most`, about five of them."""
    rough = max(most - least, 1e-12) / 5
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(part * power for part in (1, 2, 2.5, 5, 10) if part * power >= rough * 0.999)
    first = math.ceil(least / step - 1e-9)
    return tuple(float(f"{k * step:.9g}") for k in range(first, math.floor(most / step + 1e-9) + 1))


def _decades(least: float, most: float) -> tuple[float, ...]:
    """Round values between two powers of ten, at most about eight of them."""
    for parts in ((1, 2, 5), (1, 1.5, 2, 3, 4, 5, 6, 8)):
        found = [
            float(f"{part * 10.0**decade:.6g}")
            for decade in range(math.floor(least), math.ceil(most) + 1)
            for part in parts
            if least <= math.log10(part) + decade <= most
        ]
        if len(found) >= 4:
            return tuple(found[:: math.ceil(len(found) / 8)])
    return _steps(10.0**least, 10.0**most)


def _apart(wanted: Sequence[float]) -> list[float]:
    """Heights near those wanted at which words do not run into one another."""
    least = _TEXT * 1.35
    order = sorted(range(len(wanted)), key=lambda index: wanted[index])
    placed = list(wanted)
    for _ in range(50):
        for above, below in pairwise(order):
            short = least - (placed[below] - placed[above])
            if short > 0:
                placed[above] -= short / 2
                placed[below] += short / 2
    return placed
