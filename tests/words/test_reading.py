"""Prompts are read by patterns: subjects, ground, counts, colours, names, and what must not be seen."""

import pytest

from frida_painter.errors import ConfigError
from frida_painter_words.reading import LONGEST, contents, read, singular, stem
from frida_painter_words.text import TextTerm

NOUNS = "fox cat dog man child boat robot violin street cup coffee orange horse tulip elephant dancing".split()  # noqa: SIM905


def knows(word: str) -> bool:
    return singular(word) in NOUNS


@pytest.mark.parametrize(
    ("said", "name", "count", "color", "ground"),
    [
        ("a red fox in the snow", "fox", 1, "red", "in the snow"),
        ("please paint me a picture of three sailing boats at sunset", "sailing boats", 3, "", "at sunset"),
        ("a portrait of an old man reading a newspaper", "old man", 1, "", ""),
        ("two children flying a kite on the beach", "children", 2, "", "on the beach"),
        ("a cat sits on a chair", "cat", 1, "", "on a chair"),
        ("a robot painting a picture", "robot", 1, "", ""),
        ("a dark blue horse", "horse", 1, "dark blue", ""),
        ("a sleeping black cat", "sleeping cat", 1, "black", ""),
        ("an orange", "orange", 1, "", ""),
        ("a herd of elephants", "elephants", None, "", ""),
        ("a violin in the style of Picasso", "violin", 1, "", ""),
        ("A RED FOX IN THE SNOW", "fox", 1, "red", "in the snow"),
    ],
)
def test_the_subject_is_what_the_words_are_about(
    said: str, name: str, count: int | None, color: str, ground: str
) -> None:
    reading = read(said, knows)
    (phrase,) = reading.subjects
    assert (" ".join(phrase.name), phrase.count, phrase.color, reading.ground) == (name, count, color, ground)
    assert not phrase.proper


@pytest.mark.parametrize(
    ("said", "proper"),
    [
        ("Albert Einstein dancing", ("albert", "einstein")),
        ("a portrait of Frida Kahlo", ("frida", "kahlo")),
        ("the Queen of England", ("queen", "england")),
        ("Tiger Woods in a meadow", ("tiger", "woods")),
        ("a Siamese cat", ()),
        ("A Red Fox In The Snow", ()),
        ("Foxes", ()),
    ],
)
def test_capitals_make_a_name_of_a_noun(said: str, proper: tuple[str, ...]) -> None:
    assert read(said, knows).subjects[0].proper == proper


def test_several_subjects_and_what_a_thing_is_full_of() -> None:
    assert [one.noun for one in read("a cat and two dogs in the park", knows).subjects] == ["cat", "dog"]
    part = read("a bowl of oranges", knows).subjects[0].part
    assert part.noun == stem("orange") and part.count is None
    assert read("a black and white cat", knows).subjects[0].color == "black white"


def test_what_must_not_be_seen_is_no_subject() -> None:
    reading = read("a street without people or cars at night", knows)
    assert reading.absent == ("people", "cars") and reading.subjects[0].noun == "street"
    assert reading.ground == "at night" and not contents(reading.text) & contents(reading.absent)


@pytest.mark.parametrize("said", ["ein Hund im Schnee", "🙂 🙂", "собака", "no", "a the of", "'" * 9, "x" * 10_000])
def test_words_of_any_kind_are_read(said: str) -> None:
    assert len(read(said, knows).text) <= LONGEST


@pytest.mark.parametrize(
    "same", [("dance", "dancing", "dances"), ("city", "cities"), ("leaf", "leaves"), ("snow", "snowy"), ("man", "men"),
             ("run", "running"), ("box", "boxes"), ("child", "children"), ("fog", "foggy")],
)  # fmt: skip
def test_forms_of_a_word_have_one_stem(same: tuple[str, ...]) -> None:
    assert len({stem(word) for word in same}) == 1
    assert stem("lady") != stem("lad") and stem("king") == "king"


@pytest.mark.parametrize(
    "said",
    ["no dogs, no cats", "without people", "No people!", "not a cat", "without any people or cars",
     "neither dogs nor cats", "no dogs, and no cats", "no red dogs"],
)  # fmt: skip
def test_words_that_say_only_what_must_not_be_seen_are_refused_by_every_network(said: str) -> None:
    with pytest.raises(ConfigError):
        TextTerm(said)


@pytest.mark.parametrize(
    "said",
    ["no dog, a cat", "a street without people", "no people in the street", "no country for old men", "no man's land",
     "no more war", "no dogs but a cat", "noah and the ark", "nothing", "no people, only trees"],
)  # fmt: skip
def test_words_that_say_more_are_taken(said: str) -> None:
    assert TextTerm(said).words == said
