"""Scenery of a place, drawn in perspective: hills, ways and water, and the trees, houses or stalls along them."""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from frida_painter import images
from frida_painter.drawing.appearance import in_weather
from frida_painter.drawing.compositing import crop, resize
from frida_painter.drawing.lights import Color, color_of
from frida_painter.drawing.places import NOWHERE, Place, PlaceLayer, Setting, known_dressings, known_places, with_layers
from frida_painter.drawing.tables import read_lines
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.objectives.picture_library import Captioned

_Points = Sequence[tuple[float, float]] | npt.NDArray[np.float64]


class Stand(NamedTuple):
    """Thing that stands in rows in a place: its words, main colour, height and shapes, as `scenery.txt` explains."""

    words: tuple[str, ...]
    color: Color
    height: float
    shapes: tuple[tuple[str, ...], ...]

    @property
    def name(self) -> str:
        """Name for messages."""
        return self.words[0]

    @property
    def is_indoors(self) -> bool:
        """True if rooms have such a thing."""
        return self.is_in("hung", "line", "walls", "near", "litter")

    @property
    def is_furniture(self) -> bool:
        """True if it only stands about in rooms, as one thing of many kinds."""
        return self.is_in("near", "litter") and not self.is_in("hung", "line", "walls")

    def is_in(self, *kinds: str) -> bool:
        """Returns True if a room has it in a layer of these kinds."""
        rooms = [place.layers for place in known_places() if not place.is_open]
        rooms += [dressing.indoors for dressing in known_dressings()]
        return any(self.name in layer.names and layer.kind in kinds for room in rooms for layer in room)

    @property
    def has_glass(self) -> bool:
        """True if it has windows."""
        return any("*" in shape for shape in self.shapes)

    @property
    def usual(self) -> str:
        """Usual place of such a thing, for the weather on it."""
        return "plant" if self.shapes[-1][0] == "dabs" else "ground"


@cache
def stands(table: str = "scenery.txt") -> dict[str, Stand]:
    """Returns a table of drawn things, by their names."""
    found = {}
    for head, _, shapes in (line.partition(": ") for line in read_lines(f"drawing/{table}")):
        words, color, height = head.rsplit(" ", 2)
        drawn = tuple(tuple(shape.split()) for shape in shapes.split(";"))
        stand = Stand(tuple(words.split(", ")), color, float(height), drawn)
        found[stand.name] = stand
    return found


@cache
def stand_words() -> frozenset[str]:
    """Returns all words for the things of `scenery.txt`."""
    return frozenset(word for stand in stands().values() for word in stand.words)


_CALLED = 0.8  # similarity above which a name means a stand
_WORTH = 0.7  # realism of a drawing, between those of photographs and of other drawings
_BETTER = 1.5  # the same for drawings of things without a good picture


def find_stand(name: str, sentences: SentenceEncoder, place: Place = NOWHERE) -> Stand | None:
    """Returns the stand of most similar meaning to a name, with as many of its words as possible; None for none.

    Lit shop windows are shop windows. Of equal ones that of the place counts: chimneys of a factory, or of roofs.
    """
    known = sorted(
        stands().values(), key=lambda stand: stand.name not in [name for layer in place.layers for name in layer.names]
    )
    owners = [(stand, word) for stand in known if not stand.is_furniture for word in stand.words]
    words = name.split()
    anchors = sentences.embed([word for _, word in owners])
    for first in range(len(words)):
        similarity, best = (anchors @ sentences.embed([" ".join(words[first:])])[0]).max(0)
        if float(similarity) >= _CALLED:
            return owners[int(best)][0]
    return None


_LOW = 0.65  # height below which stands cover a land
_FREE = (0.5, 0.2, 0.8)  # places on a wall


def is_tree(name: str) -> bool:
    """Returns True if a drawn thing is a tree."""
    stand = stands()[name]
    is_called = any(word.endswith(" tree") for word in stand.words)  # a fir has no leaves that bend
    return (stand.usual == "plant" or is_called) and stand.height >= _LOW


def trees_of(place: Place) -> list[str]:
    """Returns the names of the trees that grow in a place."""
    names = (name for layer in place.layers if layer.kind not in ("falls", "far", "near") for name in layer.names)
    return list(dict.fromkeys(name for name in names if is_tree(name)))


