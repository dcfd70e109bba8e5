import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.objectives.phrase import COLORS, Phrase, paint_of


@pytest.mark.parametrize(
    ("prompt", "thing", "plain", "color", "place"),
    [
        ("a blue bird", "a blue bird", "bird", "blue", ""),
        ("A light blue car on a road", "a light blue car", "car", "light blue", "on a road"),
        ("an orange", "an orange", "orange", "", ""),
        ("an oil painting of a cat", "a cat", "cat", "", ""),
        ("a sailing ship on a red sea", "a sailing ship", "sailing ship", "", "on a red sea"),
        ("in the woods", "in the woods", "in woods", "", ""),
    ],
)
def test_a_prompt_is_taken_apart(prompt: str, thing: str, plain: str, color: str, place: str) -> None:
    assert Phrase.of(prompt) == Phrase(thing, plain, color, place)


@pytest.mark.parametrize(
    ("prompt", "plain", "count", "beside", "place"),
    [
        ("two birds", "birds", 2, "", ""),
        ("my dog", "dog", 1, "", ""),
        ("three red fish in a pond", "fish", 3, "", "in a pond"),
        ("a girl with a red balloon by the sea", "girl", 1, "a red balloon", "by the sea"),
        ("a house and a tree", "house", 1, "a tree", ""),
        ("a boat on a lake with mountains", "boat", 1, "mountains", "on a lake"),
        ("a black and white cat", "cat", 1, "", ""),
    ],
)
def test_how_many_and_what_else(prompt: str, plain: str, count: int, beside: str, place: str) -> None:
    phrase = Phrase.of(prompt)
    assert (phrase.plain, phrase.count, phrase.beside, phrase.place) == (plain, count, beside, place)


def test_colours_are_dark_and_light() -> None:
    assert paint_of("") is None
    blue, dark, light = (paint_of(color) for color in ("blue", "dark blue", "pale blue"))
    assert blue is not None and dark is not None and light is not None
    assert torch.equal(blue, torch.tensor(COLORS["blue"]))
    assert float(dark.mean()) < float(blue.mean()) < float(light.mean())


@given(st.text(max_size=60))
def test_nothing_gets_lost_of_whatever_is_said(prompt: str) -> None:
    phrase = Phrase.of(prompt)
    said = f"{phrase.thing} {phrase.place} {phrase.beside}".split()
    words = prompt.lower().split()
    assert sorted(said) == sorted(words) or phrase.beside or words[-len(said) :] == said or not said
