"""Lights of hours, seasons and moods, and weathers."""

import pytest
import torch

from frida_painter.drawing.lights import (
    CLEAR,
    color_of,
    dye,
    find_light,
    find_weather,
    go_together,
    known_lights,
    known_weathers,
    mix_lights,
    mix_weathers,
    rank_lights,
)
from support.networks import WordBag


def test_lights_are_ranked_and_mixed() -> None:
    bag, night, grey = WordBag(), find_light("night"), find_light("sadness")
    assert rank_lights("war and chaos", bag)[0].name in ("anger", "chaos")
    mixed = mix_lights(night, grey)
    assert mixed.name == "night, sadness" and mixed.stars == night.stars
    assert mixed.top == pytest.approx(((color_of(night.top) + color_of(grey.top)) / 2).tolist())


def test_contrary_feelings_do_not_go_together_and_each_light_has_a_fellow() -> None:
    lights = {light.name: light for light in known_lights()}
    assert not go_together(lights["calm"], lights["anger"]) and not go_together(lights["sadness"], lights["joy"])
    assert go_together(lights["sadness"], lights["emptiness"])
    for light in known_lights():
        assert sum(go_together(light, other) for other in known_lights() if other is not light) >= 3, light.name


def test_a_sentence_that_feels_so_ranks_a_light_first() -> None:
    for light in known_lights():
        for sentence in light.felt:
            assert sentence in rank_lights(sentence, WordBag())[0].felt


def test_every_weather_does_something_to_a_picture() -> None:
    for weather in known_weathers():
        assert weather.rain or weather.flakes or weather.fog or weather.wind or weather.wet or weather.clouds, weather


@pytest.mark.parametrize("colors", [["red"], ["white"], ["red", "black"], ["gold", "navy", "white", "green"]])
def test_a_dyed_light_has_the_colours_from_dark_to_bright(colors: list[str]) -> None:
    dyed = dye(find_light("anger"), [color_of(color) for color in colors])
    lightness = dyed.colors.mean(1)
    assert torch.all(lightness.diff() >= -1e-6)
    assert any(torch.allclose(color_of(color), tint) for color in colors[:1] for tint in dyed.colors)


def test_several_weathers_fall_together() -> None:
    gale, snow = find_weather("wind"), find_weather("snow")
    both = mix_weathers([gale, snow])
    assert (both.wind, both.flakes, both.color) == (gale.wind, snow.flakes, snow.color)
    assert both.name == "wind, snow" and both.light == gale.light
    assert mix_weathers([]) == CLEAR and mix_weathers([snow]) == snow
