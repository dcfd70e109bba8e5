"""Scenery of places in perspective, and the things that stand in it."""

from dataclasses import replace

import pytest
import torch

from frida_painter.drawing.lights import find_light, find_weather
from frida_painter.drawing.places import (
    Dressing,
    Place,
    Setting,
    find_place,
    join,
    known_dressings,
    known_places,
    with_layers,
)
from frida_painter.drawing.scenery import (
    DrawnScenery,
    Stand,
    draw_scenery,
    draw_stand,
    find_stand,
    is_wood,
    line_with,
    plant,
    stands,
    trees_of,
)
from frida_painter.frames import PixelGrid
from frida_painter.palette import to_lab
from support.networks import WordBag
from support.planning import CANVAS

GRID = PixelGrid.of_height(CANVAS, 96)
DRAWN = [place for place in known_places() if place.layers]
NIGHT, AUTUMN = find_light("night"), find_light("autumn")
SNOW = find_weather("snow")


@pytest.mark.parametrize("place", DRAWN, ids=lambda place: place.name)
def test_every_scenery_is_seen_and_repeats_to_the_byte(place: Place) -> None:
    setting = Setting(place, is_named=True)
    ground = setting.ground(GRID, 0)
    seen = draw_scenery(ground, setting, 3)
    assert seen.shape == ground.shape and 0 <= float(seen.min()) <= float(seen.max()) <= 1
    assert float((seen - ground).abs().amax(0).gt(0.05).float().mean()) > 0.03
    assert torch.equal(seen, draw_scenery(ground, setting, 3))


@pytest.mark.parametrize("stand", [*stands().values(), *stands("things.txt").values()], ids=lambda stand: stand.name)
def test_every_stand_is_drawn_whole(stand: Stand) -> None:
    drawn = draw_stand(stand, Setting(), 0)
    assert drawn.shape[0] == 4 and 0 <= float(drawn.min()) <= float(drawn.max()) <= 1
    least = 0.01 if stand.name == "stars" else 0.08
    assert float(drawn[3].mean()) > least and min(drawn.shape[1:]) > 8
    assert len({*stand.words}) == len(stand.words) and 0 < stand.height < 3
    for part in drawn[3, -1], drawn[3, 0], drawn[3, :, 0], drawn[3, :, -1]:  # trimmed on all sides
        assert float(part.max()) > 0


@pytest.mark.parametrize("dressing", known_dressings(), ids=lambda dressing: dressing.name)
def test_a_dressing_is_seen_in_the_places_that_it_is_for(dressing: Dressing) -> None:
    for name, layers in (("meadow", dressing.outdoors), ("room", dressing.indoors)):
        setting = Setting(with_layers(replace(find_place(name), layers=()), layers), is_named=True)
        ground = setting.ground(GRID, 0)
        changed = (draw_scenery(ground, setting, 0) - ground).abs().amax(0).gt(0.05).float().mean()
        assert (float(changed) > 0.005) == bool(layers)


def test_colors_take_turns_shine_or_let_light_through() -> None:
    night = Setting(light=NIGHT)
    plain, shining = Stand(("lamp",), "red/blue", 1, ()), Stand(("lamp",), "white", 1, ())
    square = ["-.4,0", ".4,0", ".4,1", "-.4,1"]
    by_turns = [draw_stand(plain._replace(shapes=(("area", "@", *square),)), Setting(), number) for number in (0, 1)]
    assert [int(one[:3, 40, 40].argmax()) for one in by_turns] == [0, 2]
    dark, light, thin = (
        draw_stand(shining._replace(shapes=(("area", color, *square),)), night, 0)
        for color in ("#ffffff", "!#ffffff", "#ffffff80")
    )
    assert float(dark[:3, 40, 40].max()) < 0.6 < 0.95 < float(light[:3, 40, 40].min())
    assert float(thin[3, 40, 40]) == pytest.approx(0.5, abs=0.01)


def test_what_must_not_be_seen_is_left_out() -> None:
    setting = Setting(find_place("meadow"), is_named=True)
    ground = setting.ground(GRID, 0)
    with_trees, without = (draw_scenery(ground, setting, 0, absent) for absent in ((), ("tree",)))
    changed = (with_trees - without).abs().mean((0, 2))
    at = round(setting.place.horizon * GRID.rows)
    assert float(changed[at - 4 : at].mean()) > 0.02 and float(changed[at + 4 :].max()) < 1e-6


