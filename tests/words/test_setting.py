"""What a prompt says of its setting."""

from frida_painter.drawing.arrangement import Relation
from frida_painter.words.reading import Reading, SaidWord, Thing
from frida_painter.words.setting import is_building, is_idea, setting_of
from support.networks import QuickEncoders, WordBag


def test_a_feeling_is_an_idea_and_a_thing_is_none() -> None:
    bag = WordBag()
    assert is_idea("grief", ["grief"], bag, is_pictured=False), "it has no other sense"
    assert is_idea("grief", [], bag, is_pictured=True) and not is_idea("grief", ["grief"], bag, is_pictured=True)
    assert is_idea("dance", [], bag, is_pictured=False) and not is_idea("dance", ["dance"], bag, is_pictured=False)
    assert not is_idea("teapot", [], bag, is_pictured=False) and not is_idea("violinist", [], bag, is_pictured=False)


def layers_of(*things: Thing, relations: tuple[Relation, ...] = ()) -> tuple[set[str], set[int]]:
    """Returns the things in the layers of a setting, and the numbers of the things that are only part of it."""
    said = tuple(SaidWord(at, word, word, "thing") for thing in things for at, word in zip(
        thing.at, thing.name.split(), strict=True))  # fmt: skip
    setting, settled, _ = setting_of(Reading(things, relations, said=said), None, QuickEncoders())
    return {layer.what for layer in setting.place.layers}, settled


def test_an_occasion_or_a_mess_adds_to_the_place() -> None:
    market = Thing("christmas market", "market", at=(0, 1))
    assert (
        "christmas tree" in layers_of(market)[0]
        and "christmas tree" not in layers_of(Thing("market", "market", at=(0,)))[0]
    )
    garden, party = Thing("garden", "garden", at=(0,)), Thing("party", "party", at=(2,))
    layers, settled = layers_of(garden, party, relations=(Relation(1, "in", 0),))
    assert "bunting" in layers and settled == {0, 1}


def test_a_building_has_its_parts_and_a_town_its_name() -> None:
    assert is_building("cottage") and not is_building("tree")
    cottage, roof = Thing("cottage", "cottage", at=(0,)), Thing("roof", "roof", at=(2,))
    assert layers_of(cottage, roof, relations=(Relation(0, "with", 1),))[1] == {1}
    street, town = Thing("street", "street", at=(0,)), Thing("Italian town", "town", at=(2, 3))
    assert "coloured house" in layers_of(street, town, relations=(Relation(0, "in", 1),))[0]


def test_the_name_of_what_has_no_picture_tells_its_place() -> None:
    assert "fir" in layers_of(Thing("mountain pass", "pass", at=(0, 1)))[0]
