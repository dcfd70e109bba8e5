"""Grounds, light and weather, and a scene on them."""

import pytest
import torch
from torch.nn import functional

from frida_painter.frames import PixelGrid
from frida_painter.palette import to_lab
from frida_painter.words.arrangement import Placed, known_like, known_things
from frida_painter.words.composition import compose_scene
from frida_painter.words.places import (
    CLEAR,
    DAY,
    LIGHTS,
    PAPER,
    PLACES,
    WEATHERS,
    Setting,
    find_light,
    find_place,
    find_weather,
    infer_place,
    with_contrast,
)
from support.networks import WordBag
from support.planning import CANVAS

GRID = PixelGrid.of_height(CANVAS, 48)


@pytest.mark.parametrize("place", PLACES, ids=lambda place: place.name)
@pytest.mark.parametrize("light", [DAY, *LIGHTS], ids=lambda light: light.name)
def test_every_ground_has_a_sky_and_a_land(place, light) -> None:
    ground = Setting(place, light, is_named=True).ground(GRID, 0)
    assert ground.shape == (3, GRID.rows, GRID.columns) and 0 <= float(ground.min()) <= float(ground.max()) <= 1
    assert float((ground[:, 0].mean(1) - ground[:, -1].mean(1)).abs().max()) > 0.03


def test_night_is_dark_and_fog_is_seen() -> None:
    day, night = (Setting(PLACES[3], light, is_named=True).ground(GRID, 0).mean() for light in (DAY, LIGHTS[2]))
    assert float(night) < 0.4 * float(day)
    clear, foggy = (Setting(PLACES[3], LIGHTS[2], weather, is_named=True) for weather in (CLEAR, WEATHERS[2]))
    ground = clear.ground(GRID, 0)
    assert torch.equal(clear.in_fog(ground), ground)
    assert float((foggy.in_fog(ground) - ground).abs().amax(0).gt(0.1).float().mean()) > 0.3


@pytest.mark.parametrize("light", [DAY, *LIGHTS], ids=lambda light: light.name)
def test_most_of_a_ground_has_one_colour_which_a_canvas_can_have(light) -> None:
    for place in PLACES:
        ground = Setting(place, light, is_named=True).ground(GRID, 0).flatten(1)
        same = (ground - ground[:, :1]).abs().amax(0) < 1e-3
        assert float(same.float().mean()) > 0.35, place.name


def test_words_name_places_lights_and_weathers_or_imply_them() -> None:
    bag = WordBag()
    assert find_place("the sea", bag) is PLACES[0] and find_place("teapot", bag) is None
    assert find_place("the sea", bag, 1.1) is None, "there is a picture that is called so"
    assert find_light("dawn", bag) is LIGHTS[0] and find_light("dog", bag) is None
    assert find_weather("rain", bag) is WEATHERS[0] and find_weather("dog", bag) is None
    assert find_weather("rain mobile", bag) is None and find_light("dawn chorus", bag) is LIGHTS[0]
    assert infer_place(["a whale"], bag, 0.4) is PLACES[0] and infer_place(["zygote"], bag, 0.4) is PAPER


def test_sizes_come_from_what_is_similar() -> None:
    bag = WordBag()
    assert known_like("elephant", bag).height == pytest.approx(3.2, rel=0.2)
    assert known_like("moon", bag).where == "air" and known_like("dress", bag).where == "worn"
    places = ("ground", "air", "water", "worn", "held", "head", "facing")
    assert all(thing.height > 0 and thing.where in places for thing in known_things())
    assert known_like("spider web", bag).where == "facing" and known_like("umbrella", bag).where == "held"


@pytest.mark.parametrize("shade", [0.0, 0.5, 1.0])
def test_things_are_told_from_their_ground(shade: float) -> None:
    thing, where = torch.full((3, 60, 80), shade), torch.zeros(60, 80)
    where[20:40, 30:50] = 1
    ground = with_contrast(torch.full((3, 60, 80), shade), where, thing)
    far = to_lab(ground.permute(1, 2, 0))[10, 10] - to_lab(thing.permute(1, 2, 0))[30, 40]
    assert float(far.norm()) > 20
    clear = torch.full((3, 60, 80), 1 - shade if shade != 0.5 else 0.95)
    assert torch.equal(with_contrast(clear, where, thing), clear), "what is told apart stays"


def test_sky_and_land_are_told_from_things_each_by_itself() -> None:
    where, ground = torch.zeros(60, 80), torch.full((3, 60, 80), 0.95)
    where[10:50, 30:50], ground[:, 30:] = 1, 0.5
    changed = with_contrast(ground, where, torch.full((3, 60, 80), 0.5), 0.5)
    assert torch.allclose(changed[:, :25], ground[:, :25], atol=1e-3), "a pale sky behind grey stays"
    assert float(changed[0, 45, 10] - 0.5) > 0.2, "grey land does not"


@pytest.mark.parametrize("shape", [(40, 40), (10, 80), (80, 10)])
@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize("in_the_air", [True, False])
def test_things_never_touch_the_edge(shape: tuple[int, int], named: bool, in_the_air: bool) -> None:
    drawing = torch.zeros(4, *shape)
    drawing[3], drawing[0] = 1, 1
    things = [Placed(drawing, 0, 0, 1), Placed(drawing, 1.5, 0.5, 0.6, 1)]
    for some in (things, things[:1]):
        scene = compose_scene(some, Setting(PLACES[0], is_named=named), GRID, 1, in_the_air=in_the_air)
        assert float(scene.where.max()) == 1 and scene.picture.shape == (3, GRID.rows, GRID.columns)
        edges = torch.cat((scene.where[0], scene.where[-1], scene.where[:, 0], scene.where[:, -1]))
        assert float(edges.max()) < 0.5


def test_where_no_place_is_named_there_is_paper() -> None:
    drawing = torch.zeros(4, 30, 40)
    drawing[3], drawing[0] = 1, 1
    meadow = next(place for place in PLACES if place.name == "a meadow")
    standing = compose_scene([Placed(drawing, 0, 0, 1)], Setting(meadow), GRID, 0, in_the_air=False)
    assert float(standing.picture[:, standing.where < 0.01].min()) == 1
    drawing[:3] = 0.97
    pale = compose_scene([Placed(drawing, 0, 0, 1)], Setting(meadow), GRID, 0, in_the_air=False)
    around = functional.max_pool2d(pale.where[None, None], 3, 1, 1)[0, 0] > 0.5
    rim = pale.picture[:, around & (pale.where < 0.5)]
    assert float((1 - rim).amax(0).min()) > 0.05, "what is pale is seen against a tone"
    assert float(pale.picture[:, 0].std(1).max()) == 0, "which is the same everywhere, so that a canvas can have it"
