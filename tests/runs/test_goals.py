from pathlib import Path

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.errors import ConfigError, ImageError
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.semantic import SemanticTerm
from frida_painter.objectives.sketch import SketchTerm
from frida_painter.objectives.style import StyleTerm
from frida_painter.runs.goal_item import name_of, read_prompt, title_of
from frida_painter.runs.goals import make_goal, open_goal
from frida_painter.runs.painting_folder import keep_goal, read_goal
from frida_painter.runs.spec import RunSpec
from frida_painter.system import images
from frida_painter_words.text import TextTerm
from support.planning import picture


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("a sailing ship", "a sailing ship"),
        ("  a\tsailing\n ship ", "a sailing ship"),
        ("🍓", "strawberry"),
        ("a red 🍓!", "a red strawberry !"),
        ("❤️", "heavy black heart"),
        ("café à la crème", "café à la crème"),
        ("<script>alert(1)</script>", "<script>alert(1)</script>"),
        ("x" * 10_000, "x" * 10_000),
        ("3", "3"),
    ],
)
def test_words_become_one_plain_line(text: str, read: str) -> None:
    assert read_prompt(text, "--text") == read


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "was given no words"),
        (" \n\t ", "was given no words"),
        ("x" * 10_001, "at most 10000"),
        ("a \x1b[31mred\x1b[0m ship", "U\\+001B"),
        ("a ship\x00", "U\\+0000"),
        ("a \ud800", "U\\+D800"),
        ("\u200d\u200b", "was given no words"),
    ],
)
def test_what_is_no_line_of_words_is_refused_in_a_sentence(text: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says) as refused:
        read_prompt(text, "--text")
    assert len(str(refused.value)) < 250


@pytest.mark.parametrize("text", ["一艘帆船", "!!! 123"])
def test_a_text_prompt_has_to_be_english(text: str) -> None:
    with pytest.raises(ConfigError, match="say it in English"):
        make_goal(text=text)


@given(st.text(max_size=200))
def test_names_and_titles_are_safe_and_short(text: str) -> None:
    try:
        prompt = read_prompt(text, "--text")
    except ConfigError:
        return
    name = name_of(prompt)
    assert 1 <= len(name) <= 40 and set(name) <= set("abcdefghijklmnopqrstuvwxyz0123456789-") and name[0] != "-"
    assert len(title_of(prompt)) <= 62 and "\n" not in prompt


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    path = tmp_path / "photo.png"
    images.save(picture(), path)
    return path


def test_a_photograph_by_its_file_or_as_it_is(photo: Path) -> None:
    for one in (photo, str(photo), images.load(photo), [photo]):
        (term,) = make_goal(one).terms
        assert isinstance(term, ImageTerm) and torch.equal(term.image, images.load(photo)) and term.weight == 1


def test_every_kind_with_its_weight(photo: Path) -> None:
    goal = make_goal(
        [photo, str(photo)], semantic=photo, sketch=photo, text=["a lemon", "a pear"], style=photo,
        weights={"image": 2, "style": 0.5},
    )  # fmt: skip
    kinds = [(type(term), term.weight) for term in goal.terms]
    assert kinds == [
        (ImageTerm, 2), (ImageTerm, 2), (SemanticTerm, 1), (SketchTerm, 1), (TextTerm, 1), (TextTerm, 1),
        (StyleTerm, 0.5),
    ]  # fmt: skip


def test_a_crop_is_kept_with_the_goal_and_is_what_is_planned(tmp_path: Path) -> None:
    """As a painting is resumed: from what was kept beside it."""
    photo = tmp_path / "photo.png"
    images.save(picture(60, 80), photo)
    whole = images.load(photo)
    spec = RunSpec.of(goal=[{"image": str(photo), "crop": (0.25, 0.5, 0.5, 0.5)}, {"image": str(photo)}])
    keep_goal(spec, tmp_path)
    again = RunSpec.of(**read_goal(tmp_path))
    assert [item.crop for item in again.goal] == [(0.25, 0.5, 0.5, 0.5), None]
    part = whole[:, 30:, 20:60]
    for kept in (spec, again):
        cropped, other = open_goal(kept).terms
        assert cropped.picture is not None and torch.equal(cropped.picture, part)
        assert other.picture is not None and torch.equal(other.picture, whole)
    assert again.goal[0].described.endswith("cropped")
    for wrong in ([0.6, 0, 0.5, 1], ["a", 0, 1, 1], [float("nan"), 0, 1, 1], 1):
        with pytest.raises(ConfigError, match=r"crop|number|tuple"):
            RunSpec.of(goal=[{"image": str(photo), "crop": wrong}])
    with pytest.raises(ConfigError, match="only pictures are cropped"):
        RunSpec.of(goal=[{"text": "a ship", "crop": [0, 0, 1, 1]}])


def test_what_makes_no_goal_is_refused(photo: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="without any term"):
        make_goal()
    with pytest.raises(ConfigError, match="'pixels'; weights are given to image, semantic, sketch, text, style"):
        make_goal(photo, weights={"pixels": 1})
    with pytest.raises(ConfigError, match="above 0"):
        make_goal(photo, weights={"image": 0})
    with pytest.raises(ImageError, match=r"shape \(64, 86\) was given; it is \[3, height, width\]"):
        make_goal(picture()[0])
    with pytest.raises(ImageError, match="does not exist"):
        make_goal(tmp_path / "nothing.png")
