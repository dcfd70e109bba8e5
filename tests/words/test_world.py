"""What is known of things: their sizes, their places, and which are people."""

import pytest

from downloads import fetched
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.words.world import is_person, known_like, known_things
from support.networks import WordBag


def test_sizes_come_from_what_is_similar() -> None:
    bag = WordBag()
    assert known_like("elephant", bag).height == pytest.approx(3.2, rel=0.2)
    assert known_like("moon", bag).where == "air" and known_like("dress", bag).where == "worn"
    places = ("ground", "person", "animal", "air", "water", "worn", "held", "head", "face", "neck", "top", "seat",
              "body", "plant", "wall", "clear")  # fmt: skip
    assert all(thing.height > 0 and thing.where in places for thing in known_things())
    assert known_like("plate", bag).where == "seat", "what is on it lies in it"
    assert known_like("spider web", bag).where == "seat" and known_like("umbrella", bag).where == "held"


@pytest.mark.slow
def test_people_are_told_from_things_by_their_meaning() -> None:
    fetched("minilm")
    sentences = SentenceEncoder.load()
    people = ("baker", "violinist", "old man", "nurse", "children", "thief", "ballet dancer", "soldier", "bride",
              "sleeping baby", "young couple")  # fmt: skip
    things = ("farmhouse", "cello", "toothbrush", "statue", "horse", "crown", "bakery", "ambulance", "rocking chair",
              "black rock", "dusty quarry")  # fmt: skip
    assert [is_person(name, sentences) for name in (*people, *things)] == [True] * len(people) + [False] * len(things)
