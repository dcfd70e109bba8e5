"""`--imagine` on the command line: the making, the choice, and what is refused before anything is made."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from frida_painter.errors import Interrupted
from frida_painter.planning.fields import limits_of
from frida_painter.system import images
from frida_painter_cli import imagining
from frida_painter_cli.imagining import choose_picture
from frida_painter_words.picture_makers import making as picture_making
from frida_painter_words.picture_makers.making import MadePicture, Making
from support.commandline import Command
from tiny_pipelines import fetch_imagine

PAINTER = """
import sys
from PIL import Image, ImageDraw
words, seed, out = sys.argv[1], int(sys.argv[2]), sys.argv[3]
picture = Image.new("RGB", (64, 48), (120, 170, 220))
ImageDraw.Draw(picture).rectangle((10 * seed, 10, 10 * seed + 8, 40), fill=(200, 40, 30))
picture.save(out)
"""
CHEAP = ("--canvas", "120x90mm", "--render-height", 64)
SMALL = ("--strokes", 8, "--colors", 2, *CHEAP, "--effort", 0.05, "--out", "planned")


@pytest.fixture
def say(tmp_path: Path, call: Command) -> Callable[..., str]:
    """say(word, ...): exit status and all that the command says, as text."""
    (tmp_path / "maker.py").write_text(PAINTER)

    def saying(*words: object) -> str:
        said = call(*words)
        return f"{said.status}: {said.err}{said.out}"

    return saying


def test_a_plan_from_words_by_a_program(say: Callable[..., str], tmp_path: Path) -> None:
    maker = f"command:{sys.executable} maker.py {{words}} {{seed}} {{out}}"
    asked = ("--text", "a red tower", "--imagine", maker, "--imagine-pictures", 1)
    said = say("plan", *asked, *SMALL, "--seed", 3)
    assert said.startswith("0: ") and "Made from 'a red tower' by command" in said and "(seed 3)" in said, said
    record = json.loads((tmp_path / "planned" / "goal" / "1" / "making.json").read_text())
    assert record["words"] == "a red tower" and record["chosen"] == "a-red-tower-1.png"
    assert '= "1/a-red-tower-1.png"' in (tmp_path / "planned" / "goal" / "goal.toml").read_text()


def test_the_fetched_generator_makes_the_first_picture_of_words(
    say: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FRIDA_PAINTER_MODELS", str(tmp_path / "models"))
    folder = fetch_imagine(tmp_path / "models")
    said = say("plan", "--text", "a red tower", "--imagine-pictures", 2, *SMALL)
    assert said.startswith("0: ") and "A picture is made from the words first" in said and "--beginning scene" in said
    assert "by diffusers, SimianLuo/LCM_Dreamshaper_v7, StableDiffusionPipeline, 4 steps" in said
    record = json.loads((tmp_path / "planned" / "goal" / "1" / "making.json").read_text())
    assert record["words"] == "a red tower" and len(record["pictures"]) == 2
    with next(folder.glob("unet/*.safetensors")).open("r+b") as file:
        file.seek(-1, 2)
        file.write(b"?")
    said = say("plan", "--text", "a red tower", *SMALL[:-1], "again")
    assert said.startswith("2: ") and "was altered after it was fetched (unet/" in said, said
    assert "or go on without it by --beginning" in said.splitlines()[-1] and not (tmp_path / "again").exists()


@pytest.mark.parametrize("options", [("--beginning", "scene"), ("--beginning", "colors"), ("--pictures", ".")])
def test_words_that_say_how_they_begin_go_the_old_way(
    say: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...]
) -> None:
    monkeypatch.setenv("FRIDA_PAINTER_MODELS", str(tmp_path / "models"))
    (tmp_path / "models" / "imagine").mkdir(parents=True)
    (tmp_path / "models" / "imagine" / "record.json").write_text("{}")
    said = say("plan", "--text", "a red tower", *options, *SMALL)
    assert said.startswith("2: ") and "models fetch" in said and "made from the words" not in said, said
    said = say("plan", "--text", "a red tower", *SMALL)
    assert said.startswith("2: ") and "models fetch imagine" in said and "Traceback" not in said, said
    for words in ("\u5e06\u8239", "no dogs", " "):
        said = say("plan", "--text", words, *SMALL)
        assert said.startswith("2: ") and said.count("\n") == 1 and "made from the words" not in said, said


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--text", "a hat", "--imagine", "crystal-ball"), "There is no picture maker called 'crystal-ball'"),
        (("--text", "a hat", "--imagine", "command"), "was given no program"),
        (("--text", "a hat", "--imagine-pictures", "3"), "--imagine-pictures was given without --imagine"),
        (("maker.png", "--imagine", "command:true"), "there are none; give them with --text"),
        (
            ("--text", "a hat", "--imagine", "command:false"),
            "ended with status 1 and made no picture; try it by itself",
        ),
        (("--text", "a hat", "--imagine", "command:true", "--imagine-minutes", "0"), "0 minutes were given"),
        (("--text", "a hat", "--imagine", "command:false", "--brush", "comb"), "comb is no brush"),
        (("--text", "a hat", "--imagine", "command:false", "--style", "no.jpg"), "no.jpg does not exist"),
        (("--text", "a hat", "--imagine", "command:false", "--avoid", "text"), "--avoid is for words, and the goal"),
        (("--text", "a hat", "--imagine", "command:false", "--clip", "no-clip"), "no-clip cannot be loaded as CLIP"),
    ],
)
def test_what_cannot_be_is_one_sentence_and_plans_nothing(
    say: Callable[..., str], tmp_path: Path, words: tuple[str, ...], says: str
) -> None:
    said = say("plan", *words, *CHEAP, "--focus", "none", "--out", "planned")
    assert said.startswith("2: ") and says in said and "Traceback" not in said, said
    assert not (tmp_path / "planned").exists() and not list(tmp_path.rglob("*.png"))


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--pictures", "."), "nothing of this goal is made of pictures of things"),
        (("--semantic", "photo.png"), "frida-painter models fetch efficientnet-lite0"),
        (("--strokes", "3", "--colors", "2", "--brushes", "broad:90%,medium:10%"), "medium gets 10 % of 3 strokes"),
        (("--strokes-of", "no-such"), "no-such"),
        (("--palette", "no.toml"), "no.toml"),
        (("--on-canvas",), "--on-canvas was given"),
        (("--robot", "no-such"), "There is no robot 'no-such'"),
        (("--robot", "axidraw", "--camera", "none"), "needs a workspace file"),
    ],
)
def test_whatever_refuses_a_painting_refuses_it_before_anything_is_made(
    say: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], says: str
) -> None:
    """A picture may take minutes, or cost money."""
    monkeypatch.setenv("FRIDA_PAINTER_MODELS", str(tmp_path / "no-models"))
    images.save(torch.rand(3, 48, 64, generator=torch.Generator().manual_seed(0)), tmp_path / "photo.png")
    focus = () if "--focus" in options else ("--focus", "none")
    said = say("paint", "--text", "a hat", "--imagine", "command:touch made", *CHEAP, *focus, *options)
    assert said.startswith("2: ") and says in said and "Traceback" not in said, said
    assert not (tmp_path / "made").exists() and not list(tmp_path.rglob("a-hat*"))


def making(folder: Path) -> Making:
    pictures = []
    for number in (1, 2, 3):
        (folder / f"hat-{number}.png").write_bytes(b"picture")
        pictures.append(MadePicture(folder / f"hat-{number}.png", number, torch.zeros(3, 4, 4)))
    return Making("a hat", "fake", {"model": "tiny"}, folder, tuple(pictures), 1, "it is the best")


@pytest.mark.parametrize(("lines", "chosen"), [([""], 2), (["3"], 3), (["0", "4", "x", " 1 "], 1)])
def test_a_person_chooses_by_number_or_takes_the_best(tmp_path: Path, lines: list[str], chosen: int) -> None:
    left = iter(lines)
    assert choose_picture(making(tmp_path), lambda prompt: next(left)).name == f"hat-{chosen}.png"
    assert next(left, None) is None
    assert json.loads((tmp_path / "making.json").read_text())["chosen"] == f"hat-{chosen}.png"


def test_who_leaves_paints_nothing_and_keeps_the_pictures(tmp_path: Path) -> None:
    def leave(prompt: str) -> str:
        raise EOFError

    with pytest.raises(Interrupted, match="Nobody chose a picture, and nothing was painted; they are in"):
        choose_picture(making(tmp_path), leave)
    assert (tmp_path / "hat-1.png").exists()


def test_the_limits_in_the_help_are_those_of_the_making() -> None:
    """They stand twice, since help loads no tensors."""
    for name, noun in (("imagine_pictures", "PICTURES"), ("imagine_minutes", "MINUTES")):
        field = imagining.ImaginingSettings.model_fields[name]
        assert field.default == getattr(picture_making, f"USUAL_{noun}")
        assert limits_of(field)["le"] == getattr(picture_making, f"MAX_{noun}")
