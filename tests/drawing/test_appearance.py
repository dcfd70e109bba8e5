"""Words for the appearance of a thing, and what they change."""

import pytest
import torch
from torch import Tensor

from frida_painter.drawing.appearance import change_looks, in_weather, known_looks, looks_of
from frida_painter.drawing.lights import CLEAR, known_weathers
from support.networks import WordBag


def box(rows: int = 40, columns: int = 40) -> Tensor:
    picture = torch.full((4, rows, columns), 0.5)
    picture[3] = 1
    return picture


def test_words_ask_for_an_appearance_and_others_for_none() -> None:
    found = looks_of(["fat", "broken", "friendly"], WordBag(), is_person=False)
    assert set(found) == {"fat", "broken"}
    assert set(looks_of(["fat", "broken"], WordBag(), is_person=True)) == {"fat"}, "nobody is broken"
    assert looks_of([], WordBag(), is_person=False) == {}


@pytest.mark.parametrize(
    ("word", "factor", "proportion"), [("tall", 1.5, 1.5), ("long", 1.0, 1 / 1.6), ("tiny", 0.5, 1)]
)
def test_a_shape_stretches_a_thing_or_changes_its_size(word: str, factor: float, proportion: float) -> None:
    picture, size = change_looks(box(), [*looks_of([word], WordBag(), is_person=False).values()])
    assert size == pytest.approx(factor)
    assert picture.shape[1] / picture.shape[2] == pytest.approx(proportion, rel=0.05)


@pytest.mark.parametrize("word", [look.words[0] for look in known_looks() if look.change])
@pytest.mark.parametrize("shape", [(40, 40), (90, 7), (5, 200), (1, 1)])
def test_a_state_is_seen_in_any_picture(word: str, shape: tuple[int, int]) -> None:
    plain, _ = change_looks(box(*shape), [])
    picture, size = change_looks(box(*shape), [*looks_of([word], WordBag(), is_person=False).values()])
    assert size == 1 and float(picture.min()) >= 0 and float(picture.max()) <= 1
    assert bool(picture.isfinite().all()) and float(picture[3].mean()) > 0.05
    assert picture.shape != plain.shape or not torch.equal(picture, plain)


def test_a_crack_goes_from_top_to_foot() -> None:
    picture, _ = change_looks(box(), [*looks_of(["cracked"], WordBag(), is_person=False).values()])
    middle = picture[3, 10:-20, picture.shape[2] // 4 : -picture.shape[2] // 4]
    assert bool((middle.amin(1) < 0.1).all()) and bool((middle.amax(1) > 0.9).all())


def test_what_lies_upside_down_is_turned_and_what_is_made_of_gold_is_yellow() -> None:
    picture = box()
    picture[:3, :20] = 0.9
    turned, _ = change_looks(picture, [*looks_of(["upside"], WordBag(), is_person=False).values()])
    assert float(turned[:3, 20:60].mean()) < float(turned[:3, -60:-20].mean())
    gold, _ = change_looks(picture, [*looks_of(["golden"], WordBag(), is_person=False).values()])
    red, green, blue = gold[:3, gold[3] > 0.5].mean(1).tolist()
    assert red > green > 2 * blue


def test_wind_bends_plants_and_snow_lies_on_what_stands_outside() -> None:
    named = {weather.name: weather for weather in known_weathers()}
    tree = box(60, 20)
    blown = in_weather(tree, named["wind"], "plant")
    left = [int((row > 0.5).nonzero().min()) for row in (blown[3, 0], blown[3, -1])]
    assert left[0] < left[1] and torch.equal(in_weather(tree, named["wind"], "person"), tree)
    snowy = in_weather(tree, named["snow"], "ground")
    assert float(snowy[:3, :2].mean()) > 0.8 > 0.6 > float(snowy[:3, -20:].mean())
    assert torch.equal(in_weather(tree, CLEAR, "plant"), tree)
