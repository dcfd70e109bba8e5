"""Stars, rain and flakes."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from frida_painter.drawing.arrangement import Known, Placed
from frida_painter.drawing.composition import compose_scene, falling
from frida_painter.drawing.lights import CLEAR, DAY, find_light, find_weather
from frida_painter.drawing.places import Setting, find_place
from frida_painter.frames import PixelGrid
from support.planning import CANVAS

THING = Known("thing", 1.0, "ground")

GRID = PixelGrid.of_height(CANVAS, 128)
MEADOW, NIGHT = find_place("meadow"), find_light("night")
RAIN, SNOW, WIND = find_weather("rain"), find_weather("snow"), find_weather("wind")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("setting", "wanted"),
    [
        (Setting(MEADOW, DAY, RAIN), RAIN.rain),
        (Setting(MEADOW, DAY, SNOW), SNOW.flakes),
        (Setting(MEADOW, DAY, WIND), 7),
        (Setting(MEADOW, NIGHT), NIGHT.stars),
    ],
    ids=lambda one: getattr(one, "words", ""),
)
def test_marks_are_apart_and_hide_no_thing(setting: Setting, wanted: int) -> None:
    where = torch.zeros(GRID.rows, GRID.columns)
    where[30:110, 20:70] = 1
    opacity, color = falling(setting, where, 0)
    assert opacity.shape == where.shape and 0 <= float(opacity.min()) <= float(opacity.max()) <= 1
    marks = cv2.connectedComponents(np.asarray(opacity > 0.5, np.uint8))[0] - 1
    assert 0.7 * wanted <= marks <= wanted
    assert float((opacity * where).sum()) < 0.05 * float(opacity.sum())
    assert float(color.min()) > 0.7, "they are light"
    assert torch.equal(opacity, falling(setting, where, 0)[0])
    assert not torch.equal(opacity, falling(setting, where, 1)[0])


def test_stars_are_over_the_horizon_and_out_of_doors() -> None:
    where = torch.zeros(GRID.rows, GRID.columns)
    stars = falling(Setting(MEADOW, NIGHT), where, 0)[0]
    assert float(stars[: round(MEADOW.horizon * GRID.rows)].sum()) > 0.9 * float(stars.sum()) > 0
    room = find_place("room")
    for setting in (Setting(room, NIGHT), Setting(MEADOW, DAY, CLEAR)):
        assert float(falling(setting, where, 0)[0].max()) == 0


def test_where_things_fill_the_picture_nothing_falls() -> None:
    assert float(falling(Setting(MEADOW, DAY, RAIN), torch.ones(GRID.rows, GRID.columns), 0)[0].max()) == 0


def test_what_falls_matters_as_things_do() -> None:
    drawing = torch.zeros(4, 40, 40)
    drawing[3] = drawing[0] = 1
    setting = Setting(MEADOW, DAY, replace(RAIN, wet=0.0), is_named=True)
    scene = compose_scene([Placed(drawing, THING)], setting, GRID, 0, in_the_air=False)
    dry = compose_scene([Placed(drawing, THING)], Setting(MEADOW, DAY, is_named=True), GRID, 0, in_the_air=False)
    rain = (scene.picture - dry.picture).abs().amax(0) > 0.1
    assert float(rain.float().mean()) > 0.01 and float(scene.where[rain].mean()) > 0.7
