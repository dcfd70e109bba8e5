"""Settings of a scene: a place in a light and a weather, chosen by the meaning of a prompt and painted as a ground.

A ground has depth: a sky or a wall with light on it, land or a table that is darker in front, in loose strokes.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple, TypeVar

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.drawing.brushwork import paint_loosely
from frida_painter.drawing.lights import (
    CLEAR,
    DAY,
    Color,
    Light,
    Weather,
    color_of,
    nearest_part,
)
from frida_painter.drawing.tables import read_rows, split_words
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.palette import from_lab, to_lab

HORIZON = 0.72
"""Usual share of the height above the horizon, or above the edge of a floor or a table."""
_EDGE = 0.03  # share of the height over which two bands blend
_COVERED = 0.88  # share of the land that falling snow covers
_GLEAM = 0.6  # exponent of the shade on snow
_DIM, _FAR = 0.78, 0.30  # factor of a colour away from the light; share of the light at the horizon in far land
_SLANT, _QUIET = 0.35, 0.75  # radians of the strokes of a sky, and their liveliness
SUMMIT = 0.6
"""Share of the height above a hill on which things stand."""
_VALLEY, _BROAD, _STEEP = 0.92, 0.75, 0.2  # foot of that hill; its half width; relief above which it is a cliff
_BANK = 0.79  # share of the height above a bank
_GLOW = 0.85  # least share of a sky's own colour that is left in a low light


class PlaceLayer(NamedTuple):
    """Layer of the scenery of a place: its kind, its things with "+" between them, or "", size and colour.

    `places.txt` explains the kinds. The colour is "" for a thing in its own. x and y: place of the foot of a single
    thing, in the canvas's width and height, or 0.
    """

    kind: str
    what: str
    size: float
    color: Color = ""
    x: float = 0.0
    y: float = 0.0

    @property
    def names(self) -> list[str]:
        """Names of its things."""
        return self.what.split("+") if self.what else []


@dataclass(frozen=True)
class Place:
    """Place of a scene.

    words: words that name it, the first for messages
    found: things that are usually there
    below: colour below the horizon
    kind: "land", "hill" on top of which things can be, "water" on which they float, "room" without a sky, or "paper",
        on which nothing is painted
    above: colour above the horizon; None for the sky of the light
    bank: colour of the land in front of its water
    horizon: share of the height above the horizon, or above the edge of a floor or a table
    layers: its scenery, from back to front
    """

    words: tuple[str, ...]
    found: tuple[str, ...]
    below: Color
    kind: str = "land"
    above: Color | None = None
    bank: Color | None = None
    horizon: float = HORIZON
    layers: tuple[PlaceLayer, ...] = ()

    @property
    def name(self) -> str:
        """Name for messages."""
        return self.words[0]

    @property
    def is_open(self) -> bool:
        """True if there is a sky over it."""
        return self.kind in ("land", "hill", "water")

    @property
    def is_way(self) -> bool:
        """True if it leads through another place: a road, a jetty, a bridge."""
        return self.has(*_WAYS) and not self.has("sides", "walls")

    def has(self, *kinds: str) -> bool:
        """Returns True if it has a layer of one of these kinds."""
        return any(layer.kind in kinds for layer in self.layers)

    @property
    def relief(self) -> float:
        """Height of its hills or mountains, as a share of the height."""
        return max((layer.size for layer in self.layers if layer.kind in ("hills", "peaks")), default=0.0)


@cache
def known_places() -> tuple[Place, ...]:
    """Returns the table of `places.txt`."""
    found = []
    for words, things, land, scenery in read_rows("drawing/places.txt"):
        kind, below, above, bank, horizon = land.split()
        sky, shore = (None if one in ("sky", "-") else one for one in (above, bank))
        some, names = split_words(things), split_words(words)
        found.append(Place(names, some, below, kind, sky, shore, float(horizon), _read_layers(scenery)))
    return tuple(found)


def _read_layers(scenery: str) -> tuple[PlaceLayer, ...]:
    split = [layer.split() for layer in scenery.split(";") if layer]
    return tuple(
        PlaceLayer(name, "" if what[0] == "#" else what.replace("-", " "), float(size),
                   what if what[0] == "#" else "", *map(float, at))
        for name, what, size, *at in split
    )  # fmt: skip


class Dressing(NamedTuple):
    """Layers that an occasion or a state adds to a place, outdoors and in rooms: Christmas, a party, a mess."""

    words: tuple[str, ...]
    outdoors: tuple[PlaceLayer, ...]
    indoors: tuple[PlaceLayer, ...]

    @property
    def name(self) -> str:
        """Name for messages."""
        return self.words[0]


@cache
def known_dressings() -> tuple[Dressing, ...]:
    """Returns the table of `dressings.txt`."""
    return tuple(Dressing(split_words(words), *map(_read_layers, layers))
                 for words, *layers in read_rows("drawing/dressings.txt"))  # fmt: skip


NOWHERE = Place(("",), (), "white")


def find_place(name: str) -> Place:
    """Returns the place of the table with that name."""
    return next(place for place in known_places() if place.name == name)


_Part = TypeVar("_Part", Place, Light, Weather, Dressing)
_ORDER = ("peaks", "hills", "far", "line", "walls", "band", "waves", "way", "road", "stream", "canal", "platform",
          "rails", "planks", "field", "grove", "strewn", "sides", "litter", "falls", "bridge", "hung",
          "near")  # of layers, from back to front  # fmt: skip
_SEA = 0.25  # share of the land that is the sea behind it
_WAYS = ("way", "road", "rails", "platform", "planks", "bridge")
_KIN = {
    "peaks": "hills",
    "road": "way",
    "grove": "sides",
    "walls": "sides",
    "field": "sides",
    "strewn": "sides",
    "canal": "stream",
}  # other kinds for the same
_CALLED = 0.72  # similarity to a place's words above which words name it
_DRESSED = 0.9  # to those of a dressing: a toy is not yet toys all around
_FELT, _FELT_WEATHER = 0.62, 0.7  # to the words of a light, and of a weather: a snowmobile (0.67) is a thing
_MIDDLE = 55.0  # L*
TOLD_APART = 40.0
"""Lab distance between things and the ground around them."""
_CHANGE = 22.0  # greatest change of the ground's L* for that: sand stays sand


@dataclass(frozen=True)
class Setting:
    """Setting of a scene: place, light and weather.

    is_named: True if words of the prompt ask for it
    is_raised: True if the things stand on its hill, or in front of its water
    """

    place: Place = NOWHERE
    light: Light = DAY
    weather: Weather = CLEAR
    is_named: bool = False
    is_raised: bool = False

    @property
    def words(self) -> str:
        """Description for messages."""
        parts = (self.place.name, *(one.name for one in (self.light, self.weather) if one not in (DAY, CLEAR)))
        return ", ".join(dict.fromkeys(part for part in parts if part))

    def ground(self, grid: PixelGrid, seed: int) -> Tensor:
        """Returns the ground [3, H, W] on the grid, without rain, flakes and stars."""
        rows, columns = grid.rows, grid.columns
        place, shade = self.place, self.light.shade
        land = color_of(place.below) * shade
        if place.kind == "paper":
            return land.clamp(0, 1)[:, None, None].expand(3, rows, columns).contiguous()
        high, low = color_of(self.light.top), color_of(self.light.low)
        if place.above is not None:
            low = color_of(place.above) * (shade.clamp(min=_GLOW) if place.is_open else shade)
            high = torch.lerp(high, low, 0.6) if place.is_open and self.light != DAY else low * _DIM
        if self.weather.flakes and place.kind in ("land", "hill"):  # snow also covers the land, and is light at night
            land = torch.lerp(land, color_of(self.weather.color) * shade**_GLEAM, _COVERED)
        # Water reflects the top of the sky; the glow of a low sun, or of a season, would make it grey.
        if place.kind == "water" and self.light.kind != "season":
            land = torch.lerp(land, high, 0.25)
        down, across = ((torch.arange(side) + 0.5) / side for side in (rows, columns))
        down, across = torch.meshgrid(down, across, indexing="ij")
        # The light comes from the left, and along the horizon.
        along = 0.85 if place.is_open else 0.35
        share = along * (down / place.horizon).clamp(max=1) ** 2 + (1 - along) * (1 - across)
        picture = torch.lerp(high[:, None, None], low[:, None, None], share)
        near = ((down - place.horizon) / (1 - place.horizon)).clamp(0, 1)
        far = torch.lerp(land, low, _FAR if place.is_open else 0.0)
        front = torch.lerp(far[:, None, None], (land * _DIM)[:, None, None], near)
        below = ((down - place.horizon) / _EDGE + 0.5).clamp(0, 1)
        picture = torch.lerp(picture, front, below.expand_as(picture)).clamp(0, 1)
        slant = _SLANT * (1 if seed % 2 else -1) * (1 - below)
        return paint_loosely(picture, slant + 0.25 * (share - 0.5), seed, lively=_QUIET)

    @property
    def on_hill(self) -> bool:
        """True if the things stand on a hill, on a cliff, or on a bridge."""
        return self.is_raised and (self.place.kind == "hill" or self.place.has("bridge"))

    @property
    def on_water(self) -> bool:
        """True if the things float."""
        return self.place.kind == "water" and not self.is_raised

    def raise_land(self, picture: Tensor, grid: PixelGrid, seed: int) -> Tensor:
        """Returns a ground [3, H, W] with the hill or the bank in front of it on which the things stand."""
        if not self.is_raised or self.place.has("bridge", "planks"):
            return picture
        place, across = self.place, torch.linspace(-1, 1, grid.columns)
        land = replace(self, place=replace(place, below=place.bank or place.below, kind="land", layers=()))
        top = _BANK + 0.02 * torch.sin(3 * across + seed)
        if self.on_hill:
            aside = across.abs() if place.relief < _STEEP else (across + 1) / 2  # a cliff falls off on one side
            top = _VALLEY - (_VALLEY - SUMMIT) * torch.exp(-((aside / _BROAD) ** (2 if place.relief < _STEEP else 20)))
        down = ((torch.arange(grid.rows) + 0.5) / grid.rows)[:, None]
        rows = place.horizon + _EDGE + (1 - place.horizon - _EDGE) * (down - top) / (1 - top)
        where = torch.stack((across.expand_as(rows), 2 * rows - 1), 2)[None]
        front = functional.grid_sample(land.ground(grid, seed)[None], where, padding_mode="border", align_corners=False)
        return torch.lerp(picture, front[0], ((down - top) / 0.01 + 0.5).clamp(0, 1).expand_as(picture))

    def in_fog(self, picture: Tensor) -> Tensor:
        """Returns the picture [3, H, W] with fog in front of it, if there is any."""
        height = ((torch.arange(picture.shape[1]) + 0.5) / picture.shape[1])[None, :, None]
        thick = self.weather.fog * (1 - ((height - self.place.horizon).abs() / 0.45)).clamp(0, 1)
        return torch.lerp(picture, color_of(self.weather.color)[:, None, None].expand_as(picture), thick)


def find_part(name: str, parts: Sequence[_Part], sentences: SentenceEncoder, least: float = 0.0) -> _Part | None:
    """Returns the place, the light or the weather that a word means; None below `least` or a threshold.

    A single word is no compound: a station is not yet a train station.
    """

    def words(part: _Part) -> Sequence[str]:
        return [word for word in part.words if " " in name or " " not in word or not isinstance(part, Place)]

    part, similarity = nearest_part([name], parts, sentences, words)
    usual = {Place: _CALLED, Light: _FELT, Weather: _FELT_WEATHER, Dressing: _DRESSED}[type(part)]
    return part if similarity >= max(least, usual) else None


def infer_place(
    names: Sequence[str], sentences: SentenceEncoder, *, outside: bool = False, afloat: bool = True
) -> Place:
    """Returns the usual place of things, that with the most similar words; under the sky if they are `outside`.

    afloat: False if none of them is on or in water
    """
    kinds = ("land", "hill", *(["water"] if afloat else []), *([] if outside else ["room"]))
    places = [place for place in known_places() if place.kind in kinds]
    return nearest_part(names, places, sentences, lambda one: (*one.found, *one.words))[0]


def in_color(place: Place, color: Color) -> Place:
    """Returns the place in another colour: a teal sky, a blue wall, a green river, a white path, a green meadow."""
    if place.name in ("sky", "room"):
        return replace(place, above=color)
    kinds = ("stream", "canal", *(_WAYS if place.is_way else ()))
    if place.has(*kinds):
        layers = (layer._replace(color=color) if layer.kind in kinds else layer for layer in place.layers)
        return replace(place, layers=tuple(layers))
    return replace(place, below=color)


def in_size(place: Place, wide: float) -> Place:
    """Returns the place with its ways and waves by a factor as wide or high: a narrow street, big waves."""
    sized = (*_WAYS, "stream", "canal", "waves")
    layers = (one._replace(size=one.size * wide) if one.kind in sized else one for one in place.layers)
    return replace(place, layers=tuple(layers))


def join(place: Place, others: Sequence[Place]) -> Place:
    """Returns the place with the scenery of others that it has none of: a lake before mountains, and with a jetty."""
    layers = list(place.layers)
    is_full = any(layer.kind == "line" and layer.y > place.horizon for layer in layers)  # roofs hide the streets
    for other in others if place.is_open else ():
        water = [PlaceLayer("band", "", _SEA, other.below)] if other.kind == "water" != place.kind else []
        for layer in (*water, *(other.layers if other.is_open else ())):
            same = [one for one in layers if _kin(one) == _kin(layer)]
            is_higher = _kin(layer) == "hills" and all(layer.size > one.size for one in same)
            is_sunk = layer.kind in ("way", "road", "rails", "walls") and (place.kind == "water" or is_full)
            if is_higher or not (same or is_sunk):
                layers = [*(one for one in layers if one not in same), layer]
    above = next((one.above for one in others if one.is_open and one.above is not None), place.above)
    return replace(with_layers(place, layers), above=above if place.is_open else place.above)


def _kin(layer: PlaceLayer) -> str:
    return _KIN.get(layer.kind, layer.kind)


def with_layers(place: Place, layers: Iterable[PlaceLayer]) -> Place:
    """Returns the place with these layers, in their order from back to front."""
    return replace(place, layers=tuple(sorted(layers, key=lambda layer: _ORDER.index(layer.kind))))


def with_contrast(ground: Tensor, where: Tensor, thing: Tensor, least: float = TOLD_APART) -> Tensor:
    """Returns the ground [3, H, W], darker or lighter if things would not stand out from it.

    where: [H, W] opacity of the things
    thing: [3, H, W] their colours
    least: Lab distance between things and the ground around them
    """
    seen = where > 0.5
    around = (functional.max_pool2d(where[None, None], 31, 1, 15)[0, 0] > 0.5) & ~seen
    if not bool(seen.any()) or not bool(around.any()):
        return ground
    lab, color = to_lab(ground.permute(1, 2, 0)), to_lab(thing[:, seen].T).mean(0)
    lack = min(_CHANGE, least - float((color - lab[around].mean(0)).norm()))
    if lack <= 0:
        return ground
    lab[..., 0] = (lab[..., 0] + (-lack if float(color[0]) > _MIDDLE else lack)).clamp(5, 98)
    return from_lab(lab).permute(2, 0, 1).clamp(0, 1)
