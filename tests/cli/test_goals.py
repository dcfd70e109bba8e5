"""Goals on the command line: what is understood, what is refused, and what the record says of it."""

import json
from pathlib import Path
from typing import Any

import pytest
import torch
from PIL import Image

from frida_painter.errors import ConfigError, FridaError
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.sketch import SketchTerm
from frida_painter.objectives.style import StyleTerm
from frida_painter.runs.goals import open_goal, picture_of
from frida_painter.runs.spec import RunSpec
from frida_painter.system import images
from frida_painter_cli.options import read_goal_options
from frida_painter_words.text import TextTerm
from support.commandline import run_command
from support.networks import QuickEncoders
from support.planning import picture


def asked(photo: Path | None, given: dict[str, Any]) -> RunSpec:
    return RunSpec.of(**read_goal_options(photo, given))


def goal_of(photo: Path | None, given: dict[str, Any]) -> Goal:
    return open_goal(asked(photo, given))


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    images.save(picture(), tmp_path / "photo.png")
    return tmp_path / "photo.png"


@pytest.fixture
def waves(tmp_path: Path) -> Path:
    images.save(1 - picture(40, 40), tmp_path / "waves.png")
    return tmp_path / "waves.png"


def test_photo_and_styles_with_their_weights(photo: Path, waves: Path) -> None:
    given = {"style": [waves, photo], "style_weight": [2.0, 0.5], "init_style": [waves], "image_weight": [3.0]}
    wanted, goal = asked(photo, given), goal_of(photo, given)
    assert [(type(term), term.weight) for term in goal.terms] == [(ImageTerm, 3.0), (StyleTerm, 2.0), (StyleTerm, 0.5)]
    assert isinstance(goal.initial[0], StyleTerm)
    assert isinstance(goal.initial_terms[0], ImageTerm), "to begin with a style is to begin with its picture"
    assert wanted.goal_facts[1] == ("Style of", "waves.png (weight 2)")
    assert wanted.heading == "Photo" and wanted.name == "photo"


def test_words_beside_pictures_or_alone(photo: Path, waves: Path) -> None:
    given = {"text": ["a sailing ship", "a lemon"], "text_weight": [2.0, 0.5], "init_text": ["the sea"]}
    goal = goal_of(photo, given)
    assert [type(term) for term in goal.terms] == [ImageTerm, TextTerm, TextTerm]
    assert [term.weight for term in goal.terms] == [1.0, 2.0, 0.5]
    assert goal.initial == (TextTerm("the sea"),)
    alone = asked(None, {"text": ["a <b>ship</b>"], "style": [waves]})
    assert (alone.heading, alone.name, picture_of(open_goal(alone))) == ("A <b>ship</b>", "a-b-ship-b", None)
    assert alone.goal_facts[0] == ("Words", "“A <b>ship</b>”")


