"""Settings of a scene: place, light and weather, chosen by the meaning of a prompt and painted as a ground.

A ground has a few flat areas. The toned canvas is one of them, and broad strokes paint the others.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.palette import from_lab, to_lab

Color = tuple[float, float, float]
_PAPER: Color = (1.0, 1.0, 1.0)
_EDGE = 0.03  # share of the height over which two bands blend
_COVERED = 0.75  # share of the land that falling snow covers
_GLOW = 0.12  # share of the height above the horizon in the glow of a low sun: about a row of the broad brush


@dataclass(frozen=True)
class Place:
    """Place of a scene.

    name: for messages
    words: words that name it
    found: things that are usually there
    above, below: sRGB above and below the horizon
    horizon: share of the height above the horizon
    relief: height of its hills, as a share of the height
    is_water: True if things float on it
    is_open: True if there is a sky over it
    """

    name: str
    words: tuple[str, ...]
    found: tuple[str, ...]
    above: Color
    below: Color
    horizon: float
    relief: float = 0.0
    is_water: bool = False
    is_open: bool = True


@dataclass(frozen=True)
class Light:
    """Light of a scene.

    name: for messages
    words: words that name it
    top, low: sRGB of the sky at its top and at the horizon
    shade: factors for the colours of the land
    stars: number of stars
    """

    name: str
    words: tuple[str, ...]
    top: Color
    low: Color
    shade: Color
    stars: int = 0


@dataclass(frozen=True)
class Weather:
    """Weather of a scene.

    name: for messages
    words: words that name it
    color: sRGB of rain, flakes or fog
    rain, flakes: number of marks
    fog: opacity
    """

    name: str
    words: tuple[str, ...]
    color: Color
    rain: int = 0
    flakes: int = 0
    fog: float = 0.0


PAPER = Place("bare paper", (), (), _PAPER, _PAPER, 0.5)
PLACES = (
    Place("the sea", ("sea", "ocean", "harbour", "coast", "wave"), ("sailing boat", "ship", "whale", "fish", "island"),
          (0.80, 0.89, 0.95), (0.22, 0.46, 0.66), 0.70, is_water=True),
    Place("a lake", ("lake", "pond", "river", "water"), ("swan", "duck", "frog", "lily pad", "boat"),
          (0.82, 0.90, 0.94), (0.36, 0.58, 0.68), 0.66, 0.08, is_water=True),
    Place("a beach", ("beach", "sand", "shore"), ("palm tree", "crab", "starfish"),
          (0.66, 0.84, 0.93), (0.90, 0.80, 0.58), 0.72),
    Place("a meadow", ("meadow", "grass", "field", "garden", "park"),
          ("flower", "tree", "animal", "butterfly", "insect", "tractor", "cow", "bicycle", "rooster", "horse", "sheep",
           "dog"),
          (0.80, 0.90, 0.96), (0.46, 0.64, 0.32), 0.72),
    Place("hills", ("hill", "hills", "valley", "landscape", "village", "horizon"),
          ("house", "castle", "windmill", "tower", "barn"), (0.80, 0.88, 0.95), (0.50, 0.62, 0.36), 0.74, 0.14),
    Place("mountains", ("mountain range", "mountains", "cliff", "alps"), ("mountain", "eagle", "volcano"),
          (0.80, 0.87, 0.94), (0.44, 0.50, 0.52), 0.72, 0.28),
    Place("a forest", ("forest", "jungle", "woods", "wilderness"),
          ("tree", "bear", "deer", "owl", "mushroom", "fox", "wolf", "squirrel", "tiger", "monkey"),
          (0.60, 0.74, 0.58), (0.27, 0.40, 0.22), 0.72, 0.30),
    Place("a desert", ("desert", "dune", "savannah"), ("cactus", "camel", "giraffe", "lion", "elephant", "zebra"),
          (0.90, 0.88, 0.80), (0.86, 0.68, 0.42), 0.72, 0.07),
    Place("snow", ("snow", "ice", "winter landscape", "iceberg"), ("snowman", "penguin", "polar bear"),
          (0.70, 0.80, 0.90), (0.94, 0.96, 0.98), 0.72, 0.06),
    Place("a street", ("street", "road", "city", "town", "square", "market"),
          ("house", "car", "bus", "train", "traffic light"), (0.84, 0.88, 0.92), (0.56, 0.55, 0.54), 0.74),
    Place("the sky", ("sky", "clouds"), ("cloud", "airplane", "hot air balloon", "kite", "flying bird", "rocket"),
          (0.55, 0.76, 0.92), (0.78, 0.88, 0.95), 0.86),
    Place("a table", ("table top", "kitchen", "tablecloth", "still life"),
          ("fruit", "food", "cup", "dish", "vase", "cake"),
          (0.93, 0.89, 0.80), (0.66, 0.46, 0.30), 0.70, is_open=False),
    Place("a room", ("room", "indoors", "floor", "wall", "stage"),
          ("furniture", "musical instrument", "clothes", "tool", "chair", "computer"),
          (0.92, 0.88, 0.80), (0.60, 0.44, 0.32), 0.74, is_open=False),
)  # fmt: skip
HILLS, FOREST, SKY = PLACES[4], PLACES[6], PLACES[10]
DAY = Light("day", (), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
LIGHTS = (
    Light("dawn", ("dawn", "sunrise", "early morning", "morning"), (0.62, 0.70, 0.86), (0.99, 0.82, 0.68),
          (0.92, 0.84, 0.84)),
    Light("sunset", ("sunset", "dusk", "evening", "twilight"), (0.42, 0.36, 0.58), (0.99, 0.60, 0.28),
          (0.78, 0.60, 0.58)),
    Light("night", ("night", "midnight", "moonlight", "dark night", "starry night"), (0.05, 0.08, 0.22),
          (0.27, 0.35, 0.56), (0.30, 0.35, 0.52), 10),
    Light("a grey day", ("gloomy", "sad", "lonely", "loneliness", "melancholy", "grief", "stormy", "grey weather",
          "cloudy day"), (0.52, 0.56, 0.62), (0.76, 0.78, 0.80), (0.72, 0.75, 0.80)),
    Light("warm light", ("joy", "happiness", "love", "cheerful", "summer"), (0.55, 0.80, 0.97),
          (1.0, 0.94, 0.70), (1.05, 1.0, 0.88)),
    Light("autumn light", ("autumn", "fall foliage"), (0.86, 0.84, 0.76), (0.98, 0.84, 0.56), (1.18, 0.80, 0.52)),
)  # fmt: skip
GREY = LIGHTS[3]
TIMES = (*LIGHTS[:3], LIGHTS[5])
"""Lights of a time of day or year, in contrast to those of a mood."""
CLEAR = Weather("clear", (), _PAPER)
WEATHERS = (
    Weather("rain", ("rain", "rainy", "downpour", "storm", "thunderstorm"), (0.86, 0.90, 0.95), rain=16),
    Weather("snow", ("snowfall", "snowing", "snowy", "blizzard", "snowstorm"), (1.0, 1.0, 1.0), flakes=18),
    Weather("fog", ("fog", "mist", "misty", "haze"), (0.90, 0.91, 0.92), fog=0.6),
)
_Part = TypeVar("_Part", Place, Light, Weather)
_CALLED = 0.72  # similarity to a place's words above which words name it
_FELT, _FELT_WEATHER = 0.62, 0.7  # to the words of a light, and of a weather: a snowmobile (0.67) is a thing
_TOLD_APART, _MIDDLE = 40.0, 55.0  # Lab distance, and L*


@dataclass(frozen=True)
class Setting:
    """Setting of a scene: place, light and weather.

    is_named: True if words of the prompt ask for it
    """

    place: Place = PAPER
    light: Light = DAY
    weather: Weather = CLEAR
    is_named: bool = False

    @property
    def words(self) -> str:
        """Description for messages."""
        parts = [self.place.name, self.light.name if self.light != DAY else "",
                 self.weather.name if self.weather != CLEAR else ""]  # fmt: skip
        return ", ".join(part for part in parts if part)

    def ground(self, grid: PixelGrid, seed: int) -> Tensor:
        """Returns the ground [3, H, W] on the grid, without rain, flakes and stars."""
        rows, columns = grid.rows, grid.columns
        place, shade = self.place, torch.tensor(self.light.shade)
        high = low = torch.tensor(place.above)
        if self.light != DAY:
            high, low = torch.tensor(self.light.top), torch.tensor(self.light.low)
            if not place.is_open:
                high = low = torch.tensor(place.above) * shade
        picture = high[:, None, None].expand(3, rows, columns)
        glow = _below(rows, place.horizon - _GLOW)[None]
        picture = torch.lerp(picture, low[:, None, None].expand_as(picture), glow.expand_as(picture))
        land = torch.tensor(place.below) * shade
        if self.weather.flakes and place.is_open and not place.is_water:  # snow also covers the land
            land = torch.lerp(land, torch.tensor(self.weather.color) * shade, _COVERED)
        if place.is_water:  # water reflects the top of the sky; the glow of a low sun would make it grey
            land = torch.lerp(land, high, 0.25)
        if place.relief:
            far = torch.lerp(land, low, 0.35)[:, None, None]
            picture = torch.lerp(picture, far.expand_as(picture), self._hills(rows, columns, seed))
        near = land[:, None, None].expand_as(picture)
        return torch.lerp(picture, near, _below(rows, place.horizon)[None].expand_as(picture)).clamp(0, 1)

    def in_fog(self, picture: Tensor) -> Tensor:
        """Returns the picture [3, H, W] with fog in front of it, if there is any."""
        if not self.weather.fog:
            return picture
        rows = picture.shape[1]
        height = ((torch.arange(rows) + 0.5) / rows)[None, :, None]
        thick = self.weather.fog * (1 - ((height - self.place.horizon).abs() / 0.45)).clamp(0, 1)
        color = torch.tensor(self.weather.color)[:, None, None]
        return torch.lerp(picture, color.expand_as(picture), thick.expand_as(picture))

    def _hills(self, rows: int, columns: int, seed: int) -> Tensor:
        """Returns the opacity of hills above the horizon, [1, H, W]."""
        generator = torch.Generator().manual_seed(seed)
        across = torch.linspace(0, 1, columns)
        phases = torch.rand(3, generator=generator) * 2 * math.pi
        waves = torch.zeros(columns)
        for number, phase in enumerate(phases.tolist()):
            waves = waves + torch.sin(2 * math.pi * (1.1 + number) * across + phase) / (1 + number)
        top = self.place.horizon - self.place.relief * (0.65 + 0.3 * waves)
        height = ((torch.arange(rows) + 0.5) / rows)[:, None]
        return ((height - top[None]) / _EDGE + 0.5).clamp(0, 1)[None]


def find_place(name: str, sentences: SentenceEncoder, least: float = 0.0) -> Place | None:
    """Returns the most similar place; None if its similarity is less than `least` or the threshold."""
    place, similarity = _nearest(name, PLACES, sentences)
    return place if similarity >= max(least, _CALLED) else None


def find_light(name: str, sentences: SentenceEncoder, least: float = 0.0) -> Light | None:
    """Returns the light that words such as "dawn" or "gloomy" mean; None below the threshold or `least`."""
    light, similarity = _nearest(name, LIGHTS, sentences)
    return light if similarity >= max(least, _FELT) else None


def find_weather(name: str, sentences: SentenceEncoder, least: float = 0.0) -> Weather | None:
    """Returns the weather that words such as "rain" mean; None below the threshold or `least`."""
    weather, similarity = _nearest(name, WEATHERS, sentences)
    return weather if similarity >= max(least, _FELT_WEATHER) else None


def infer_place(names: Sequence[str], sentences: SentenceEncoder, least: float, *, outside: bool = False) -> Place:
    """Returns the usual place of things; bare paper if the similarity is below `least`.

    outside: True to consider only places under the sky
    """
    places = [place for place in PLACES if place.is_open or not outside]
    words = [(place, word) for place in places for word in (*place.found, *place.words)]
    meanings = sentences.embed([*names, *(word for _, word in words)])
    similarity = (meanings[len(names) :] @ meanings[: len(names)].T).mean(1)
    best = int(similarity.argmax())
    return words[best][0] if float(similarity[best]) >= least else PAPER


def in_color(place: Place, paint: Tensor) -> Place:
    """Returns the place in a named colour: a teal sky, a green meadow."""
    color = (float(paint[0]), float(paint[1]), float(paint[2]))
    return replace(place, above=color) if place.name == "the sky" else replace(place, below=color)


def with_contrast(
    ground: Tensor, where: Tensor, thing: Tensor, horizon: float = math.inf, least: float = _TOLD_APART
) -> Tensor:
    """Returns the ground [3, H, W], darker or lighter around things that would not stand out from it.

    where: [H, W] opacity of the things
    thing: [3, H, W] their colours
    horizon: share of the height above it, because sky and land change separately; inf for none
    least: Lab distance between things and ground
    """
    lab = to_lab(ground.permute(1, 2, 0))
    seen = where > 0.5
    if not bool(seen.any()):
        return ground
    around = (functional.max_pool2d(where[None, None], 31, 1, 15)[0, 0] > 0.5) & ~seen
    own = to_lab(thing.permute(1, 2, 0))
    below = _below(ground.shape[1], horizon).expand_as(where)
    lighter = torch.zeros_like(where)
    for share in (1 - below, below):
        here, near = share * around, share * seen
        if not float(here.sum()) > 0 or not float(near.sum()) > 0:
            continue
        color = (own * near[..., None]).sum((0, 1)) / near.sum()
        behind = (lab * here[..., None]).sum((0, 1)) / here.sum()
        lack = max(0.0, least - float((color - behind).norm()))
        lighter += (-1 if float(color[0]) > _MIDDLE else 1) * lack * share
    if not bool(lighter.any()):
        return ground
    lab[..., 0] = (lab[..., 0] + lighter).clamp(5, 98)
    return from_lab(lab).permute(2, 0, 1).clamp(0, 1)


def _below(rows: int, horizon: float) -> Tensor:
    """Returns the position of each row relative to the horizon: 0 above, 1 below, [H, 1] in [0, 1]."""
    height = ((torch.arange(rows) + 0.5) / rows)[:, None]
    return ((height - horizon) / _EDGE + 0.5).clamp(0, 1)


def _nearest(name: str, parts: tuple[_Part, ...], sentences: SentenceEncoder) -> tuple[_Part, float]:
    owners: list[_Part] = []
    words: list[str] = []
    for part in parts:
        owners += [part] * len(part.words)
        words += part.words
    meanings = sentences.embed([name, *words])
    similarity = meanings[1:] @ meanings[0]
    best = int(similarity.argmax())
    return owners[best], float(similarity[best])
