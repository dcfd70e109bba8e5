"""Lights and weathers: colours of hours, seasons and moods, chosen by the meaning of words. A mood is a light too.

Colours are sRGB, as "#rrggbb" or in [0, 1].
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Protocol, TypeVar

import torch
from torch import Tensor

from frida_painter.drawing.tables import read_rows, split_words
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.palette import to_lab

Color = str | tuple[float, float, float]
_GAMMA = 0.7  # exponent from the light of a sky, relative to a day's, to the shade of things in it
_Part = TypeVar("_Part", bound="Named")
_CONTRARY = 50.0  # mean Lab distance between the colours of lights that do not go together


class Named(Protocol):
    """Part of a setting that has words for it."""

    @property
    def words(self) -> tuple[str, ...]:
        """Words that name it."""


def color_of(color: Color) -> Tensor:
    """Returns the sRGB [3] of a colour."""
    from matplotlib.colors import to_rgb

    return torch.tensor(to_rgb(color))


@dataclass(frozen=True)
class Light:
    """Light of a scene: of an hour, a season, or a mood; without things it becomes a picture of its own.

    kind: "hour", "season", "mood", or "weather" for that in a weather
    words: words that name it, the first for messages
    top, low: colours of the sky at its top and at the horizon
    accent: colour of its brightest or strangest strokes
    form: composition of the light as a picture, one of `FORMS`
    energy: 0 for long calm strokes to 1 for short, restless ones
    stars: number of stars
    body: "low" or "high", the place of the sun or the moon in its sky; "" for none
    felt: sentences that feel so
    """

    kind: str
    words: tuple[str, ...]
    top: Color
    low: Color
    accent: Color = "white"
    form: str = "horizon"
    energy: float = 0.2
    stars: int = 0
    body: str = ""
    felt: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name for messages."""
        return self.words[0]

    @property
    def colors(self) -> Tensor:
        """Colours [4, 3] of its picture: depth, top, low and accent."""
        top, low, accent = map(color_of, (self.top, self.low, self.accent))
        return torch.stack((0.45 * top * self.shade, top, low, accent)).clamp(0, 1)

    @property
    def shade(self) -> Tensor:
        """Factors [3] for the colours of things and of the land: 1 by day."""
        sky, day = (color_of(light.top) + color_of(light.low) for light in (self, DAY))
        return (sky / day) ** (_GAMMA if self.kind != "season" else _GAMMA / 2)


@dataclass(frozen=True)
class Weather:
    """Weather of a scene.

    words: words that name it, the first for messages
    color: of rain, flakes or fog
    light: in it, if the words name no other
    rain, flakes: number of marks
    fog: opacity
    wind: share of their height by which plants lean
    wet: strength of the reflections in wet ground
    clouds: number of clouds
    """

    words: tuple[str, ...]
    color: Color
    light: Light
    rain: int = 0
    flakes: int = 0
    fog: float = 0.0
    wind: float = 0.0
    wet: float = 0.0
    clouds: int = 0

    @property
    def name(self) -> str:
        """Name for messages."""
        return self.words[0]


DAY = Light("hour", ("day", "noon", "midday", "sunny", "daylight", "light"), "#a3cae9", "#e0f0f9")
CLEAR = Weather(("clear",), "white", DAY)


@cache
def _read_table() -> tuple[tuple[Light, Weather], ...]:
    """Returns the lights of `lights.txt`, each with the weather of its words."""
    found = []
    for kind, words, felt, colors, more in read_rows("drawing/lights.txt"):
        said, (top, low, accent) = dict(one.split() for one in more.split("; ") if one), colors.split()
        form, energy, named = said.get("form", "horizon"), float(said.get("energy", 0.2)), split_words(words)
        stars, body = int(said.get("stars", 0)), said.get("body", "")
        light = Light(kind, named, top, low, accent, form, energy, stars, body, split_words(felt))
        rain, flakes, clouds = (int(said.get(word, 0)) for word in ("rain", "flakes", "clouds"))
        fog, wind, wet = (float(said.get(word, 0)) for word in ("fog", "wind", "wet"))
        found.append((light, Weather(named, said.get("color", "white"), light, rain, flakes, fog, wind, wet, clouds)))
    return tuple(found)


