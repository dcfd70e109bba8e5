"""Loose strokes, and moods without things."""

import math

import pytest
import torch

from frida_painter.drawing.brushwork import FORMS, paint_loosely, paint_mood
from frida_painter.drawing.lights import find_light, known_lights, known_weathers
from frida_painter.frames import PixelGrid
from support.planning import CANVAS

GRID = PixelGrid.of_height(CANVAS, 90)


@pytest.mark.parametrize("angle", [0.0, math.pi / 2])
def test_strokes_follow_the_given_direction(angle: float) -> None:
    noise = torch.rand(3, 90, 120, generator=torch.Generator().manual_seed(0))
    picture = paint_loosely(noise, torch.full((90, 120), angle), 3)
    along, across = picture.diff(dim=2).abs().mean(), picture.diff(dim=1).abs().mean()
    ratio = float(along / across)
    assert ratio < 0.7 if angle == 0 else ratio > 1.4


def test_an_even_picture_keeps_its_colour_and_gets_strokes() -> None:
    even = torch.tensor([0.3, 0.5, 0.7])[:, None, None].expand(3, 60, 80)
    picture = paint_loosely(even, torch.zeros(60, 80), 1)
    assert torch.allclose(picture.mean((1, 2)), even[:, 0, 0], atol=0.03) and float(picture.std((1, 2)).min()) > 0.01
    assert torch.equal(picture, paint_loosely(even, torch.zeros(60, 80), 1))


@pytest.mark.parametrize("form", FORMS)
def test_every_form_covers_the_paper_with_the_colours_of_its_light(form: str) -> None:
    night, joy = find_light("night"), find_light("joy")
    dark = paint_mood(form, night.colors, night.colors, night.energy, GRID, 0)
    bright = paint_mood(form, joy.colors, joy.colors, joy.energy, GRID, 0)
    assert dark.shape == (3, GRID.rows, GRID.columns) and float(dark.mean()) + 0.2 < float(bright.mean())
    assert float((dark.amin(0) > 0.93).float().mean()) < 0.05
    assert float(dark.std((1, 2)).max()) > 0.03, "it is no even tone"


def test_forms_differ_and_energy_makes_strokes_restless() -> None:
    light = find_light("dawn")
    pictures = [paint_mood(form, light.colors, light.colors, 0.2, GRID, 0) for form in FORMS]
    for number, one in enumerate(pictures):
        assert all(float((one - other).abs().mean()) > 0.02 for other in pictures[:number])
    calm, restless = (paint_mood("field", light.colors, light.colors, energy, GRID, 0) for energy in (0.0, 1.0))
    assert float(restless.diff(dim=2).abs().mean()) > 1.3 * float(calm.diff(dim=2).abs().mean())


def test_every_light_and_weather_has_a_known_form() -> None:
    assert {light.form for light in (*known_lights(), *(weather.light for weather in known_weathers()))} == set(FORMS)
