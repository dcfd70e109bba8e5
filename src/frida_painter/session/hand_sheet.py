"""A sheet for a person's own hand: the strokes to paint next, on the canvas as it was last seen."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from torch import Tensor

from frida_painter import images
from frida_painter.frames import CanvasSize
from frida_painter.sheet import CREAM, INK, LINE, SOFT, font

SHEET_ROWS = 720
_SHARP = 2  # drawn so many times larger, and made smaller in the end
_MARGIN, _HEAD = 64, 144
_MARK = (196, 52, 36)
_FADED = 0.4
_LEVELS = ("barely touching", "lightly", "with some pressure", "pressed well", "pressed hard")
_Color = tuple[int, int, int]


@dataclass(frozen=True)
class HandStroke:
    """A stroke as a person paints it.

    label: its name; paint: its number from 0, None where no paint was asked for; color: sRGB in [0, 1];
    path [k, 2]: canvas metres; pressure [k]: 0 the lightest touch, 1 the hardest press.
    """

    label: str
    paint: int | None
    color: tuple[float, float, float]
    path: NDArray[np.float64]
    pressure: NDArray[np.float64]

    @property
    def name(self) -> str:
        """ "Stroke 12"."""
        return self.label.capitalize()

    @property
    def number(self) -> str:
        """ "12"."""
        return self.label.split()[-1]

    @property
    def level(self) -> int:
        """How hard it is pressed at the most, in five steps from 0."""
        return min(int(float(self.pressure.max()) * len(_LEVELS)), len(_LEVELS) - 1)

    @property
    def heading(self) -> tuple[str, str, str]:
        """Its name and paint; where it begins and ends; how long it is, and how hard."""
        (x, y), (end_x, end_y) = self.path[0] * 100, self.path[-1] * 100
        length = 100 * float(np.linalg.norm(np.diff(self.path, axis=0), axis=1).sum())
        return (
            self.name + ("" if self.paint is None else f" with paint {self.paint + 1}"),
            f"Begin {x:.1f} cm from the left and {y:.1f} cm from the bottom, end at {end_x:.1f} and {end_y:.1f} cm.",
            f"{length:.1f} cm long, {_LEVELS[self.level]}.",
        )

    @property
    def sentence(self) -> str:
        """All of it in words."""
        name, where, how = self.heading
        return f"{name}: {where[:1].lower()}{where[1:-1]}; {how}"


def hand_sheet(
    canvas: CanvasSize,
    seen: Tensor,
    done: Sequence[HandStroke],
    strokes: Sequence[HandStroke],
    heading: Sequence[str],
    width: float,
) -> Tensor:
    """The sheet, sRGB [3, h, w] in [0, 1]: the canvas faded, with centimetres around it, and the strokes upon it.

    seen [3, 720, w]: the canvas as it was last seen; done: strokes since then; strokes: one or more to be
    painted, in order; heading: a title and up to three lines; width: of the mark of the hardest press, metres. Each
    stroke begins at its ring and ends at its arrow, and its line is as wide as its mark.
    """
    rows, columns = seen.shape[1:]
    size = (columns + 2 * _MARGIN, rows + _HEAD + _MARGIN)
    sheet = Image.new("RGB", (size[0] * _SHARP, size[1] * _SHARP), CREAM)
    faded = Image.fromarray(images.to_uint8(1 - (1 - seen) * _FADED))
    sheet.paste(
        faded.resize((columns * _SHARP, rows * _SHARP), Image.Resampling.BICUBIC), (_MARGIN * _SHARP, _HEAD * _SHARP)
    )
    pen = _Pen(ImageDraw.Draw(sheet), canvas, rows, columns, width)
    pen.ruler()
    for stroke in done:
        pen.mark(stroke, _FADED)
    for stroke in strokes:
        pen.outline(stroke)
    if len(strokes) == 1:
        pen.guides(strokes[0])
        pen.gauge(strokes[0])
    for stroke in strokes:
        pen.ends(stroke, stroke.number if len(strokes) > 1 else "")
    pen.head(strokes[0].color, heading, room=0 if len(strokes) > 1 else 220)
    return images.from_uint8(np.asarray(sheet.resize(size, Image.Resampling.LANCZOS)))


@dataclass(frozen=True)
class _Pen:
    """Draws on the sheet; lengths and places are pixels of the sheet as it will be, or metres of the canvas."""

    draw: ImageDraw.ImageDraw
    canvas: CanvasSize
    rows: int
    columns: int
    width: float

    @property
    def scale(self) -> float:
        """Pixels per metre."""
        return self.rows / self.canvas.height

    def at(self, point: NDArray[np.float64]) -> tuple[float, float]:
        """A place on the canvas as (column, row)."""
        return _MARGIN + float(point[0]) * self.scale, _HEAD + self.rows - float(point[1]) * self.scale

    def outline(self, stroke: HandStroke) -> None:
        """A stroke in its colour with a dark edge on a light one, seen on any ground."""
        for grown, fill in ((2.5, CREAM), (1.2, INK)):
            self._line(stroke, grown, fill)
        self.mark(stroke)

    def mark(self, stroke: HandStroke, strength: float = 1.0) -> None:
        """A stroke in its colour."""
        self._line(stroke, 0.0, _bytes(stroke.color, strength))

    def _line(self, stroke: HandStroke, grown: float, fill: _Color) -> None:
        for (x, y), pressure in zip(_densely(stroke.path), _densely(stroke.pressure), strict=True):
            radius = max(1.5, self.scale * self.width * (0.25 + 0.75 * float(pressure)) / 2) + grown
            self._disc(self.at(np.array((x, y))), radius, fill)

    def ends(self, stroke: HandStroke, number: str) -> None:
        """A ring where a stroke begins, with its number, and an arrow where it ends."""
        points = [np.array(self.at(point)) for point in stroke.path]
        start, tip = points[0], points[-1]
        before = next((point for point in reversed(points) if float(np.linalg.norm(tip - point)) > 8), start)
        along = (tip - before) / max(float(np.linalg.norm(tip - before)), 1e-9)
        aside = np.array([-along[1], along[0]])
        for reach, color in ((3.0, CREAM), (0.0, _MARK)):
            corners = (tip + along * (24 + 1.6 * reach), *(tip + sign * aside * (13 + reach) for sign in (1, -1)))
            back = tip - along * reach
            self.draw.polygon([self._sharp(corner) for corner in (corners[0], corners[1], back, corners[2])], color)
        begin = (float(start[0]), float(start[1]))
        for radius, color in ((15.0, CREAM), (13.5, _MARK), (10.5, CREAM)) if number else ((15.0, CREAM),):
            self._disc(begin, radius, color)
        if number:
            self._text(begin, number, 14 if len(number) < 3 else 11, INK, "mm")
        else:
            self._disc(begin, 13.5, _MARK)
            self._disc(begin, 9.5, _bytes(stroke.color))

    def guides(self, stroke: HandStroke) -> None:
        """From where a stroke begins to both rulers, and what is read there."""
        x, y = self.at(stroke.path[0])
        bottom = _HEAD + self.rows
        for start, end in (((x, y), (x, bottom)), ((x, y), (_MARGIN, y))):
            self._dashes(start, end)
        for (left, top), metres in (((x, bottom + 23), stroke.path[0][0]), ((_MARGIN - 31, y), stroke.path[0][1])):
            self._box((left - 24, top - 11, left + 24, top + 11), 5, _MARK)
            self._text((left, top), f"{100 * metres:.1f}", 15, CREAM, "mm")

    def gauge(self, stroke: HandStroke) -> None:
        """How hard, in five steps."""
        right = _MARGIN + self.columns
        for level in range(len(_LEVELS)):
            radius = 6.0 + 2.6 * level
            middle = (right - 24 - 38.0 * (len(_LEVELS) - 1 - level), 58.0)
            self._disc(middle, radius, INK if level <= stroke.level else LINE)
        self._text((right - 100, 100), _LEVELS[stroke.level], 16, SOFT, "mm")

    def head(self, color: tuple[float, float, float], heading: Sequence[str], room: int) -> None:
        """The swatch of the paint, a title and its lines, `room` pixels being left free on the right."""
        self._box((_MARGIN, 26, _MARGIN + 92, 118), 12, _bytes(color), LINE)
        left = _MARGIN + 108
        most = _MARGIN + self.columns - left - room
        self._text((left, 20), heading[0], self._fitting(heading[0], most, 30), INK, "la")
        for row, text in enumerate(heading[1:]):
            self._text((left, 60 + 23 * row), text, self._fitting(text, most, 17), SOFT, "la")

    def ruler(self) -> None:
        """Centimetres from the left and from the bottom, every fifth with its number."""
        left, top, right, bottom = _MARGIN, _HEAD, _MARGIN + self.columns, _HEAD + self.rows
        for corners in (((left, top), (right, top)), ((right, top), (right, bottom))):
            self._stroke(*corners, LINE)
        for corners in (((left, top), (left, bottom)), ((left, bottom), (right, bottom))):
            self._stroke(*corners, SOFT)
        for length, across in ((self.canvas.width, True), (self.canvas.height, False)):
            for centimetre in range(math.floor(100 * length + 1e-6) + 1):
                along, fifth = centimetre / 100 * self.scale, centimetre % 5 == 0
                reach = 10 if fifth else 5
                x, y = (left + along, bottom) if across else (left, bottom - along)
                self._stroke((x, y), (x, y + reach) if across else (x - reach, y), SOFT)
                if fifth:
                    place = (x, y + 23) if across else (x - 14, y)
                    self._text(place, str(centimetre), 15, SOFT, "mm" if across else "rm")

    def _disc(self, middle: tuple[float, float], radius: float, fill: _Color) -> None:
        (x, y), r = self._sharp(middle), radius * _SHARP
        self.draw.ellipse((x - r, y - r, x + r, y + r), fill=fill)

    def _box(
        self, corners: tuple[float, float, float, float], round_: float, fill: _Color, line: _Color | None = None
    ) -> None:
        sharp = [value * _SHARP for value in corners]
        self.draw.rounded_rectangle(sharp, round_ * _SHARP, fill=fill, outline=line, width=2 * _SHARP if line else 0)

    def _stroke(self, start: tuple[float, float], end: tuple[float, float], color: _Color) -> None:
        self.draw.line((*self._sharp(start), *self._sharp(end)), fill=color, width=_SHARP)

    def _dashes(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        way = np.array(end) - np.array(start)
        count = max(1, int(float(np.linalg.norm(way)) / 12))
        for dash in range(count):
            near, far = (np.array(start) + way * part / count for part in (dash, dash + 0.6))
            self._stroke((float(near[0]), float(near[1])), (float(far[0]), float(far[1])), _MARK)

    def _text(self, at: tuple[float, float], text: str, size: float, fill: _Color, anchor: str) -> None:
        self.draw.text(self._sharp(at), text, fill=fill, font=font(size * _SHARP), anchor=anchor)

    def _fitting(self, text: str, width: float, largest: int) -> float:
        """The size, no larger than that, in which a text is no wider than `width`."""
        return min(largest, largest * width / max(font(largest).getlength(text), 1.0))

    @staticmethod
    def _sharp(point: Sequence[float] | NDArray[np.float64]) -> tuple[float, float]:
        return float(point[0]) * _SHARP, float(point[1]) * _SHARP


def _densely(values: NDArray[np.float64], parts: int = 4) -> NDArray[np.float64]:
    """Values [k] or [k, 2] with others in between."""
    at, known = np.linspace(0, len(values) - 1, parts * (len(values) - 1) + 1), np.arange(len(values))
    if values.ndim == 1:
        return np.interp(at, known, values)
    return np.stack([np.interp(at, known, column) for column in values.T], 1)


def _bytes(color: tuple[float, float, float], strength: float = 1.0) -> _Color:
    red, green, blue = (round(255 * (1 - (1 - part) * strength)) for part in color)
    return red, green, blue