def is_wood(place: Place) -> bool:
    """Returns True if trees grow all over a place."""
    return any(layer.kind in ("grove", "field") and any(map(is_tree, layer.names)) for layer in place.layers)


def plant(place: Place, trees: Sequence[str], color: Color = "") -> Place:
    """Returns the place with other trees for all of its own: a birch forest, a lake in the jungle."""

    def planted(layer: PlaceLayer, number: int) -> PlaceLayer:
        is_planted = layer.kind in ("line", "sides", "grove", "field") and all(is_tree(name) for name in layer.names)
        return layer._replace(what=trees[number % len(trees)], color=color) if is_planted else layer

    return with_layers(place, [planted(layer, number) for number, layer in enumerate(place.layers)])


def line_with(place: Place, stand: Stand, color: Color = "") -> Place:
    """Returns the place with another thing beside its way, on its wall, or all over its land, in that colour."""
    if stand.is_indoors == place.is_open:  # the houses have windows, and the stairs are in a house
        return place
    if stand.name in stands() and is_tree(stand.name) and is_wood(place):
        return plant(place, [stand.name], color)
    same = [layer for layer in place.layers if stand.name in layer.names]
    kinds = ("sides", "walls", "grove", "field", "strewn")
    window = next((one for one in place.layers if one.what == "window"), None)
    old = next((layer for layer in (*same, *place.layers) if layer in same or layer.kind in kinds), None)
    taken = [layer.x for layer in place.layers if layer.kind == "hung"]
    has_fronts = (
        not same and old is not None and old.kind == "walls" and "panes" not in {one[0] for one in stand.shapes}
    )
    if has_fronts:  # lamps in front of the houses
        old, new = None, PlaceLayer("sides", stand.name, 0.7)
    elif old is not None and (place.is_open or same):
        usual = {stand.usual, *(stands()[name].usual for name in old.names)}
        is_mixed = old.kind == "sides" and "plant" not in usual and not color
        what = old.what if same else f"{old.what}+{stand.name}"
        new = old._replace(what=what if is_mixed else stand.name)
    elif window is not None and "curtain" in stand.name:
        new = window._replace(what=stand.name, size=1.1 * window.size)
    elif not place.is_open:
        x = max(_FREE, key=lambda x: min((abs(x - one) for one in taken), default=1))
        new = PlaceLayer("hung", stand.name, 0.44, x=x, y=0.5 * place.horizon + 0.22)
    elif stand.usual == "plant" and place.kind != "water":
        new = PlaceLayer(*("strewn", stand.name, 1.0) if stand.height < _LOW else ("grove", stand.name, 0.6))
    elif stand.height < _LOW:
        new = PlaceLayer("sides", stand.name, 1.0)
    else:
        new = PlaceLayer("line", stand.name, 0.25 * max(1.0, stand.height))
    layers = [layer for layer in place.layers if layer != old and (layer not in same or not color)]
    return with_layers(place, [*layers, new._replace(color=color)])


# Drawing of one stand.

_UNIT, _WIDE, _HIGH = 240, 2.7, 1.12  # pixels of its height, and the extent of the sheet in heights
_ROUND = 0.22  # share of its brightness by which foliage differs from its lit side to its shade
_SPECKS = 0.09  # the same at random
_GLASS, _LIT_GLASS = "#7b95a8", "#ffd980"
_DUSK = 0.8  # brightness of a setting below which windows are lit
_BOOKS = ("#8c3f38", "#3f6280", "#c9a34a", "#4f7550", "#6b4a6b", "#d9c9a6", "#a8683a")
_TONES = {"@": 1.0, "-": 0.8, "+": 1.25}
_AUTUMN = ("#d9772b", "#e0a02f", "#b8502a", "#c9912f")


