"""A sheet for a person's own hand: one stroke to paint, on the canvas as it was last seen."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from frida_painter import images
from frida_painter.frames import CanvasSize

SHEET_ROWS = 720
_MARGIN, _HEAD = 56, 132
_INK, _SOFT, _LINE, _PAPER, _MARK = (35, 33, 30), (110, 104, 95), (205, 200, 191), (250, 248, 244), (196, 52, 36)
_FADED = 0.45
_WIDEST = 0.014  # metres: of the line that stands for the hardest press


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
    def sentence(self) -> str:
        """Where it begins, which way it goes, how long and how hard, in words."""
        (x, y), (end_x, end_y) = self.path[0] * 100, self.path[-1] * 100
        length = 100 * float(np.linalg.norm(np.diff(self.path, axis=0), axis=1).sum())
        with_paint = "" if self.paint is None else f" with paint {self.paint + 1}"
        return (
            f"{self.label.capitalize()}{with_paint}: begin {x:.1f} cm from the left and {y:.1f} cm from the bottom, "
            f"end at {end_x:.1f} and {end_y:.1f} cm; {length:.1f} cm long, {self._hardness}."
        )

    @property
    def _hardness(self) -> str:
        most = float(self.pressure.max())
        words = ("barely touching", "lightly", "with some pressure", "pressed well", "pressed hard")
        return words[min(int(most * len(words)), len(words) - 1)]


def hand_sheet(canvas: CanvasSize, seen: Tensor, done: Sequence[HandStroke], stroke: HandStroke) -> Tensor:
    """The sheet, sRGB [3, h, w] in [0, 1]: the canvas faded, with centimetres around it, and the stroke upon it.

    seen [3, 720, w]: the canvas as it was last seen; done: strokes since then. The stroke begins at its
    ring and ends at its arrow; its line is as wide as it is pressed, which is no scale.
    """
    rows, columns = seen.shape[1:]
    sheet = Image.new("RGB", (columns + 2 * _MARGIN, rows + _HEAD + _MARGIN), _PAPER)
    faded = 1 - (1 - seen) * _FADED
    sheet.paste(Image.fromarray(images.to_uint8(faded)), (_MARGIN, _HEAD))
    draw = ImageDraw.Draw(sheet)
    place = _Place(canvas, rows, columns)
    _ruler(draw, place)
    for before in done:
        _line(draw, place, before, tuple(255 - round(255 * (1 - part) * _FADED) for part in before.color))
    _line(draw, place, stroke, tuple(round(255 * part) for part in stroke.color), outline=True)
    _ends(draw, place, stroke)
    _head(draw, stroke, sheet.width)
    return images.from_uint8(np.asarray(sheet))


@dataclass(frozen=True)
class _Place:
    """Canvas metres on the sheet."""

    canvas: CanvasSize
    rows: int
    columns: int

    @property
    def scale(self) -> float:
        """Pixels per metre."""
        return self.rows / self.canvas.height

    def pixels(self, path: NDArray[np.float64]) -> list[tuple[float, float]]:
        """Points [k, 2] as (column, row)."""
        return [(_MARGIN + x * self.scale, _HEAD + self.rows - y * self.scale) for x, y in path.tolist()]


def _line(
    draw: ImageDraw.ImageDraw, place: _Place, stroke: HandStroke, color: tuple[int, ...], outline: bool = False
) -> None:
    dots = list(
        zip(_densely(place.pixels(stroke.path)), _densely([(part, 0.0) for part in stroke.pressure]), strict=True)
    )
    for grown, fill in ((2.0, _PAPER), (1.0, _INK), (0.0, color)) if outline else ((0.0, color),):
        for (x, y), (pressure, _) in dots:
            radius = max(1.5, place.scale * _WIDEST * (0.25 + 0.75 * pressure) / 2) + grown
            draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=fill)


def _densely(points: Sequence[tuple[float, float]], parts: int = 8) -> list[tuple[float, float]]:
    """The points with others in between."""
    known = np.array(points)
    at = np.linspace(0, len(known) - 1, parts * (len(known) - 1) + 1)
    return [(float(np.interp(t, range(len(known)), known[:, 0])), float(np.interp(t, range(len(known)), known[:, 1])))
            for t in at]  # fmt: skip


def _ends(draw: ImageDraw.ImageDraw, place: _Place, stroke: HandStroke) -> None:
    """A ring where it begins and an arrow where it ends."""
    points = place.pixels(stroke.path)
    x, y = points[0]
    for radius, color, width in ((13, _PAPER, 7), (12, _MARK, 4)):
        draw.ellipse((x - radius, y - radius, x + radius, y + radius), outline=color, width=width)
    tip, before = np.array(points[-1]), np.array(points[max(0, len(points) - 4)])
    along = (tip - before) / max(float(np.linalg.norm(tip - before)), 1e-9)
    aside = np.array([-along[1], along[0]])
    for reach, color in ((4.0, _PAPER), (0.0, _MARK)):
        head = [tip + along * (20 + reach), tip + aside * (12 + reach) - along * reach, tip - aside * (12 + reach)
                - along * reach]  # fmt: skip
        draw.polygon([(float(x), float(y)) for x, y in head], fill=color)


def _ruler(draw: ImageDraw.ImageDraw, place: _Place) -> None:
    """Centimetres from the left and from the bottom."""
    left, top, right, bottom = _MARGIN, _HEAD, _MARGIN + place.columns, _HEAD + place.rows
    draw.rectangle((left - 1, top - 1, right, bottom), outline=_LINE)
    font = ImageFont.load_default(15)
    for axis, length in enumerate((place.canvas.width, place.canvas.height)):
        for centimetre in range(math.floor(100 * length + 1e-6) + 1):
            long = centimetre % 5 == 0
            at = centimetre / 100 * place.scale
            reach = 10 if long else 5
            if axis == 0:
                draw.line((left + at, bottom, left + at, bottom + reach), fill=_SOFT)
                if long:
                    draw.text((left + at, bottom + 13), str(centimetre), fill=_SOFT, font=font, anchor="mt")
            else:
                draw.line((left - reach, bottom - at, left, bottom - at), fill=_SOFT)
                if long:
                    draw.text((left - 14, bottom - at), str(centimetre), fill=_SOFT, font=font, anchor="rm")


def _head(draw: ImageDraw.ImageDraw, stroke: HandStroke, width: int) -> None:
    """The swatch of its paint, its name, and the sentence in two lines."""
    color = tuple(round(255 * part) for part in stroke.color)
    draw.rounded_rectangle((_MARGIN, 24, _MARGIN + 84, 108), 10, fill=color, outline=_LINE, width=2)
    name, _, rest = stroke.sentence.partition(": ")
    where, _, how = rest.partition("; ")
    x = _MARGIN + 104
    draw.text((x, 22), name, fill=_INK, font=ImageFont.load_default(28))
    for row, text in enumerate((where[:1].upper() + where[1:], how[:1].upper() + how[1:])):
        draw.text((x, 60 + 24 * row), text, fill=_SOFT, font=_fitting(draw, text, width - x - 16))


def _fitting(draw: ImageDraw.ImageDraw, text: str, width: int) -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    """The largest legible font in which a text is no wider than that."""
    for size in range(18, 10, -1):
        font = ImageFont.load_default(size)
        if draw.textlength(text, font=font) <= width:
            return font
    return ImageFont.load_default(10)