def test_a_goal_file_names_pictures_beside_itself(photo: Path, waves: Path) -> None:
    path = photo.with_name("goal.toml")
    path.write_text(
        '[[goal]]\nimage = "photo.png"\n[[goal]]\nstyle = "waves.png"\nweight = 2\n[[initial]]\nimage = "waves.png"'
    )
    goal = goal_of(None, {"goal": path})
    assert [type(term) for term in goal.terms] == [ImageTerm, StyleTerm] and goal.terms[1].weight == 2
    assert len(goal.initial) == 1
    path.write_text('[[goal]]\ntext = "a ship"\nweight = 2\n[[initial]]\ntext = "the sea"')
    assert goal_of(None, {"goal": path}).terms == (TextTerm("a ship", 2.0),)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("goal = [", "is not TOML"),
        ("gaol = 1", "'gaol'"),
        ("goal = 3", "is not a list of tables"),
        ('[[goal]]\nstyle = "waves.png"\nimage = "photo.png"', "has one of image, semantic, sketch, text, style"),
        ('[[goal]]\nstyle = "waves.png"\nweight = true', "perhaps a weight"),
        ('[[goal]]\nstyle = "waves.png"\nweight = nan', "weights are above 0"),
        ('[[goal]]\nstyle = "none.png"', "does not exist"),
        ("", "nothing to paint"),
    ],
)
def test_a_goal_file_that_makes_no_goal(photo: Path, waves: Path, text: str, says: str) -> None:
    path = photo.with_name("goal.toml")
    path.write_text(text)
    with pytest.raises(FridaError, match=says):
        goal_of(None, {"goal": path})


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"style_weight": [1.0]}, "given 1 times for 2 goals"),
        ({"style_weight": [1.0, 1.0, 1.0]}, "given 3 times for 2 goals"),
        ({"style_weight": [1.0, 0.0]}, "weights are above 0"),
        ({"style_weight": [1.0, float("nan")]}, "weights are above 0"),
        ({"image_weight": [1.0, 1.0]}, "2 times for 1 goals, PHOTO among them"),
    ],
)
def test_weights_that_do_not_fit(photo: Path, waves: Path, given: dict[str, Any], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        goal_of(photo, {"style": [waves, waves], **given})


def test_nothing_and_too_much(photo: Path, waves: Path) -> None:
    with pytest.raises(ConfigError, match="nothing to paint"):
        goal_of(None, {})
    with pytest.raises(ConfigError, match="at most 20"):
        goal_of(photo, {"style": [waves] * 20})


def test_a_styled_painting_says_what_it_was_and_through_what_it_was_seen(
    photo: Path, waves: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(EncoderRegistry, "style", QuickEncoders.style)
    out = tmp_path / "out"
    words = ["paint", str(photo), "--style", str(waves), "--style-weight", "2", "--strokes", "6", "--replans", "1"]
    words += ["--effort", "0.05", "--render-height", "64", "--no-film", "--out", str(out)]
    assert run_command(*words) == 0
    assert "Seeing style through random mixtures (better: VGG16)" in capsys.readouterr().err
    settings = json.loads((out / "result.json").read_text())["settings"]
    assert settings["goal"] == [["Picture", "photo.png"], ["Style of", "waves.png (weight 2)"]]
    assert settings["encoders"] == [{"purpose": "style", "used": "random mixtures", "better": "VGG16"}]
    page = (out / "index.html").read_text()
    assert "random mixtures" in page and "waves.png (weight 2)" in page


def test_a_sketch_and_a_blank_sheet(photo: Path) -> None:
    lines = torch.ones(4, 60, 80)
    lines[3] = 0
    lines[:3, 30, 10:70], lines[3, 30, 10:70] = 0, 1
    drawn = photo.with_name("drawn.png")
    Image.fromarray((255 * lines).byte().permute(1, 2, 0).numpy(), "RGBA").save(drawn)
    wanted = asked(photo, {"sketch": [drawn], "sketch_weight": [0.5]})
    term = open_goal(wanted).terms[1]
    assert isinstance(term, SketchTerm) and term.weight == 0.5
    assert wanted.goal_facts[1] == ("Sketch", "drawn.png (weight 0.5)")
    lines[3] = 0
    Image.fromarray((255 * lines).byte().permute(1, 2, 0).numpy(), "RGBA").save(drawn)
    with pytest.raises(ConfigError, match=r"--sketch .*: A sketch without a single line"):
        goal_of(photo, {"sketch": [drawn]})


def test_words_are_painted_without_any_photograph(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("sentences", "keep", "own"):
        monkeypatch.setattr(EncoderRegistry, name, getattr(QuickEncoders, name), raising=False)
    out = tmp_path / "out"
    words = ["paint", "--text", "a <script>alert(1)</script> ship", "--strokes", "5", "--replans", "1"]
    words += ["--effort", "0.05", "--render-height", "64", "--out", str(out)]
    assert run_command(*words) == 0
    said = capsys.readouterr().err
    assert "Seeing words through a bag of words (better: CLIP)" in said and "--pictures or --image" in said
    assert "not shown: " in said
    result = json.loads((out / "result.json").read_text())
    assert result["settings"]["goal"] == [["Words", "“A <script>alert(1)</script> ship”"]]
    assert result["settings"]["remarks"] and result["strokes_painted"] == 5
    assert [one["what"] for one in result["comparisons"]] == ["The painting against the first plan"]
    page = (out / "index.html").read_text()
    assert "<script>alert" not in page and "&lt;script&gt;alert(1)" in page and "From words to canvas" in page
    assert (out / "film.mp4").exists() and not (out / "target.jpg").exists()