def draw_stand(stand: Stand, setting: Setting, seed: int) -> Tensor:
    """Returns a drawn stand in the light, season and weather of a setting, as colour and opacity [4, h, w]."""
    colors = stand.color.split("/") if isinstance(stand.color, str) else [stand.color]
    stand = _in_season(stand._replace(color=colors[seed % len(colors)]), setting)
    chance = np.random.default_rng(seed)
    shade = setting.light.shade.clamp(max=1.0).numpy()
    is_lit = float(shade.mean()) < _DUSK
    main = color_of(stand.color).numpy() * chance.uniform(0.92, 1.08)
    sheet = np.zeros((round(_HIGH * _UNIT), round(_WIDE * _UNIT), 4), np.float32)

    def pixels(points: _Points) -> npt.NDArray[np.int32]:
        return np.array([((x + _WIDE / 2) * _UNIT * 16, (1.06 - y) * _UNIT * 16) for x, y in points]).astype(np.int32)

    def paint(color: str, tone: float = 1.0) -> tuple[float, ...]:
        shines, color = color[0] == "!", color.lstrip("!")
        if color in ("*", "sky"):
            sky = color_of(setting.light.low).numpy() if color == "sky" else color_of(_GLASS).numpy() * shade
            glass = color_of(_LIT_GLASS).numpy() if color == "*" and is_lit and chance.random() < 0.7 else sky
            return (*glass.tolist(), 1.0)
        plain = main * _TONES[color] if color in _TONES else color_of(color).numpy()
        opacity = int(color[7:9] or "ff", 16) / 255
        return (*np.clip(plain * (1 if shines else shade) * tone, 0, 1).tolist(), opacity)

    for kind, color, *rest in stand.shapes:
        points = [(float(x), float(y)) for x, y in (one.split(",") for one in rest if "," in one)]
        numbers = [float(one) for one in rest if "," not in one]
        if kind == "area":
            cv2.fillPoly(sheet, [pixels(points)], paint(color), shift=4)
        elif kind == "line":
            cv2.polylines(
                sheet, [pixels(points)], isClosed=False, color=paint(color), shift=4,
                thickness=max(1, round(numbers[0] * _UNIT)),
            )  # fmt: skip
        elif kind == "dabs":
            for away, turn in zip(
                np.sqrt(chance.random(int(numbers[0]))), 2 * np.pi * chance.random(int(numbers[0])), strict=True
            ):
                across, up = away * math.cos(turn), away * math.sin(turn)
                spot = points[0][0] + across * points[1][0], points[0][1] + up * points[1][1]
                tone = 1 + _ROUND * (0.6 * up - 0.4 * across) + _SPECKS * chance.standard_normal()
                radius = round(numbers[1] * chance.uniform(0.75, 1.2) * _UNIT * 16)
                cv2.circle(sheet, pixels([spot])[0].tolist(), radius, paint(color, tone), -1, shift=4)
        else:
            (left, low), (right, high), (columns, rows) = points[0], points[1], map(int, numbers)
            wide, tall = (right - left) / columns, (high - low) / rows
            for row, column in np.ndindex(rows, columns):
                x, y = left + (column + 0.14) * wide, low + (row + 0.12) * tall
                one = str(chance.choice(_BOOKS)) if color == "books" else color
                corners = [(x, y), (x + 0.72 * wide, y), (x + 0.72 * wide, y + 0.76 * tall), (x, y + 0.76 * tall)]
                cv2.fillPoly(sheet, [pixels(corners)], paint(one), shift=4)
    drawn = crop(resize(torch.from_numpy(sheet).permute(2, 0, 1), 0.5))
    return in_weather(drawn, setting.weather, stand.usual)


def _in_season(stand: Stand, setting: Setting) -> Stand:
    """Returns the stand in the season of a setting: without leaves in winter, and in their colours in autumn."""
    if stand.name == "tree" and (setting.weather.flakes or "winter" in setting.light.name):
        return stands()["bare tree"]
    red, green, blue = color_of(stand.color).tolist()
    if "autumn" in setting.light.name and green > max(red, blue) and stand.usual == "plant":
        return stand._replace(color=_AUTUMN[len(stand.name) % len(_AUTUMN)])
    return stand


# A place in perspective.

