import json
from pathlib import Path

import pytest

from frida_painter.system import images
from plugins import install_own_parts
from support.commandline import run_command
from support.plans import made_up_plan


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_plan_is_told_with_amounts_and_as_a_sheet(capsys) -> None:
    made_up_plan(60, 5).save(Path("plan.json"))
    assert run_command("mix", "plan.json") == 0
    told = capsys.readouterr().out
    assert told.partition("Shopping list")[0].count("#") == 5 and " ml" in told and "titanium white (PW6)" in told
    assert "Layer 1: medium brush, 60 strokes" in told and "The sheet: mixing.png" in told
    assert images.load(Path("mixing.png")).shape == (3, 1754, 1240)
    assert run_command("mix", ".", "--out", "again.jpg") == 0 and Path("again.jpg").exists()


def test_each_filling_of_the_wells_is_told_on_its_own(capsys) -> None:
    made_up_plan(40, 3).under(made_up_plan(20, 2, seed=5)).save(Path("plan.json"))
    assert run_command("mix", "plan.json") == 0
    first, second = capsys.readouterr().out.partition("Shopping list")[0].split("Layer 2: medium brush, 20 strokes")
    assert (first.count("#"), second.count("#")) == (3, 2)
    assert [path.name for path in Path().glob("*.png")] == ["mixing.png"]


def test_a_palette_and_one_s_own_paints(capsys) -> None:
    Path("mixed.json").write_text(json.dumps({"paints": ["#c9ab8a", "#000000"]}))
    Path("mine.toml").write_text("[[paint]]\nname='titanium white'\n[[paint]]\nname='brown'\ncolor='#8a5a2b'\n")
    assert run_command("mix", "mixed.json", "--paints", "mine.toml", "--most", "2") == 0
    told = capsys.readouterr().out
    assert "brown" in told and "titanium white" in told and " ml" not in told
    assert "Out of reach of these paints: more than 5 CIEDE2000 off." in told


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ('{"paints": []}', "has 0 paints; a palette has 1 to 64"),
        ('{"paints": ["#d0b090", "red"]}', "paint 2: 'red' is not a colour"),
        ('{"paints": "#d0b090"}', "is not a palette; a palette is a JSON file like"),
        ("[" * 100_000, ""),
    ],
)
def test_palettes_that_are_none(capsys, content: str, says: str) -> None:
    Path("mixed.json").write_text(content)
    assert run_command("mix", "mixed.json") == 2
    told = capsys.readouterr()
    assert says in told.err and told.out == "" and not Path("mixing.png").exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("nowhere.json",), "nowhere.json does not exist"),
        (("ok.json", "--paints", "nowhere.toml"), "nowhere.toml does not exist"),
        (("ok.json", "--paints", "ok.json"), "is not TOML"),
        (("ok.json", "--most", "5"), "5 is not from 1 to 4"),
        (("ok.json", "--finish", "satin"), "satin"),
        (("ok.json", "--out", "mixing.svg"), "ends in .png or .jpg"),
        ((".",), "plan.json does not exist"),
        ((), "PALETTE"),
    ],
)
def test_what_cannot_be_mixed(capsys, words: tuple[str, ...], says: str) -> None:
    Path("ok.json").write_text('{"paints": ["#d0b090"]}')
    assert run_command("mix", *words) == 2
    assert says in capsys.readouterr().err


def test_the_mixer_of_the_file_mixes(tmp_path: Path, monkeypatch, capsys) -> None:
    install_own_parts(tmp_path / "installed", monkeypatch)
    Path("mixed.json").write_text(json.dumps({"paints": ["#5a6fa0"]}))
    paints = "[[paint]]\nname='titanium white'\n[[paint]]\nname='ultramarine blue'\n"
    told = []
    for mixer in ("kubelka-munk", "dots"):
        Path("mine.toml").write_text(f"mixer = '{mixer}'\n{paints}")
        assert run_command("mix", "mixed.json", "--paints", "mine.toml") == 0
        told.append(capsys.readouterr().out)
    assert told[0] != told[1]
    Path("mine.toml").write_text(f"mixer = 'nonsense'\n{paints}")
    assert run_command("mix", "mixed.json", "--paints", "mine.toml") == 2
    assert "There is no mixer called 'nonsense'" in capsys.readouterr().err
