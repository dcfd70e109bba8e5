"""Grounds, light and weather, and a scene on them."""

import pytest
import torch

from frida_painter.drawing.arrangement import Known, Placed
from frida_painter.drawing.composition import compose_scene
from frida_painter.drawing.lights import CLEAR, DAY, find_light, find_weather, known_lights, known_weathers
from frida_painter.drawing.places import (
    Place,
    Setting,
    find_part,
    find_place,
    in_color,
    infer_place,
    join,
    known_places,
    with_contrast,
)
from frida_painter.frames import PixelGrid
from frida_painter.palette import to_lab
from support.networks import WordBag
from support.planning import CANVAS

THING = Known("thing", 1.0, "ground")

GRID = PixelGrid.of_height(CANVAS, 48)
NIGHT, DAWN, RAIN = find_light("night"), find_light("dawn"), find_weather("rain")
PAINTED = [place for place in known_places() if place.kind != "paper"]


@pytest.mark.parametrize("place", PAINTED, ids=lambda place: place.name)
@pytest.mark.parametrize("light", [DAY, *known_lights()], ids=lambda light: light.name)
def test_every_ground_has_a_sky_and_a_land(place, light) -> None:
    ground = Setting(place, light, is_named=True).ground(GRID, 0)
    assert ground.shape == (3, GRID.rows, GRID.columns) and 0 <= float(ground.min()) <= float(ground.max()) <= 1
    assert float((ground[:, 0].mean(1) - ground[:, -1].mean(1)).abs().max()) > 0.015


def test_night_is_dark_and_fog_is_seen() -> None:
    meadow = find_place("meadow")
    day, night = (Setting(meadow, light, is_named=True).ground(GRID, 0).mean() for light in (DAY, NIGHT))
    assert float(night) < 0.4 * float(day)
    clear, foggy = (Setting(meadow, NIGHT, weather, is_named=True) for weather in (CLEAR, find_weather("fog")))
    ground = clear.ground(GRID, 0)
    assert torch.equal(clear.in_fog(ground), ground)
    assert float((foggy.in_fog(ground) - ground).abs().amax(0).gt(0.1).float().mean()) > 0.3


@pytest.mark.parametrize("place", PAINTED, ids=lambda place: place.name)
def test_a_ground_has_depth_and_loose_strokes_and_no_white_paper(place: Place) -> None:
    for light in (DAY, find_light("dusk")):
        ground = Setting(place, light, is_named=True).ground(GRID, 0)
        assert float((ground.amin(0) > 0.93).float().mean()) < 0.1 or "snow" in place.name
        light_of = to_lab(ground.permute(1, 2, 0))[..., 0]
        horizon = round(place.horizon * GRID.rows)
        assert float(light_of[horizon + 1 : horizon + 4].mean() - light_of[-3:].mean()) > 2, "darker in front"
        assert float(light_of.std(1).mean()) > 1, "and of strokes"
    assert not torch.equal(ground, Setting(place, light).ground(GRID, 1)) and torch.equal(
        ground, Setting(place, light, is_named=True).ground(GRID, 0)
    ), "another seed, another hand"


def test_words_name_places_lights_and_weathers_or_imply_them() -> None:
    bag = WordBag()
    assert (
        find_part("the sea", known_places(), bag) is find_place("sea")
        and find_part("teapot", known_places(), bag) is None
    )
    assert find_part("the sea", known_places(), bag, 1.1) is None, "there is a picture that is called so"
    assert find_part("dawn", known_lights(), bag) is DAWN and find_part("dog", known_lights(), bag) is None
    assert find_part("rain", known_weathers(), bag) is RAIN and find_part("dog", known_weathers(), bag) is None
    assert (
        find_part("rain mobile", known_weathers(), bag) is None
        and find_part("dawn chorus", known_lights(), bag) is DAWN
    )
    assert infer_place(["a whale"], bag) is find_place("sea")
    assert infer_place(["a whale"], bag, afloat=False).kind != "water"