_FINE = 2  # the scenery is drawn that much larger, for smooth edges
_FARTHEST = 14.0  # distance of the end of a way; 1 at the lower edge of the canvas
_HAZE = 0.42  # share of the horizon's light in far things
_ALONG = (6.2, 4.3, 3.1, 2.2, 1.6, 1.18)  # distances of the things along a way
_FRONTS = (5.6, 4.0, 2.9, 2.1, 1.5, 1.08, 0.78, 0.5, 0.3)  # distances of the edges of house fronts
_ROWS = (6.4, 4.9, 3.8, 3.0, 2.4, 1.9, 1.5, 1.2, 0.98)  # of the rows of a field
_VERGE = 0.35  # space between a way and the things along it
_PAVED, _NARROWEST = 1.4, 0.55  # width of a street with its pavements, by that of its road; and the least
_KINDS = 3  # number of different drawings of a stand
_WINDING = {"way": 0.3, "stream": 0.45}  # greatest shift of the middle of a way, which a road has not

_SHINY, _ROUGH = 0.5, 0.012  # strength of reflections in water; their shift by ripples, of the width
_BEAM = 0.45  # opacity of light that comes in by a window
_ABOVE = ("planks", "field", "grove", "strewn", "sides", "litter", "falls", "bridge",
          "near")  # kinds that no water mirrors  # fmt: skip
_BODY, _LOWEST, _HIGHEST = 0.12, 0.09, 0.14  # radius of the sun and the moon; height when low, and depth when high