def test_windows_are_lit_at_night_and_leaves_change_with_the_season() -> None:
    house, tree = stands()["house"], stands()["tree"]
    by_day, by_night = (
        draw_stand(house, Setting(find_place("village"), light), 1) for light in (find_light("dawn"), NIGHT)
    )
    warm = [((one[0] > 0.97) & (one[1] > 0.8) & (one[2] < 0.6)).float().mean() for one in (by_day, by_night)]
    assert warm[0] < 0.001 < 0.01 < warm[1]
    green, autumn, bare = (
        draw_stand(tree, setting, 0) for setting in (Setting(), Setting(light=AUTUMN), Setting(weather=SNOW))
    )
    hues = [to_lab(one[:3, one[3] > 0.5].T).mean(0)[1] for one in (green, autumn)]
    assert float(hues[0]) < 0 < float(hues[1]), "from green to red"
    assert float(bare[3].mean()) < 0.6 * float(green[3].mean())


def test_a_way_becomes_narrow_and_a_front_of_houses_low_in_the_distance() -> None:
    place = find_place("road")
    setting = Setting(Place(("",), (), "#00ff00", horizon=0.5, layers=place.layers[-1:]), is_named=True)
    ground = setting.ground(GRID, 0)
    is_road = (draw_scenery(ground, setting, 0) - ground).abs().amax(0) > 0.1
    widths = [int(is_road[round(share * GRID.rows)].sum()) for share in (0.56, 0.7, 0.97)]
    assert 0 < widths[0] < 0.5 * widths[1] and widths[1] < 0.7 * widths[2]


def test_things_of_the_prompt_replace_those_of_the_place() -> None:
    palm, window = stands()["palm"], stands()["window"]
    street, meadow, room, sea = map(find_place, ("street", "meadow", "room", "sea"))
    for place, stand, kind in (
        (find_place("river"), palm, "sides"), (street, stands()["shop"], "walls"), (meadow, palm, "grove"),
        (meadow, stands()["flower"], "strewn"), (meadow, stands()["house"], "line"), (sea, palm, "line"),
        (room, window, "hung"),
    ):  # fmt: skip
        changed = line_with(place, stand)
        assert (kind, stand.name) in [layer[:2] for layer in changed.layers]
        assert len(changed.layers) <= len(place.layers) + 1
    assert join(room, [street]) == room, "no street in a room"


def test_names_mean_stands_and_rooms_have_their_own() -> None:
    bag = WordBag()
    assert find_stand("palm tree", bag) is stands()["palm"] and find_stand("teapot", bag) is None
    assert stands()["window"].is_indoors and not stands()["palm"].is_indoors
    library = DrawnScenery()
    captioned = library.list_captioned()
    assert {"tree", "house"} < {one.file for one in captioned} and "window" not in {one.file for one in captioned}
    assert all(len(library.pictures(one.file)) == 1 for one in captioned)


def test_several_named_things_stand_along_one_way() -> None:
    for name in ("village", "market", "park"):
        place = find_place(name)
        for other in ("stall", "tent", "street lamp", "tent"):
            place = line_with(place, stands()[other])
        (along,) = [layer for layer in place.layers if layer.kind == "sides"]
        assert {"stall", "tent", "street lamp"} <= {*along.names} and len({*along.names}) == len(along.names)
        setting = Setting(place)
        assert draw_scenery(setting.ground(GRID, 0), setting, 0).isfinite().all()
        red = line_with(place, stands()["tent"], (1.0, 0.0, 0.0))
        assert [layer.names for layer in red.layers if layer.color == (1.0, 0.0, 0.0)] == [["tent"]]


def test_the_trees_that_are_said_grow_in_a_wood_and_nothing_else_changes() -> None:
    forest, meadow = find_place("forest"), find_place("meadow")
    birches = line_with(forest, stands()["birch"])
    assert trees_of(birches) == ["birch"] and len(birches.layers) == len(forest.layers)
    assert is_wood(forest) and not is_wood(meadow)
    falls = plant(find_place("waterfall"), ["palm"])
    assert trees_of(falls) == ["palm"] and falls.has("falls")
    assert [layer.names for layer in falls.layers if layer.kind == "falls"] == [["waterfall"]]
