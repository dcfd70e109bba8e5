"""Settings of a scene: place, light and weather, chosen by the meaning of a prompt and painted as a ground.

A ground has depth: a sky or a wall with light on it, land or a table that is darker in front, in loose strokes. Moods
are lights too.
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
from frida_painter.words.brushwork import paint_loosely

Color = tuple[float, float, float]
_PAPER: Color = (1.0, 1.0, 1.0)
_EDGE = 0.03  # share of the height over which two bands blend
_COVERED = 0.75  # share of the land that falling snow covers
_DIM, _DEEP = 0.78, (0.80, 0.88, 0.95)  # factors of a colour away from the light, and of a blue sky's top
_FAR = 0.30  # share of the light at the horizon that far land takes on
_SLANT, _QUIET = 0.35, 0.75  # radians of the strokes of a sky, and their liveliness


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
    is_paper: True if nothing is painted there
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
    is_paper: bool = False


@dataclass(frozen=True)
class Light:
    """Light of a scene: of an hour, a season, or a mood; without things it becomes a picture of its own.

    name: for messages
    words: words that name it
    top, low: sRGB of the sky at its top and at the horizon
    shade: factors for the colours of the land
    accent: sRGB of its brightest or strangest strokes
    form: composition of the light as a picture, one of `FORMS`
    energy: 0 for long calm strokes to 1 for short, restless ones
    stars: number of stars
    """

    name: str
    words: tuple[str, ...]
    top: Color
    low: Color
    shade: Color
    accent: Color = _PAPER
    form: str = "horizon"
    energy: float = 0.2
    stars: int = 0

    @property
    def colors(self) -> Tensor:
        """Colours [4, 3] of its picture: depth, top, low and accent."""
        depth = tuple(0.45 * part * shade for part, shade in zip(self.top, self.shade, strict=True))
        return torch.tensor((depth, self.top, self.low, self.accent)).clamp(0, 1)


@dataclass(frozen=True)
class Weather:
    """Weather of a scene.

    name: for messages
    words: words that name it
    color: sRGB of rain, flakes or fog
    light: in it, if the words name no other
    rain, flakes: number of marks
    fog: opacity
    """

    name: str
    words: tuple[str, ...]
    color: Color
    light: Light
    rain: int = 0
    flakes: int = 0
    fog: float = 0.0


NOWHERE = Place("", (), (), _PAPER, _PAPER, 0.5)
PAPER = Place(
    "plain paper",
    ("plain paper", "blank page", "plain background"),
    (),
    _PAPER,
    _PAPER,
    0.5,
    is_open=False,
    is_paper=True,
)
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
    PAPER,
)  # fmt: skip
LAKE, MEADOW, FOREST, SKY, TABLE, ROOM = PLACES[1], PLACES[3], PLACES[6], PLACES[10], PLACES[11], PLACES[12]
DAY = Light("day", (), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
LIGHTS = (
    Light("dawn", ("dawn", "sunrise", "early morning", "morning"), (0.62, 0.70, 0.86), (0.99, 0.82, 0.68),
          (0.92, 0.84, 0.84), (1.0, 0.93, 0.70)),
    Light("sunset", ("sunset", "dusk", "evening", "twilight"), (0.42, 0.36, 0.58), (0.99, 0.60, 0.28),
          (0.78, 0.60, 0.58), (1.0, 0.86, 0.45)),
    Light("night", ("night", "midnight", "moonlight", "darkness", "starry night"), (0.05, 0.08, 0.22),
          (0.27, 0.35, 0.56), (0.30, 0.35, 0.52), (0.98, 0.93, 0.66), stars=10),
    Light("autumn", ("autumn", "fall foliage", "october"), (0.80, 0.72, 0.58), (0.90, 0.58, 0.20),
          (1.18, 0.80, 0.52), (0.72, 0.20, 0.12), "fall", 0.5),
    Light("winter", ("cold", "winter", "frost"), (0.66, 0.76, 0.86), (0.88, 0.92, 0.96), (0.92, 0.98, 1.08),
          (0.98, 0.90, 0.84)),
    Light("heat", ("heat", "summer", "noon", "drought"), (0.93, 0.62, 0.25), (0.99, 0.82, 0.36), (1.10, 1.0, 0.78),
          (1.0, 0.97, 0.80), "burst", 0.3),
    Light("sorrow", ("sadness", "grief", "loneliness", "melancholy", "gloomy", "a farewell"), (0.34, 0.42, 0.54),
          (0.60, 0.66, 0.72), (0.70, 0.75, 0.82), (0.80, 0.74, 0.62), "fall", 0.15),
    Light("joy", ("joy", "happiness", "laughter", "celebration", "party"), (0.98, 0.60, 0.36), (1.0, 0.84, 0.36),
          (1.08, 1.0, 0.88), (1.0, 0.97, 0.80), "burst", 0.8),
    Light("love", ("love", "tenderness", "passion", "romance"), (0.76, 0.24, 0.36), (0.95, 0.60, 0.56),
          (1.05, 0.88, 0.86), (1.0, 0.88, 0.72), "vortex", 0.25),
    Light("anger", ("anger", "rage", "war", "hatred"), (0.62, 0.10, 0.09), (0.88, 0.28, 0.10), (0.95, 0.62, 0.58),
          (0.99, 0.74, 0.22), "burst", 1.0),
    Light("fear", ("fear", "anxiety", "nightmare", "danger", "pain"), (0.16, 0.20, 0.24), (0.40, 0.50, 0.40),
          (0.52, 0.58, 0.60), (0.85, 0.82, 0.46), "vortex", 0.9),
    Light("calm", ("calm", "peace", "silence", "sleep", "boredom"), (0.56, 0.72, 0.76), (0.84, 0.88, 0.82),
          (0.96, 1.0, 1.0), (0.99, 0.93, 0.80), "horizon", 0.0),
    Light("longing", ("nostalgia", "memory", "longing", "childhood", "homesickness"), (0.52, 0.44, 0.44),
          (0.86, 0.66, 0.42), (0.92, 0.82, 0.70), (0.98, 0.88, 0.64), "horizon", 0.25),
    Light("a dream", ("dream", "imagination", "mystery", "magic", "secret"), (0.36, 0.28, 0.58), (0.36, 0.64, 0.68),
          (0.88, 0.84, 1.05), (0.97, 0.78, 0.84), "waves", 0.3),
    Light("hope", ("hope", "spring", "birth", "growth", "beginning"), (0.44, 0.66, 0.44), (0.80, 0.86, 0.52),
          (1.0, 1.05, 0.92), (0.99, 0.86, 0.86), "field", 0.4),
    Light("freedom", ("freedom", "wind", "journey", "adventure"), (0.28, 0.56, 0.80), (0.70, 0.86, 0.92),
          (1.0, 1.0, 1.0), (0.99, 0.97, 0.88), "waves", 0.6),
    Light("chaos", ("chaos", "confusion", "noise", "hurry", "madness"), (0.30, 0.28, 0.52), (0.86, 0.34, 0.26),
          (0.95, 0.92, 0.92), (0.95, 0.84, 0.34), "field", 1.0),
    Light("music", ("music", "song", "jazz", "rhythm", "dance", "sound"), (0.18, 0.26, 0.54), (0.76, 0.28, 0.42),
          (0.92, 0.88, 0.96), (0.97, 0.76, 0.32), "waves", 0.7),
    Light("power", ("power", "victory", "justice", "glory", "courage"), (0.38, 0.14, 0.38), (0.86, 0.60, 0.22),
          (1.02, 0.94, 0.90), (1.0, 0.92, 0.62), "burst", 0.4),
    Light("emptiness", ("emptiness", "death", "nothing", "loss", "end"), (0.24, 0.24, 0.27), (0.46, 0.45, 0.45),
          (0.62, 0.62, 0.64), (0.78, 0.76, 0.72), "horizon", 0.0),
    Light("thought", ("thought", "idea", "time", "eternity", "gravity", "knowledge", "truth"), (0.14, 0.26, 0.44),
          (0.34, 0.56, 0.68), (0.92, 0.96, 1.02), (0.98, 0.84, 0.48), "vortex", 0.2),
)  # fmt: skip
GREY = LIGHTS[6]
TIMES = LIGHTS[:6]
"""Lights of a time of day or year, in contrast to those of a mood."""
_STORM = Light(
    "a storm", (), (0.22, 0.27, 0.34), (0.58, 0.62, 0.62), (0.62, 0.66, 0.70), (0.93, 0.90, 0.72), "vortex", 0.8
)
_PALE = Light(
    "pale light", (), (0.72, 0.75, 0.78), (0.88, 0.89, 0.89), (0.85, 0.88, 0.90), (0.97, 0.95, 0.90), energy=0.0
)
CLEAR = Weather("clear", (), _PAPER, DAY)
WEATHERS = (
    Weather("rain", ("rain", "rainy", "downpour", "drizzle"), (0.86, 0.90, 0.95), GREY, rain=16),
    Weather("a storm", ("storm", "stormy", "thunder", "lightning", "hurricane"), (0.82, 0.84, 0.88), _STORM, rain=12),
    Weather("snow", ("snowfall", "snowing", "snowy", "blizzard", "snowstorm"), (1.0, 1.0, 1.0), LIGHTS[4], flakes=18),
    Weather("fog", ("fog", "mist", "misty", "haze"), (0.90, 0.91, 0.92), _PALE, fog=0.6),
)
_Part = TypeVar("_Part", Place, Light, Weather)
_CALLED = 0.72  # similarity to a place's words above which words name it
_FELT, _FELT_WEATHER = 0.62, 0.7  # to the words of a light, and of a weather: a snowmobile (0.67) is a thing
_ABSTRACT, _MOOD = 0.25, 0.35  # margin of an abstract noun with a picture, and least similarity to a light's words
_TOLD_APART, _MIDDLE = 40.0, 55.0  # Lab distance, and L*


@dataclass(frozen=True)
class Setting:
    """Setting of a scene: place, light and weather.

    second: further light that the words name, for a mood without things
    is_named: True if words of the prompt ask for it
    """

    place: Place = NOWHERE
    light: Light = DAY
    weather: Weather = CLEAR
    second: Light | None = None
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
        above, below = torch.tensor(place.above), torch.tensor(place.below)
        if place.is_paper:
            return (above * shade).clamp(0, 1)[:, None, None].expand(3, rows, columns).contiguous()
        if not place.is_open:
            high, low = above * shade * _DIM, above * shade
        elif self.light == DAY:
            high, low = above * torch.tensor(_DEEP), torch.lerp(above, torch.ones(3), 0.4)
        else:
            high, low = torch.tensor(self.light.top), torch.tensor(self.light.low)
        land = below * shade
        if self.weather.flakes and place.is_open and not place.is_water:  # snow also covers the land
            land = torch.lerp(land, torch.tensor(self.weather.color) * shade, _COVERED)
        if place.is_water:  # water reflects the top of the sky; the glow of a low sun would make it grey
            land = torch.lerp(land, high, 0.25)
        down, across = ((torch.arange(side) + 0.5) / side for side in (rows, columns))
        down, across = torch.meshgrid(down, across, indexing="ij")
        # The light comes from the left, and along the horizon.
        share = (down / place.horizon).clamp(max=1) ** 2
        share = 0.35 * share + 0.65 * (1 - across) if not place.is_open else 0.85 * share + 0.15 * (1 - across)
        picture = torch.lerp(high[:, None, None], low[:, None, None], share)
        near = ((down - place.horizon) / (1 - place.horizon)).clamp(0, 1)
        far = torch.lerp(land, low, _FAR if place.is_open else 0.0)
        front = torch.lerp(far[:, None, None], (land * _DIM)[:, None, None], near)
        if place.relief:
            hills = torch.lerp(land, low, 0.12)[:, None, None]
            picture = torch.lerp(picture, hills.expand_as(picture), self._hills(rows, columns, seed))
        picture = torch.lerp(picture, front, _below(rows, place.horizon)[None].expand_as(picture)).clamp(0, 1)
        slant = _SLANT * (1 if seed % 2 else -1) * (1 - _below(rows, place.horizon)).expand(rows, columns)
        return paint_loosely(picture, slant + 0.25 * (share - 0.5), seed, lively=_QUIET)

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


def find_part(name: str, parts: Sequence[_Part], sentences: SentenceEncoder, least: float = 0.0) -> _Part | None:
    """Returns the place, the light or the weather that a word means; None below `least` or a threshold."""
    part, similarity = _nearest(name, parts, sentences)
    usual = {Place: _CALLED, Light: _FELT, Weather: _FELT_WEATHER}[type(part)]
    return part if similarity >= max(least, usual) else None


def find_mood(
    name: str, people: Sequence[str], others: Sequence[str], sentences: SentenceEncoder, *, is_pictured: bool
) -> Light | None:
    """Returns the light of an abstract noun: a feeling, a time, a sound, an idea; None for a person or a thing.

    A noun is abstract if it is nearer to the words of lights than to all words for people and things; in the mean, too,
    for people: a couple is near love, but nearer people.

    people, others: words for people, and for other things
    is_pictured: True if there is a picture of that name, so that it must be much nearer
    """
    light, similarity = _nearest(name, LIGHTS, sentences)
    around = [word for place in PLACES for word in (*place.words, *place.found)]
    felt = [word for one in LIGHTS for word in one.words]
    meaning = sentences.embed([name])[0]
    if people and float(meaning @ (sentences.embed(people).mean(0) - sentences.embed(felt).mean(0))) > 0:
        return None
    margin = similarity - float((sentences.embed([*people, *others, *around]) @ meaning).max())
    return light if similarity >= _MOOD and margin > (_ABSTRACT if is_pictured else 0.0) else None


def rank_lights(words: str, sentences: SentenceEncoder) -> list[Light]:
    """Returns the lights of hours, seasons and moods, from the most to the least similar to some words."""
    found = sorted(((_nearest(words, (light,), sentences)[1], -number) for number, light in enumerate(LIGHTS)))
    return [LIGHTS[-number] for _, number in reversed(found)]


def mix_lights(first: Light, second: Light) -> Light:
    """Returns the light halfway between two, with the form of the second: grief at dawn."""
    top, low, shade, accent = (
        _halve(getattr(first, name), getattr(second, name)) for name in ("top", "low", "shade", "accent")
    )
    name = f"{first.name}, {second.name}"
    return replace(second, name=name, stars=first.stars, top=top, low=low, shade=shade, accent=accent)


def _halve(one: Color, two: Color) -> Color:
    red, green, blue = ((first + second) / 2 for first, second in zip(one, two, strict=True))
    return red, green, blue


def infer_place(names: Sequence[str], sentences: SentenceEncoder, least: float, *, outside: bool = False) -> Place:
    """Returns the usual place of things; `NOWHERE` if the similarity is below `least`.

    outside: True to consider only places under the sky
    """
    places = [place for place in PLACES if place.is_open or not outside]
    words = [(place, word) for place in places for word in (*place.found, *place.words)]
    meanings = sentences.embed([*names, *(word for _, word in words)])
    similarity = (meanings[len(names) :] @ meanings[: len(names)].T).mean(1)
    best = int(similarity.argmax())
    return words[best][0] if float(similarity[best]) >= least else NOWHERE


def in_color(place: Place, paint: Tensor) -> Place:
    """Returns the place in a named colour: a teal sky, a green meadow."""
    color = (float(paint[0]), float(paint[1]), float(paint[2]))
    if place.is_paper:
        return replace(place, above=color, below=color)
    return replace(place, above=color) if place.name == "the sky" else replace(place, below=color)


def with_contrast(ground: Tensor, where: Tensor, thing: Tensor, least: float = _TOLD_APART) -> Tensor:
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
    lack = least - float((color - lab[around].mean(0)).norm())
    if lack <= 0:
        return ground
    lab[..., 0] = (lab[..., 0] + (-lack if float(color[0]) > _MIDDLE else lack)).clamp(5, 98)
    return from_lab(lab).permute(2, 0, 1).clamp(0, 1)


def _below(rows: int, horizon: float) -> Tensor:
    """Returns the position of each row relative to the horizon: 0 above, 1 below, [H, 1] in [0, 1]."""
    height = ((torch.arange(rows) + 0.5) / rows)[:, None]
    return ((height - horizon) / _EDGE + 0.5).clamp(0, 1)


def _nearest(name: str, parts: Sequence[_Part], sentences: SentenceEncoder) -> tuple[_Part, float]:
    """Returns the part with the word of most similar meaning, and that similarity."""
    owners = [part for part in parts for _ in part.words]
    meanings = sentences.embed([name, *(word for part in parts for word in part.words)])
    similarity, best = (meanings[1:] @ meanings[0]).max(0)
    return owners[int(best)], float(similarity)
