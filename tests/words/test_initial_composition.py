from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from frida_painter.drawing.arrangement import Relation
from frida_painter.drawing.lights import find_light, find_weather
from frida_painter.drawing.places import NOWHERE, Place, Setting

from frida_painter.frames import PixelGrid
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.sketch import SketchTerm
from frida_painter.objectives.style import StyleTerm
from frida_painter.words import beginnings, scene
from frida_painter.words.beginnings import initial_composition
from frida_painter.words.reading import Reading, Thing
from frida_painter.words.scene import scene_of
from frida_painter.words.text import TextTerm
from support.networks import NoEncoderRegistry, QuickEncoders, index_of
from support.planning import CANVAS, picture

GRID = PixelGrid.of_height(CANVAS, 48)


@pytest.fixture
def encoders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> QuickEncoders:
    monkeypatch.setattr("frida_painter.words.retrieval._FILLED", 2.0)  # these pictograms fill their boxes
    index, quick = index_of(tmp_path), QuickEncoders()
    quick.own["picture index"] = index
    return quick


def test_words_alone_begin_with_their_pictogram_which_stays_in_the_goal(encoders: QuickEncoders) -> None:
    goal = initial_composition(Goal((TextTerm("a strawberry", 2.0),)), GRID, encoders, 0)
    words, kept = goal.terms
    (begun,) = goal.initial
    assert isinstance(words, TextTerm) and isinstance(kept, ImageTerm) and isinstance(begun, ImageTerm)
    assert kept.image is begun.image and begun.image.shape == (3, GRID.rows, GRID.columns)
    assert torch.allclose(begun.image[:, GRID.rows // 2, GRID.columns // 2], torch.tensor([1.0, 0, 0]), atol=0.2)
    assert any("Somebody" in remark and "CC BY-SA 4.0" in remark for remark in encoders.remarks)


def test_several_words_are_one_scene_the_heaviest_first(encoders: QuickEncoders) -> None:
    said: list[str] = []

    def read(prompt: str) -> Reading:
        said.append(prompt)
        return Reading((Thing("strawberry", "strawberry"),))

    encoders.own["prompt reader"] = SimpleNamespace(read=read)
    words = TextTerm("a lemon"), TextTerm("a strawberry", 2.0), TextTerm("a lemon", 0.5)
    goal = initial_composition(Goal(words), GRID, encoders, 0)
    assert said == ["a strawberry and a lemon"]
    assert goal.terms[:3] == words and goal.terms[3].weight % 2.0 == 0


def test_without_a_picture_there_is_a_scene_without_it_and_what_helps_is_said(encoders: QuickEncoders) -> None:
    (begun,) = initial_composition(Goal((TextTerm("a zygote"),)), GRID, encoders, 0).initial
    assert isinstance(begun, ImageTerm) and float(begun.image[:, 0].mean()) < 0.99, "a sky, not bare paper"
    assert "not shown: 'zygote'" in encoders.remarks[1] and "give one with --image" in encoders.remarks[2]


def test_a_colour_in_the_words_is_that_of_the_thing(encoders: QuickEncoders) -> None:
    reading = Reading((Thing("strawberry", "strawberry", "blue"),))
    encoders.own["prompt reader"] = SimpleNamespace(read=lambda prompt: reading)
    (begun,) = initial_composition(Goal((TextTerm("a blue strawberry"),)), GRID, encoders, 0).initial
    assert isinstance(begun, ImageTerm)
    red, _, blue = begun.image[:, GRID.rows // 2, GRID.columns // 2].tolist()
    assert blue > 0.6 and red < 0.35


@pytest.mark.parametrize(("word", "standing"), [("on", {"umbrella"}), ("beside", {"strawberry", "umbrella"})])
def test_what_is_carried_says_nothing_of_the_place(
    word: str, standing: set[str], encoders: QuickEncoders, monkeypatch: pytest.MonkeyPatch
) -> None:
    things = (Thing("strawberry", "strawberry"), Thing("umbrella", "umbrella"))
    reading = Reading(things, (Relation(0, word, 1),))
    encoders.own["prompt reader"] = SimpleNamespace(read=lambda prompt: reading)
    asked: list[str] = []

    def implied(names: list[str], *rest: object, **more: object) -> Place:
        asked.extend(names)
        return NOWHERE

    monkeypatch.setattr("frida_painter.drawing.places.infer_place", implied)
    initial_composition(Goal((TextTerm(f"a strawberry {word} an umbrella"),)), GRID, encoders, 0)
    assert set(asked) == standing


def test_things_matter_more_than_their_ground(encoders: QuickEncoders) -> None:
    (begun,) = initial_composition(Goal((TextTerm("a strawberry"),)), GRID, encoders, 0).initial
    matters = begun.importance
    assert matters is not None and float(matters.mean()) == pytest.approx(1)
    assert float(matters[GRID.rows // 2, GRID.columns // 2]) > 3 * float(matters[0, 0])


def test_a_picture_to_begin_with_needs_no_imagination() -> None:
    with_photo = Goal((TextTerm("a strawberry"), ImageTerm(picture())))
    begun = Goal((TextTerm("a strawberry"),), (ImageTerm(picture()),))
    for goal in (with_photo, begun, Goal((ImageTerm(picture()),))):
        assert initial_composition(goal, GRID, NoEncoderRegistry(), 0) is goal


def test_a_sketch_is_filled_with_the_colours_of_what_the_words_say(encoders: QuickEncoders) -> None:
    frame = torch.ones(3, 60, 80)
    frame[:, 15:45, 20:60] = 0
    frame[:, 18:42, 23:57] = 1
    goal = initial_composition(Goal((TextTerm("a strawberry"), SketchTerm(frame))), GRID, encoders, 0)
    _, sketch, kept = goal.terms
    (begun,) = goal.initial
    assert isinstance(sketch, SketchTerm) and isinstance(kept, ImageTerm) and isinstance(begun, ImageTerm)
    red, green, blue = begun.image[:, GRID.rows // 2, GRID.columns // 2].tolist()
    assert red > 0.9 and max(green, blue) < 0.1, "what the lines enclose"
    assert 0.5 < float(begun.image[:, 2, 2].min()) < 0.93, "the ground, which is no white paper"
    assert encoders.remarks[0].startswith("Coloured like 'strawberry'")
    styled = Goal((TextTerm("a strawberry"), SketchTerm(frame), StyleTerm(picture())))
    shown = initial_composition(styled, GRID, encoders, 0)
    (filled,) = shown.initial
    assert shown.terms[:-1] == styled.terms and isinstance(filled, ImageTerm) and filled.importance is not None
    seen = {round(float(value), 2) for value in filled.image[0].flatten().unique()}
    assert len(seen) > 1 and max(seen) <= round(float(picture()[0].max()), 2), "a style has colours of its own"
    inside = float(filled.importance[GRID.rows // 2, GRID.columns // 2])
    assert inside == pytest.approx(8 * float(filled.importance[2, 2])), "its ground matters less"


def test_words_to_begin_with_have_a_picture_first(encoders: QuickEncoders) -> None:
    goal = initial_composition(Goal((StyleTerm(picture()),), (TextTerm("a strawberry"),)), GRID, encoders, 0)
    assert [type(term) for term in goal.initial] == [ImageTerm, TextTerm]
    assert [type(term) for term in goal.terms] == [StyleTerm]


def test_several_of_a_thing_are_all_there(encoders: QuickEncoders) -> None:
    reading = Reading((Thing("strawberry", "strawberry", "", 2),))
    encoders.own["prompt reader"] = SimpleNamespace(read=lambda prompt: reading)
    (begun,) = initial_composition(Goal((TextTerm("two strawberries"),)), GRID, encoders, 0).initial
    red = ((begun.image[0] > 0.7) & (begun.image[1] < 0.3)).any(0).int()
    assert int((red.diff() == 1).sum()) == 2 and "'strawberry' (drawings, 2 times)" in encoders.remarks[0]


@pytest.mark.slow
def test_in_a_style_picture_that_is_begun_with_the_thing_is_seen_and_matters_most(encoders: QuickEncoders) -> None:
    style = torch.linspace(0, 1, GRID.columns).expand(3, GRID.rows, -1).contiguous()
    goal = initial_composition(
        Goal((TextTerm("a strawberry"), StyleTerm(style)), (StyleTerm(style),)), GRID, encoders, 0
    )
    (begun,), kept = goal.initial, goal.terms[-1]
    assert isinstance(begun, ImageTerm) and isinstance(kept, ImageTerm) and kept.image is begun.image
    assert begun.importance is not None and kept.weight > 1
    changed = (begun.image - style).abs().amax(0) > 0.1
    assert 0.05 < float(changed.float().mean()) < 0.6
    assert float(begun.importance[changed].mean()) > 3 * float(begun.importance[~changed].mean())
    assert float(begun.image.std(0).max()) < 0.02, "a gray style has gray things"
    assert "laid into the style picture" in encoders.remarks[0] and "CC BY-SA 4.0" in encoders.remarks[0]
    unknown = Goal((TextTerm("a zygote"), StyleTerm(style)), (StyleTerm(style),))
    assert initial_composition(unknown, GRID, encoders, 0) is unknown
    assert "begun with the style picture alone" in encoders.remarks[2]
    assert encoders.remarks[1::2] == ["Your words: shown: 'strawberry'.", "Your words: not shown: 'zygote'."]


def test_of_a_table_that_carries_things_the_top_is_shown(
    encoders: QuickEncoders, monkeypatch: pytest.MonkeyPatch
) -> None:
    index = encoders.own["picture index"]
    assert index is not None
    index.nearest = lambda thing: 1.0  # type: ignore[method-assign]  # everything has a picture of its own
    for word, shown in (("on", ", on table top"), ("beside", "")):
        things = (Thing("strawberry", "strawberry"), Thing("tablecloth", "tablecloth"))
        reading = Reading(things, (Relation(0, word, 1),))
        encoders.own["prompt reader"] = SimpleNamespace(read=lambda prompt, reading=reading: reading)
        encoders.remarks.clear()
        initial_composition(Goal((TextTerm("a strawberry on a tablecloth"),)), GRID, encoders, 0)
        assert f"'strawberry' (drawings){shown};" in encoders.remarks[0]


def test_a_place_alone_gets_what_is_found_there_but_not_what_must_not_be_seen(
    encoders: QuickEncoders, monkeypatch: pytest.MonkeyPatch
) -> None:
    for place, unwanted, wanted in (
        ("sea", (), {"sailing boat", "ship", "whale", "fish", "island"}),
        ("sea", ("sailing boat", "ship", "whale", "fish"), {"island"}),
        ("meadow", (), set()),  # which has scenery
    ):
        reading = Reading((Thing(place, place),), (), unwanted)
        encoders.own["prompt reader"] = SimpleNamespace(read=lambda prompt, reading=reading: reading)
        sought: list[str] = []

        def find(thing: Thing, *rest: object, sought: list[str] = sought, **more: object) -> None:
            sought.append(thing.name)

        monkeypatch.setattr(encoders.own["picture index"], "find", find)
        initial_composition(Goal((TextTerm(f"a {place}"),)), GRID, encoders, 0)
        assert set(sought) <= wanted and bool(sought) == bool(wanted)


def test_a_place_where_nothing_of_it_must_be_seen_stays_empty(encoders: QuickEncoders) -> None:
    reading = Reading((Thing("beach", "beach"),), (), ("palm tree", "crab", "starfish"))
    encoders.own["prompt reader"] = SimpleNamespace(read=lambda prompt: reading)
    composed = initial_composition(
        Goal((TextTerm("a beach without palm trees, crabs or starfish"),)), GRID, encoders, 0
    )
    assert composed.terms[-1].guide is not None
    assert not any("crab" in remark for remark in encoders.remarks)


@pytest.mark.slow
def test_in_a_style_the_scene_of_words_is_in_its_colours(encoders: QuickEncoders) -> None:
    words, style = TextTerm("a strawberry"), torch.zeros(3, 60, 80)
    style[2], style[0, ::4] = 0.6, 0.5

    def begun(*style: StyleTerm) -> torch.Tensor:
        found = initial_composition(Goal((words, *style)), GRID, encoders, 0).terms[-1].picture
        assert found is not None
        return found

    whole = begun(StyleTerm(style))
    assert float(whole[1].max()) < 0.1, "no green, as in the style, and no bare paper"
    torch.testing.assert_close(begun(StyleTerm(style, 0.25)), torch.lerp(begun(), whole, 0.25))


@pytest.mark.slow
def test_in_a_style_the_light_and_the_weather_of_the_words_are_seen(
    encoders: QuickEncoders, monkeypatch: pytest.MonkeyPatch
) -> None:
    style = torch.rand(3, 60, 80, generator=torch.Generator().manual_seed(1)) * 0.5 + 0.5
    goal = Goal((TextTerm("a strawberry"), StyleTerm(style)))

    def mean_under(setting: Setting) -> float:
        for room in (scene, beginnings):
            monkeypatch.setattr(room, "setting_of", lambda reading, index, encoders: (setting, set(), []))
        found = initial_composition(goal, GRID, encoders, 0).terms[-1].picture
        assert found is not None
        return float(found.mean())

    night = find_light("night")
    day = mean_under(Setting(is_named=True))
    assert mean_under(Setting(light=night, is_named=True)) < 0.7 * day
    assert mean_under(Setting(weather=find_weather("fog"), is_named=True)) > day


@pytest.mark.slow
def test_beside_a_style_or_a_sketch_the_scene_leaves_them_a_say(encoders: QuickEncoders) -> None:
    words, drawing = TextTerm("a strawberry", 2.0), torch.ones(3, 60, 80)
    drawing[:, 15:45, 20:60] = 0
    goals = [(words,), (words, TextTerm("grief")), (words, StyleTerm(picture())), (words, SketchTerm(drawing))]
    weights = [initial_composition(Goal(terms), GRID, encoders, 0).terms[-1].weight for terms in goals]
    assert weights[1] == 10 * weights[0] > 100 * weights[2] and weights[2] == weights[3] == 6


def test_the_scene_of_a_place_counts_more_than_that_of_a_thing(encoders: QuickEncoders) -> None:
    alone = initial_composition(Goal((TextTerm("a strawberry"),)), GRID, encoders, 0).terms[-1].weight
    reading = Reading((Thing("meadow", "meadow"),))
    encoders.own["prompt reader"] = SimpleNamespace(read=lambda prompt: reading)
    place = initial_composition(Goal((TextTerm("a meadow"),)), GRID, encoders, 0).terms[-1].weight
    assert place == 10 * alone


def test_under_a_sky_there_is_land_and_that_sky(encoders: QuickEncoders) -> None:
    reading = Reading((Thing("strawberry", "strawberry"), Thing("night sky", "sky")), (Relation(0, "under", 1),))
    encoders.own["prompt reader"] = SimpleNamespace(read=lambda prompt: reading)
    scene = scene_of("a strawberry under the night sky", GRID, encoders, 0)
    assert "No picture" not in " ".join(encoders.remarks) and not scene.is_alone
    assert float((scene.picture[:, 2] - scene.picture[:, -2]).abs().amax(0).mean()) > 0.05, "sky and land"


@pytest.mark.parametrize("word", ["over", "in front of"])
def test_mountains_are_a_place(encoders: QuickEncoders, word: str) -> None:
    index = encoders.own["picture index"]
    assert index is not None
    index.nearest = lambda thing: 1.0  # type: ignore[method-assign]  # everything has a picture of its own
    mountains = Thing("mountain", "mountain", count=None, plural="mountains")
    reading = Reading((Thing("strawberry", "strawberry"), mountains), (Relation(0, word, 1),))
    encoders.own["prompt reader"] = SimpleNamespace(read=lambda prompt: reading)
    scene_of(f"a strawberry {word} mountains", GRID, encoders, 0)
    assert ", on mountains;" in encoders.remarks[0] and "No picture" not in " ".join(encoders.remarks)


@pytest.mark.parametrize("uncounted", [True, False])
def test_of_what_is_only_measured_one_picture_is_enough(encoders: QuickEncoders, uncounted: bool) -> None:
    things = (Thing("umbrella", "umbrella"), Thing("strawberry", "strawberry", uncounted=uncounted))
    reading = Reading(things, (Relation(0, "of", 1),))
    encoders.own["prompt reader"] = SimpleNamespace(read=lambda prompt: reading)
    scene_of("an umbrella of strawberry", GRID, encoders, 0)
    assert ("'umbrella' (drawings) and 'strawberry' (drawings)" in encoders.remarks[0]) is not uncounted