@pytest.mark.parametrize("shade", [0.0, 0.5, 1.0])
def test_things_are_told_from_their_ground(shade: float) -> None:
    thing, where = torch.full((3, 60, 80), shade), torch.zeros(60, 80)
    where[20:40, 30:50] = 1
    ground = with_contrast(torch.full((3, 60, 80), shade), where, thing)
    far = to_lab(ground.permute(1, 2, 0))[10, 10] - to_lab(thing.permute(1, 2, 0))[30, 40]
    assert float(far.norm()) > 20
    clear = torch.full((3, 60, 80), 1 - shade if shade != 0.5 else 0.95)
    assert torch.equal(with_contrast(clear, where, thing), clear), "what is told apart stays"


@pytest.mark.parametrize("shape", [(40, 40), (10, 80), (80, 10)])
@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize("in_the_air", [True, False])
def test_things_never_touch_the_edge(shape: tuple[int, int], named: bool, in_the_air: bool) -> None:
    drawing = torch.zeros(4, *shape)
    drawing[3], drawing[0] = 1, 1
    things = [Placed(drawing, THING), Placed(drawing, THING, x=1.5, y=0.5, height=0.6, depth=1)]
    for some in (things, things[:1]):
        scene = compose_scene(some, Setting(find_place("sea"), is_named=named), GRID, 1, in_the_air=in_the_air)
        assert float(scene.where.max()) == 1 and scene.picture.shape == (3, GRID.rows, GRID.columns)
        edges = torch.cat((scene.where[0], scene.where[-1], scene.where[:, 0], scene.where[:, -1]))
        assert float(edges.max()) < 0.5


def test_a_thing_without_a_named_place_stands_on_a_painted_ground_with_its_shadow() -> None:
    drawing = torch.zeros(4, 30, 40)
    drawing[3], drawing[0] = 1, 1
    setting = Setting(find_place("room"))
    scene = compose_scene([Placed(drawing, THING)], setting, GRID, 0, in_the_air=False)
    assert float((scene.picture.amin(0) > 0.93).float().mean()) < 0.1
    aloft = compose_scene([Placed(drawing, THING)], setting, GRID, 0, in_the_air=True).picture.mean(0)
    foot = int((scene.where > 0.5).any(1).nonzero().max())
    shade = (aloft - scene.picture.mean(0))[foot + 1 : foot + 3]
    assert float(shade.max()) > 0.05, "its shadow"
    assert scene.is_alone and not compose_scene([], setting, GRID, 0, in_the_air=False).is_alone


def test_paper_stays_bare_if_words_ask_for_it() -> None:
    drawing = torch.zeros(4, 30, 40)
    drawing[3], drawing[0] = 1, 1
    paper = find_place("plain paper")
    scene = compose_scene([Placed(drawing, THING)], Setting(paper, is_named=True), GRID, 0, in_the_air=False)
    assert float(scene.picture[:, scene.where < 0.01].min()) == 1
    assert find_part("blank page", known_places(), WordBag()) is paper
    blue = Setting(in_color(paper, (0.2, 0.3, 0.9))).ground(GRID, 0)
    assert float(blue[2].min()) == pytest.approx(0.9) and float(blue.std((1, 2)).max()) < 1e-6


def test_hills_of_another_place_stand_behind_a_lake() -> None:
    lake, mountains = find_place("lake"), find_place("mountains")
    both = join(lake, [find_place("meadow"), mountains])
    assert (both.below, both.relief) == (lake.below, mountains.relief)
    assert [layer.kind for layer in both.layers] == ["peaks", "line"], "one row of hills, and the lake's own trees"
    shore = join(mountains, [in_color(lake, (0.2, 0.3, 0.9))]).layers[-1]
    assert (shore.kind, shore.color) == ("band", (0.2, 0.3, 0.9)) and join(lake, []) == lake
    bridge, river = find_place("bridge"), find_place("river")
    green = in_color(river, "green")
    assert green.below == river.below and [one.color for one in green.layers if one.kind == "stream"] == ["green"]
    assert {layer.kind for layer in join(river, [bridge]).layers} == {"hills", "line", "stream", "sides", "bridge"}