@cache
def known_lights() -> tuple[Light, ...]:
    """Returns the lights of `lights.txt` for hours, seasons and moods."""
    return tuple(light for light, _ in _read_table() if light.kind != "weather")


@cache
def known_weathers() -> tuple[Weather, ...]:
    """Returns the weathers of `lights.txt`."""
    return tuple(weather for light, weather in _read_table() if light.kind == "weather")


def find_light(name: str) -> Light:
    """Returns the light of the table with that name."""
    return next(light for light in known_lights() if light.name == name)


def find_weather(name: str) -> Weather:
    """Returns the weather of the table with that name."""
    return next(weather for weather in known_weathers() if weather.name == name)


def rank_lights(words: str, sentences: SentenceEncoder) -> list[Light]:
    """Returns the lights of hours, seasons and moods, from the most to the least similar to some words."""

    def feels(light: Light) -> Sequence[str]:
        return (*light.words, *light.felt)

    return sorted(known_lights(), key=lambda light: -nearest_part([words], (light,), sentences, feels)[1])


def go_together(first: Light, second: Light) -> bool:
    """Returns True if the colours of two lights are alike. Words of contrary meaning are similar: peace and war."""
    return distance(first, second) <= _CONTRARY


def distance(first: Light, second: Light) -> float:
    """Returns the mean Lab distance between the colours of two lights."""
    return float((to_lab(first.colors) - to_lab(second.colors)).norm(dim=1).mean())


def mix_lights(first: Light, second: Light) -> Light:
    """Returns the light halfway between two, with the form of the second: grief at dawn."""
    top, low, accent = ((first.colors + second.colors)[1:] / 2).tolist()
    words = (f"{first.name}, {second.name}",)
    mixed = replace(second, kind="mood", words=words, top=top, low=low, accent=accent)
    return replace(mixed, stars=first.stars, body=first.body)


def mix_weathers(weathers: Sequence[Weather]) -> Weather:
    """Returns several weathers as one: snow in a gale. The first one counts most; none make `CLEAR`."""
    first, *others = weathers or [CLEAR]
    for other in others:
        falls = first if first.rain or first.flakes or first.fog else other
        first = replace(
            falls, words=(f"{first.name}, {other.name}",), light=first.light, fog=max(first.fog, other.fog),
            wind=max(first.wind, other.wind), wet=max(first.wet, other.wet), clouds=max(first.clouds, other.clouds),
        )  # fmt: skip
    return first


def dye(light: Light, colors: Sequence[Tensor]) -> Light:
    """Returns the light in other colours, sRGB [3] each, at least one: anger in red and black."""
    dark, *others = sorted(colors, key=lambda color: float(to_lab(color)[0]))
    others = others[:2] or [torch.lerp(dark, torch.ones(3), 0.2)]
    tints = [dark, *others, torch.lerp(others[-1], torch.ones(3), 0.4)]
    top, low, accent = (tuple(tint.tolist()) for tint in tints[:3])
    return replace(light, top=top, low=low, accent=accent)


def nearest_part(
    names: Sequence[str],
    parts: Sequence[_Part],
    sentences: SentenceEncoder,
    words: Callable[[_Part], Sequence[str]] = lambda part: part.words,
) -> tuple[_Part, float]:
    """Returns the part with the word of most similar meaning to the names, in the mean, and that similarity."""
    owners: list[tuple[_Part, str]] = [(part, word) for part in parts for word in words(part)]
    meanings = sentences.embed([*names, *(word for _, word in owners)])
    similarity, best = (meanings[len(names) :] @ meanings[: len(names)].T).mean(1).max(0)
    return owners[int(best)][0], float(similarity)