class View:
    """View of a place in perspective, on a picture that grows from back to front.

    ground: [3, H, W], without scenery
    """

    def __init__(self, ground: Tensor, setting: Setting, seed: int) -> None:
        self._setting, self._chance = setting, np.random.default_rng(seed)
        _, rows, columns = ground.shape
        self._rows, self._columns, self._size = rows * _FINE, columns * _FINE, (rows, columns)
        fine = images.fit(ground, self._rows, self._columns)
        self._sheet: npt.NDArray[np.float32] = np.ascontiguousarray(fine.permute(1, 2, 0).numpy(), np.float32)
        self._horizon, self._turn = setting.place.horizon, 1 if seed % 2 else -1
        widths = [layer.size for layer in setting.place.layers if layer.kind in ("way", "road", "rails", "stream")]
        is_street = bool(widths) and setting.place.has("walls")
        self._edge = max(_PAVED * widths[0], _NARROWEST) if is_street else max(widths, default=0.65) + _VERGE
        self._low = color_of(setting.light.low).numpy()
        self._wet = np.zeros(self._sheet.shape[:2], np.float32)  # strength of the reflections
        if setting.place.kind == "water" and not setting.place.has("stream", "canal"):
            self._wet[round(self._horizon * self._rows) :] = _SHINY * (0.3 if setting.place.has("waves") else 1)

    @property
    def picture(self) -> Tensor:
        """The picture [3, H, W]."""
        drawn = torch.from_numpy(self._sheet).permute(2, 0, 1).clamp(0, 1)
        return images.fit(drawn, *self._size)

    def draw(self, layer: PlaceLayer) -> None:
        """Draws a layer of a place."""
        drawers: dict[str, Callable[[PlaceLayer], None]] = {
            "hills": self._draw_hills, "band": self._draw_band, "way": self._draw_way,
            "road": self._draw_way, "stream": self._draw_way, "canal": self._draw_way, "waves": self._draw_waves,
        }  # fmt: skip
        if layer.kind in drawers:
            drawers[layer.kind](layer)
        else:
            several = [stands()[name] for name in layer.names or ["peak"]]
            several = [one._replace(color=layer.color) for one in several] if layer.color else several
            stand, kinds = several[0], _KINDS * len(several)
            drawn = [draw_stand(several[number % len(several)], self._setting, number) for number in range(kinds)]
            for number, (x, y, height, far) in enumerate(self._spots(layer, stand, drawn[0])):
                picture = drawn[number % kinds]
                height *= several[number % len(several)].height / stand.height
                self._lay(picture.flip(2) if number % 2 and layer.kind != "hung" else picture, x, y, height, far)
            for far, near in pairwise(_FRONTS) if layer.kind == "walls" else ():
                for side in (-1, 1):
                    self._raise_front(drawn[self._chance.integers(kinds)], side, near, far, layer.size * stand.height)

    def _spots(self, layer: PlaceLayer, stand: Stand, drawn: Tensor) -> Iterator[tuple[float, float, float, float]]:
        """Yields the places of stands in a layer, from back to front: foot, height, and distance."""
        tall, slim = layer.size * stand.height, drawn.shape[2] / drawn.shape[1] * self._rows / self._columns
        if layer.kind == "line":
            x, far = -0.3 * slim * layer.size, _FARTHEST / 2 if layer.y < self._horizon else 1.0
            while x < 1.1:
                size = layer.size * self._chance.uniform(0.75, 1.1)
                yield x, max(layer.y, self._horizon + 0.01), size, far
                x += slim * size * self._chance.uniform(0.72, 1.05)
        elif layer.kind == "peaks":
            for number in self._chance.permutation(5):
                x = (number + 0.5 + self._chance.uniform(-0.25, 0.25)) / 5
                yield x, self._horizon + 0.02, layer.size * self._chance.uniform(0.6, 1.0), 5
        elif layer.kind == "sides":
            for far in _ALONG:
                for side in (-1, 1):
                    x, y = self._at(side * self._edge * self._chance.uniform(0.98, 1.12), far)
                    yield x, y, tall / far * self._chance.uniform(0.9, 1.1), far
        elif layer.kind == "field":
            step = max(0.3, 2.4 * slim * tall)
            for far in _ROWS:
                for number in range(-math.ceil(far / step), math.ceil(far / step) + 1):
                    x, y = self._at((number + 0.5) * step, far)
                    yield x, y, tall / far, far
        elif layer.kind == "strewn":
            for far in np.geomspace(7.0, 0.95, 130):
                x, y = self._at(far * self._chance.uniform(-1.1, 1.1), far)
                yield x, y, tall / far * self._chance.uniform(0.8, 1.2), far
        elif layer.kind == "litter":
            for far, x in zip(np.geomspace(3.2, 1.06, 22), self._chance.permutation(22), strict=True):
                yield (x + 0.5) / 22, self._at(0, far)[1], tall / far, far
        elif layer.kind == "grove":
            for far in np.geomspace(5.5, 1.05, 18):
                side = self._chance.choice((-1, 1)) * self._chance.uniform(0.4 if far < 3 else 0, 1.15)
                x, y = self._at(side * far, far)
                yield x, y, tall / far * self._chance.uniform(0.8, 1.15), far
        else:
            far = _FARTHEST / 4 if layer.kind == "far" else 1.0
            high = layer.y - self._horizon if layer.kind in ("planks", "rails") else layer.size
            yield 0.5 + self._turn * (layer.x - 0.5), layer.y, high, far

    def _at(self, across: float, far: float) -> tuple[float, float]:
        """Returns the place on the canvas, in its width and height, of a point of the land."""
        return 0.5 + across / (2 * far), self._horizon + (1 - self._horizon) / far

    def _color(self, color: Color, far: float, tone: float = 1.0) -> npt.NDArray[np.float32]:
        """Returns a colour in the setting's light, and hazy in the distance."""
        lit = np.clip(color_of(color).numpy() * self._setting.light.shade.numpy() * tone, 0, 1)
        return np.asarray(lit + self._haze(far) * (self._low - lit), np.float32)

    def _haze(self, far: float) -> float:
        """Returns the share of the horizon's light at a distance."""
        return _HAZE * (1 - 1 / max(far, 1.0)) if self._setting.place.is_open else 0.0

    def _fill(self, color: Color, points: _Points, far: float, tone: float = 1.0) -> None:
        """Fills an area, whose points are in the canvas's width and height."""
        pixels = (np.array(points) * (self._columns, self._rows) * 16).round().astype(np.int32)
        cv2.fillPoly(self._sheet, [pixels], self._color(color, far, tone).tolist(), cv2.LINE_8, 4)

    def _mask(self, points: _Points) -> npt.NDArray[np.bool_]:
        """Returns the pixels of an area, whose points are in the canvas's width and height."""
        mask = np.zeros(self._wet.shape, np.uint8)
        pixels = (np.array(points) * (self._columns, self._rows)).round().astype(np.int32)
        cv2.fillPoly(mask, [pixels], 1)
        return np.asarray(mask > 0)

    def _shine(self, color: Color, opacity: npt.NDArray[np.floating]) -> None:
        """Lays a light of a colour over the picture, with an opacity [H, W]."""
        self._sheet += np.float32(opacity[..., None]) * (color_of(color).numpy() - self._sheet)

    def draw_sky(self) -> None:
        """Draws the sun or the moon of the setting's light with its glow, and the clouds of its weather."""
        light, weather = self._setting.light, self._setting.weather
        if light.body:
            low = self._horizon - _LOWEST - 0.55 * self._setting.place.relief
            up, sides = low if light.body == "low" else _HIGHEST, np.indices(self._wet.shape, np.float32)
            down, across = sides[0] - up * self._rows, sides[1] - (0.5 + 0.12 * self._turn) * self._columns
            away = np.hypot(down, across) / (_BODY * self._rows)
            self._shine(light.accent, 0.7 * np.exp(-((away / 2.2) ** 2)))
            self._shine("#fffbe6", np.clip(8 * (1 - away), 0, 1))
        gray = (color_of(light.top) + color_of(light.low)).tolist()
        cloud = stands()["cloud"]._replace(color=(gray[0] / 2, gray[1] / 2, gray[2] / 2))
        for number in range(weather.clouds):
            x, y = (number + self._chance.uniform(0.1, 0.9)) / weather.clouds, self._chance.uniform(0.2, 0.65)
            self._lay(
                draw_stand(cloud, self._setting, number), x, y * self._horizon, self._chance.uniform(0.16, 0.3), 1
            )

    def wet_ground(self) -> None:
        """Mirrors what is above water and wet ground in them, with ripples; rain has left puddles."""
        is_wet = self._setting.weather.wet and self._setting.place.kind == "land"
        for far in np.geomspace(4.5, 1.15, 7) if is_wet else ():
            around, (x, y) = np.linspace(0, 2 * np.pi, 30), self._at(self._chance.uniform(-0.5, 0.5) * self._edge, far)
            ring = [(x + 0.17 / far * math.cos(turn), y + 0.06 / far * math.sin(turn)) for turn in around]
            self._wet[self._mask(ring)] = 0.8
        if not self._wet.any():
            return
        down, across = np.indices(self._wet.shape, np.float32)
        shore = np.argmax(self._wet > 0, 0)[None].astype(np.float32)  # first row of water in each column
        ripple = _ROUGH * self._columns * np.sin(down * (90 / self._rows) + 3 * np.sin(down * (31 / self._rows)))
        mirrored = cv2.remap(
            self._sheet, (across + ripple).astype(np.float32), 2 * shore - down,
            cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT,
        )  # fmt: skip
        mirrored = mirrored + 0.4 * (color_of(self._setting.light.top).numpy() - mirrored)  # and of the sky above
        self._sheet = np.asarray(self._sheet + self._wet[..., None] * (mirrored - self._sheet), np.float32)

    def _draw_waves(self, layer: PlaceLayer) -> None:
        high = layer.size * (1 + 1.5 * self._setting.weather.wind)
        for far in np.geomspace(5.5, 1.0, 7):
            along, y = np.linspace(0, 1, 160), self._at(0, far)[1] + 0.3 * high / far
            peak = 1 - np.abs(np.sin(np.pi * (1.6 * far**0.8 * along + self._chance.uniform(0, 1))))
            top = y - high / far * peak
            foam = top + 0.3 * high / far * np.clip(2.4 * peak - 0.8, 0.08, 1.3)
            for color, edge in (("#f2f8fb", top), (layer.color, foam)):
                self._fill(color, [*zip(along, edge, strict=True), (1, 1.1), (0, 1.1)], far, 1.05 - 0.25 / far)

    def light_up(self) -> None:
        """Draws the light that comes in by the windows of a room: a beam to the floor and a bright spot on it."""
        light, top = self._setting.light, self._horizon + 0.06
        color = "#fff3c4" if light.accent == "white" else light.accent
        windows = [one for one in self._setting.place.layers if one.what == "window" and one.kind == "hung"]
        for one in windows if float(light.shade.mean()) > _DUSK else ():
            x, wide = 0.5 + self._turn * (one.x - 0.5), 0.3 * one.size
            at = x + (0.3 if x < 0.5 else -0.3)
            floor = [(at - wide, top), (at + wide, top), (at + 1.5 * wide, 0.94), (at - 1.5 * wide, 0.94)]
            beam = [(x - wide, one.y - one.size), (x + wide, one.y - one.size), *floor[1:], (x - wide, one.y)]
            for points, share in ((beam, 0.5 * _BEAM), (floor, _BEAM)):
                self._shine(
                    color, share * cv2.GaussianBlur(self._mask(points).astype(np.float32), (0, 0), 0.01 * self._rows)
                )

    def _lay(self, picture: Tensor, x: float, y: float, height: float, far: float) -> None:
        """Lays a picture [4, h, w] on its place, hazy in the distance; parts outside the canvas are cut off."""
        drawn = resize(picture, max(2.0, height * self._rows) / picture.shape[1]).permute(1, 2, 0).numpy()
        tall, wide, _ = drawn.shape
        top, left = round(y * self._rows) - tall, round(x * self._columns - wide / 2)
        part = drawn[max(0, -top) : max(0, self._rows - top), max(0, -left) : max(0, self._columns - left)]
        if part.size:
            top, left = max(0, top), max(0, left)
            under = self._sheet[top : top + part.shape[0], left : left + part.shape[1]]
            haze = self._haze(far)
            under += part[..., 3:] * ((1 - haze) * part[..., :3] + haze * self._low - under)

    def _raise_front(self, picture: Tensor, side: int, near: float, far: float, height: float) -> None:
        """Lays a picture [4, h, w] as the front of a house along a way, from a near to a far distance."""
        edge = side * (self._edge - 0.1)
        drawn = picture.permute(1, 2, 0).numpy()
        drawn = np.concatenate((drawn[..., :3] * drawn[..., 3:], drawn[..., 3:]), 2)
        tall, wide, _ = drawn.shape
        corners = [
            (x * self._columns, (y - up * height / away) * self._rows)
            for away in (near, far)
            for x, y in [self._at(edge, away)]
            for up in (0, 1)
        ]
        source = np.array([(0, tall), (0, 0), (wide, tall), (wide, 0)], np.float32)
        warp = cv2.getPerspectiveTransform(source, np.array(corners, np.float32))
        laid = cv2.warpPerspective(drawn, warp, (self._columns, self._rows), flags=cv2.INTER_AREA)
        tone = 1.0 if side > 0 else 0.82  # the light comes from the left
        haze = self._haze(near)
        color = (1 - haze) * tone * laid[..., :3] + haze * self._low * laid[..., 3:]
        self._sheet = np.asarray(self._sheet * (1 - laid[..., 3:]) + color, np.float32)

    def _lay_flat(self, color: Color, sides: tuple[float, float], fars: tuple[float, float], tone: float = 1.0) -> None:
        """Fills a rectangle on the land, between two sides and two distances."""
        (left, right), (near, far) = sides, fars
        corners = [self._at(*corner) for corner in ((left, near), (right, near), (right, far), (left, far))]
        self._fill(color, corners, near, tone)

    def _draw_hills(self, layer: PlaceLayer) -> None:
        along = np.linspace(0, 1, 80)
        for back in (1.0, 0.6):
            waves = self._chance.uniform(0, 6.3, 3)
            rise = sum(np.sin(along * turn + wave) / turn for turn, wave in zip((4.1, 7.3, 13.0), waves, strict=True))
            top = self._horizon - layer.size * back * np.clip(0.62 + 1.3 * rise, 0.12, 1.1)
            foot = self._horizon + 0.02
            self._fill(layer.color, [*zip(along, top, strict=True), (1, foot), (0, foot)], 9 * back, 0.92 + 0.14 * back)

    def _draw_band(self, layer: PlaceLayer) -> None:
        top, low = self._horizon - 0.02, self._horizon + layer.size * (1 - self._horizon)
        along = np.linspace(1, 0, 60)
        shore = low + 0.012 * np.sin(9 * along + self._chance.uniform(0, 6))
        for color, drop in (("white", 0.02), (layer.color, 0.0)):
            self._fill(color, [(0, top), (1, top), *zip(along, shore + drop, strict=True)], 1.6)
        self._wet[round(self._horizon * self._rows) : round(low * self._rows)] = _SHINY
        self._draw_ripples(lambda _: (0.0, 1.0), self._horizon, low)

    def _draw_ripples(self, extent: Callable[[float], tuple[float, float]], top: float, low: float) -> None:
        """Draws light and dark waves between two heights; `extent` returns the ends of the water at a height."""
        for y in np.sort(self._chance.uniform(top + 0.02, low - 0.01, 24)).tolist():
            (left, right), near = extent(y), y - self._horizon
            wide, thick = min(0.03 + 0.16 * near, right - left), 0.003 + 0.012 * near
            x, tone = self._chance.uniform(left, right - wide), 1.35 if self._chance.random() < 0.6 else 0.75
            ends = [(x, y), (x + wide / 2, y - thick), (x + wide, y), (x + wide / 2, y + thick)]
            self._fill("#7fa9bf", ends, 1.5, tone)

    def _draw_way(self, layer: PlaceLayer) -> None:
        fars, winds = np.geomspace(1, _FARTHEST, 50), self._turn * _WINDING.get(layer.kind, 0.0)

        def edge(far: float, side: float) -> tuple[float, float]:
            return self._at(winds * math.sin(2.2 * (far - 1)) * min(1.0, far - 1) + side * layer.size, far)

        for wide, tone in ((1.12, 0.8), (1.0, 1.0)):
            left, right = ([edge(far, side * wide) for far in fars] for side in (-1, 1))
            self._fill(layer.color, [*left, *right[::-1]], 1.6, tone)
        if self._setting.weather.flakes and layer.kind in ("way", "road"):  # trodden snow
            self._fill(self._setting.weather.color, [*left, *right[::-1]], 1.6, 0.9)
        if layer.kind in ("way", "road"):
            self._wet[self._mask([*left, *right[::-1]])] = 0.6 * self._setting.weather.wet
        for far in np.geomspace(1, 8, 9) if layer.kind == "road" else ():
            self._lay_flat("#f2eee2", (-0.025, 0.025), (far, 1.12 * far))
        if layer.kind in ("stream", "canal"):
            self._wet[self._mask([*left, *right[::-1]])] = _SHINY

            def extent(y: float) -> tuple[float, float]:
                far = (1 - self._horizon) / (y - self._horizon)
                return edge(far, -0.9)[0], edge(far, 0.9)[0]

            self._draw_ripples(extent, self._horizon + 0.04, 1.0)


