from pathlib import Path

import pytest
import torch

from frida_painter import images
from frida_painter.errors import ConfigError, ImageError
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.kinds.semantic import SemanticTerm
from frida_painter.objectives.kinds.sketch import SketchTerm
from frida_painter.objectives.kinds.style import StyleTerm
from frida_painter.objectives.kinds.text import TextTerm
from frida_painter.runs.simple_goal import make_goal
from scenes import picture


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    path = tmp_path / "photo.png"
    images.save(picture(), path)
    return path


def test_a_photograph_by_its_file_or_as_it_is(photo: Path) -> None:
    for given in (photo, str(photo), images.load(photo), [photo]):
        (term,) = make_goal(given).terms
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


def test_words_alone() -> None:
    assert make_goal(text="a lemon").terms == (TextTerm("a lemon"),)


def test_what_makes_no_goal_is_refused(photo: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="without any term"):
        make_goal()
    with pytest.raises(ConfigError, match="'pixels'; weights are given to image, semantic, sketch, text, style"):
        make_goal(photo, weights={"pixels": 1})
    with pytest.raises(ConfigError, match="above 0"):
        make_goal(photo, weights={"image": 0})
    with pytest.raises(ConfigError, match=r"shape \(64, 86\) was given to image"):
        make_goal(picture()[0])
    with pytest.raises(ImageError, match="does not exist"):
        make_goal(tmp_path / "nothing.png")
