"""Scenes of pictures made up here: an okapi before rocks fills its picture, a tree and a goat stand free."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from torch import Tensor

from frida_painter.drawing.arrangement import Relation
from frida_painter.drawing.composition import ComposedScene
from frida_painter.frames import PixelGrid
from frida_painter.objectives.picture_library import Captioned
from frida_painter.words.reading import Reading, SaidWord, Thing
from frida_painter.words.retrieval import FoundPicture, PictureIndex
from frida_painter.words.scene import scene_of
from support.networks import QuickEncoders, WordBag
from support.planning import CANVAS

GRID = PixelGrid.of_height(CANVAS, 48)
TREE, GOAT = Thing("tree", "tree"), Thing("goat", "goat")
OKAPI = Thing("okapi", "okapi")


class Pictures:
    name, credit, is_own = "pictures", "", False

    def list_captioned(self) -> Sequence[Captioned]:
        return [Captioned(said, (said,), 0.8) for said in ("okapi", "red panda", "panda", "tree", "goat")]

    def pictures(self, file: str) -> list[Tensor]:
        picture = torch.rand(4, 60, 90, generator=torch.Generator().manual_seed(1))
        picture[3] = 1
        if file in ("tree", "goat", "panda"):
            picture[3, :20, :40] = 0
        return [picture]


class OwnPictures(Pictures):
    name, is_own = "your pictures", True


def encoders(folder: Path, reading: Reading, library: Pictures | None = None) -> QuickEncoders:
    index, quick = PictureIndex([library or Pictures()], WordBag(), folder), QuickEncoders()
    quick.own["picture index"] = index
    quick.own["prompt reader"] = SimpleNamespace(read=lambda prompt: say(reading))
    return quick


def say(reading: Reading) -> Reading:
    """The reading with the words of its things."""
    said, things = [], []
    for thing in reading.things:
        first, names = len(said), thing.name.split()
        for word in names:
            said.append(SaidWord(len(said), word, word, "thing" if word == thing.noun else "quality"))
        things.append(replace(thing, at=tuple(range(first, first + len(names)))))
    return replace(reading, things=tuple(things), said=tuple(said))


def filled(scene: ComposedScene) -> bool:
    """Whether one picture is the whole scene."""
    return bool((scene.where == 1).all())


def test_what_only_a_picture_with_a_ground_shows_fills_the_canvas(tmp_path: Path) -> None:
    seen = encoders(tmp_path, Reading((OKAPI, TREE), (Relation(0, "under", 1),)))
    scene = scene_of("under a tree", GRID, seen, 0)
    assert filled(scene) and not scene.is_alone
    assert seen.remarks[1].endswith("not shown: 'tree'.") and "nothing else is added" in seen.remarks[3]


def test_what_a_table_is_with_stands_on_it_and_not_beside(tmp_path: Path) -> None:
    class Furnished(Pictures):
        def list_captioned(self) -> Sequence[Captioned]:
            return [Captioned(said, (said,), 0.8) for said in ("desk", "lamp")]

        def pictures(self, file: str) -> list[Tensor]:
            picture = torch.zeros(4, 40, 60 if file == "desk" else 30)
            picture[0 if file == "desk" else 2], picture[3, 2:] = 0.8, 1
            return [picture]

    desk, lamp = Thing("desk", "desk"), Thing("lamp", "lamp")
    seen = encoders(tmp_path, Reading((desk, lamp), (Relation(0, "with", 1),)), Furnished())
    picture = scene_of("a desk with a lamp", GRID, seen, 0).picture
    is_desk, is_lamp = picture[0] > picture[2] + 0.3, picture[2] > picture[0] + 0.3
    rows = torch.arange(GRID.rows, dtype=torch.float32)[:, None].expand_as(picture[0])
    assert rows[is_lamp].mean() < rows[is_desk].mean() - 4, "the lamp is higher"


def test_what_shows_one_thing_stands_for_no_other_beside_it(tmp_path: Path) -> None:
    class Donkeys(PictureIndex):
        def find(self, thing: Thing, *others: object, **further: object) -> FoundPicture | None:
            if further.get("shows"):
                return None
            return FoundPicture(thing, Pictures().pictures("goat")[0], "donkey", Pictures(), thing.noun == "donkey")

    donkey, cart = Thing("donkey", "donkey"), Thing("cart", "cart")
    seen = encoders(tmp_path, Reading((donkey, cart), (Relation(0, "on", 1),)))
    seen.own["picture index"] = Donkeys([Pictures()], WordBag(), tmp_path)
    scene_of("a donkey on a cart", GRID, seen, 0)
    assert seen.remarks[0].startswith("Begun with 'donkey' (pictures)") and seen.remarks[0].count("'donkey'") == 1
    assert seen.remarks[1] == "Your words: shown: 'donkey'; not shown: 'cart'."


def test_what_stands_free_stands_among_others(tmp_path: Path) -> None:
    seen = encoders(tmp_path, Reading((GOAT, TREE), (Relation(0, "under", 1),)))
    assert not filled(scene_of("a goat under a tree", GRID, seen, 0))
    assert "'goat' (pictures) and 'tree' (pictures)" in seen.remarks[0] and len(seen.remarks) == 2


def test_among_others_a_thing_that_is_not_the_first_has_no_ground(tmp_path: Path) -> None:
    seen = encoders(tmp_path, Reading((GOAT, OKAPI), (Relation(0, "beside", 1),)))
    scene_of("a goat beside an okapi", GRID, seen, 0)
    assert "'goat'" in seen.remarks[0] and "not shown: 'okapi'" in seen.remarks[1]


def test_a_picture_of_a_persons_own_with_a_ground_fills_the_canvas(tmp_path: Path) -> None:
    alone = encoders(tmp_path, Reading((OKAPI,)), OwnPictures())
    assert filled(scene_of("an okapi", GRID, alone, 0))
    among = encoders(tmp_path, Reading((OKAPI, GOAT), (Relation(0, "beside", 1),)), OwnPictures())
    assert filled(scene_of("an okapi beside a goat", GRID, among, 0)) and "nothing else is added" in among.remarks[-1]


def test_a_time_of_the_day_that_is_named_alone_is_light_and_no_thing(tmp_path: Path) -> None:
    seen = encoders(tmp_path, Reading((Thing("peaceful morning", "morning"),)))
    scene_of("a peaceful morning", GRID, seen, 0)
    assert "strokes and colours of dawn" in seen.remarks[0] and "morning" not in seen.remarks[0]
    assert seen.remarks[1] == "Your words: shown by something similar: 'morning' (by dawn); not shown: 'peaceful'."


def test_a_colour_is_not_told_from_a_photographs_ground(tmp_path: Path) -> None:
    blue = encoders(tmp_path, Reading((Thing("panda", "panda", "blue"),)))
    scene_of("a blue panda", GRID, blue, 0)
    assert "'panda' (pictures)" in blue.remarks[0], "which stands free, and can be coloured"
    okapi = encoders(tmp_path, Reading((Thing("okapi", "okapi", "gray"),)))
    scene_of("a gray okapi", GRID, okapi, 0)
    assert "'okapi' (pictures)" in okapi.remarks[0], "rather than none"


def test_a_feeling_is_painted_without_a_thing_even_if_a_picture_is_called_so(tmp_path: Path) -> None:
    class Moody(Pictures):
        def list_captioned(self) -> Sequence[Captioned]:
            return [*super().list_captioned(), Captioned("goat", ("grief",), 0.8)]

    seen = encoders(tmp_path, Reading((Thing("quiet grief", "grief"),)), Moody())
    scene = scene_of("a quiet grief", GRID, seen, 0)
    assert "strokes and colours of sadness" in seen.remarks[0]
    assert seen.remarks[1] == "Your words: shown by something similar: 'grief' (by sadness); not shown: 'quiet'."
    assert float((scene.picture.amin(0) > 0.93).float().mean()) < 0.05 and not scene.is_alone
    among = encoders(tmp_path, Reading((GOAT, Thing("grief", "grief")), (Relation(0, "in", 1),)), Moody())
    scene_of("a goat in grief", GRID, among, 0)
    assert "'goat' (pictures), on " in among.remarks[0] and "sadness" in among.remarks[0]


def test_weather_is_no_object_and_its_light_goes_before_that_of_a_mood(tmp_path: Path) -> None:
    reading = Reading((Thing("sound", "sound"), Thing("thunder", "thunder")), (Relation(0, "of", 1),))
    seen = encoders(tmp_path, reading)
    scene_of("the sound of thunder", GRID, seen, 0)
    assert "strokes and colours of a storm" in seen.remarks[0]
    assert "'sound' (by music), 'thunder' (by a storm)" in seen.remarks[1]


def test_a_mood_has_the_colours_that_it_is_said_to_have(tmp_path: Path) -> None:
    said = tuple(SaidWord(at, word, word, "quality") for at, word in enumerate(("red", "black"), 1))
    reading = Reading((Thing("anger", "anger", color="red and black", at=(0, 1, 2)),), said=said)
    red = scene_of("anger, red and black", GRID, encoders(tmp_path, reading), 0).picture.mean((1, 2))
    assert float(red[0]) > 1.5 * float(red[1:].max()) and float(red[2]) < 0.35


LAKE, MEADOW, SOUND = Thing("lake", "lake"), Thing("meadow", "meadow"), Thing("sound", "sound")
MOON, BEARD = Thing("moon", "moon"), Thing("long beard", "beard")
GOATS = Thing("goat", "goat", count=None, plural="goats")


@pytest.mark.parametrize(
    ("reading", "begun"),
    [
        (Reading((GOAT, LAKE), (Relation(0, "beside", 1),)), "Begun with 'goat' (pictures), on lake."),
        (
            Reading((GOAT, MOON), (Relation(0, "under", 1),)),
            "Begun with 'goat' (pictures), on",
        ),
        (Reading((GOAT, BEARD), (Relation(0, "with", 1),)), "Begun with 'goat' (pictures)."),
        (
            Reading((MEADOW, GOATS), (Relation(0, "of", 1),)),
            "Begun with 'goat' (pictures, 8 times), on meadow.",
        ),
        (
            Reading((SOUND, GOATS), (Relation(0, "of", 1),)),
            "Begun with 'goat' (pictures, 3 times), on",
        ),
        (Reading((Thing("forest", "forest"),)), "Begun with the scenery of forest, drawn."),
        (Reading((GOAT, Thing("Nile", "Nile")), (Relation(0, "on", 1),)), "Begun with 'goat' (pictures), on river."),
        (Reading((Thing("lake", "lake"), Thing("mountain", "mountain", count=None, plural="mountains"))), "Begun with"),
    ],
    ids=["beside", "moon", "beard", "field", "sound", "forest", "Nile", "mountains"],
)
def test_what_words_show(reading: Reading, begun: str, tmp_path: Path) -> None:
    seen = encoders(tmp_path, reading)
    scene_of("as read", GRID, seen, 0)
    assert seen.remarks[0].startswith(begun)
    if begun.endswith("Begun with"):
        assert "shown: 'lake', 'mountain'" in seen.remarks[1]


def test_several_trees_line_a_place_and_a_window_is_in_a_wall(tmp_path: Path) -> None:
    trees, window = Thing("leafless tree", "tree", count=None, plural="trees"), Thing("window", "window")
    street, market = Thing("street", "street"), Thing("market", "market")
    stalls = Thing("stall", "stall", count=None, plural="stalls")
    for things, shown in (
        ((street, trees), ["'street', 'leafless tree'"]),
        ((market, stalls), ["'market'", "'stall'"]),
        ((GOAT, window), ["'goat'", "'window'"]),
    ):
        seen = encoders(tmp_path, Reading(things, (Relation(0, "with", 1),)))
        scene_of("as read", GRID, seen, 0)
        assert all(one in seen.remarks[1].partition("not shown")[0] for one in shown), seen.remarks


@pytest.mark.parametrize("word", ["friendly", "broken", "tiny"])
def test_a_thing_looks_as_its_words_say_and_that_is_told(word: str, tmp_path: Path) -> None:
    pictures = [
        scene_of("a goat", GRID, quick, 1).picture
        for thing in (GOAT, Thing(f"{word} goat", "goat"))
        if (quick := encoders(tmp_path, Reading((thing, TREE))))
    ]
    told = " ".join(quick.remarks)
    assert (word == "friendly") == torch.equal(*pictures)
    assert (word == "friendly") == (word in told.partition("not shown")[2])


def test_what_is_behind_a_place_is_far_and_what_is_on_a_hill_is_high(tmp_path: Path) -> None:
    middles = {}
    for word, place in (("in", "meadow"), ("behind", "meadow"), ("in", "hills"), ("on", "hills")):
        reading = Reading((GOAT, Thing(place, place)), (Relation(0, word, 1),))
        where = scene_of(f"a goat {word} {place}", GRID, encoders(tmp_path, reading), 1).where
        middles[word, place] = float(where.gt(0.5).any(1).nonzero().max())
    assert middles["behind", "meadow"] < middles["in", "meadow"] and middles["on", "hills"] < middles["in", "hills"]