def draw_scenery(ground: Tensor, setting: Setting, seed: int, absent: Sequence[str] = ()) -> Tensor:
    """Returns a ground [3, H, W] with the scenery of its place.

    absent: nouns of things that must not be seen
    """
    is_lit = bool(setting.light.body or setting.weather.clouds) and setting.place.is_open
    if not setting.place.layers and not is_lit:
        return ground
    view = View(ground, setting, seed)
    if setting.place.is_open:
        view.draw_sky()
    hidden = {stand.name for stand in stands().values() if {*stand.words} & {*absent}}
    layers = [one for one in setting.place.layers if not {*one.names} & hidden]
    for is_above in (False, True):
        for layer in layers:
            if (layer.kind in _ABOVE) == is_above:
                view.draw(layer)
        if not is_above:
            view.wet_ground()
    view.light_up()
    return view.picture


def _is_row(stand: Stand) -> bool:
    """Returns True if a stand is drawn for rows of it."""
    return stand.usual == "plant" and stand.height < _LOW and stand.name in stands()


class DrawnScenery:
    """Library of the drawn things outdoors, each by itself: for a prompt with one tree, or a church in a village."""

    name, credit, is_own = "drawn", "", False

    def list_captioned(self) -> Sequence[Captioned]:
        """Returns the things of `scenery.txt` and `things.txt`, once for each of their words."""
        drawn = [
            (stand, word)
            for stand in self._known().values()
            for word in stand.words
            if not stand.is_indoors and (stand.name in word or not _is_row(stand))  # a field of tulips is none of them
        ]
        return [Captioned(stand.name, (word,), _WORTH if stand.name in stands() else _BETTER) for stand, word in drawn]

    def pictures(self, file: str) -> list[Tensor]:
        """Returns the drawing of a thing in daylight."""
        return [draw_stand(self._known()[file], Setting(), 0)]

    def _known(self) -> dict[str, Stand]:
        return stands("things.txt") | stands()
