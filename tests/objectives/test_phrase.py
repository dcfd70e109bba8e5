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


def test_colours_are_dark_and_light() -> None:
    assert paint_of("") is None
    blue, dark, light = (paint_of(color) for color in ("blue", "dark blue", "pale blue"))
    assert blue is not None and dark is not None and light is not None
    assert torch.equal(blue, torch.tensor(COLORS["blue"]))
    assert float(dark.mean()) < float(blue.mean()) < float(light.mean())


@given(st.text(max_size=60))
def test_nothing_gets_lost_of_whatever_is_said(prompt: str) -> None:
    phrase = Phrase.of(prompt)
    said = f"{phrase.thing} {phrase.place}".split()
    assert prompt.lower().split()[-len(said) :] == said or not said
