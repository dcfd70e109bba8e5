from pathlib import Path

import pytest
import torch

from frida_painter.errors import ConfigError
from frida_painter.mixing import Finish
from frida_painter.mixing.paint import (
    MAX_PAINTS,
    SIX,
    PaintDataSource,
    find_acrylic,
    inside,
    read_paints,
    usual_paints,
)
from frida_painter.palette import to_hex

WHOLE = """
[[paint]]
name = "Titanium White"
[[paint]]
name = "my ochre"
color = "#b97f2c"
[[paint]]
name = "my rose"
color = "#773849"
tint = "#d99ac6"
white = 10
"""


def file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "paints.toml"
    path.write_text(text)
    return path


def test_paints_are_known_by_name_by_colour_and_by_tint(tmp_path: Path) -> None:
    (white, ochre, rose), _, _ = read_paints(file(tmp_path, WHOLE))
    assert (white.name, white.source) == ("Titanium White", PaintDataSource.published)
    assert torch.equal(white.scattering, find_acrylic("titanium white").scattering)
    assert (to_hex(ochre.color), ochre.source) == ("#b97f2c", PaintDataSource.color)
    assert rose.source is PaintDataSource.tint and 0.005 < float(rose.scattering.mean()) < 0.3


def test_the_finish_of_paints_is_gloss_or_what_their_file_says(tmp_path: Path) -> None:
    assert read_paints(file(tmp_path, WHOLE))[1:] == (Finish.gloss, "kubelka-munk")
    assert read_paints(file(tmp_path, f"finish = 'matte'\nmixer = 'own'\n{WHOLE}"))[1:] == (Finish.matte, "own")
    with pytest.raises(ConfigError, match="finish is 'satin', and it is matte or gloss"):
        read_paints(file(tmp_path, f"finish = 'satin'\n{WHOLE}"))
    with pytest.raises(ConfigError, match="mixer is '3', and it is a name"):
        read_paints(file(tmp_path, f"mixer = 3\n{WHOLE}"))


def test_films_over_white_and_black_are_measured_against_the_white_of_the_file(tmp_path: Path) -> None:
    films = """
    [[paint]]
    name = "titanium white"
    over_white = "#eeeeec"
    over_black = "#d8dadc"
    [[paint]]
    name = "thin yellow"
    over_white = "#f4d21f"
    over_black = "#5c5a1a"
    """
    (white, yellow), _, _ = read_paints(file(tmp_path, films))
    assert white.source is yellow.source is PaintDataSource.films
    assert float(white.scattering.mean()) == pytest.approx(1)
    assert float(yellow.scattering.mean()) < 0.6, "what shows the ground scatters less"
    yellow_alone = films[films.rindex("[[paint]]") :]
    with pytest.raises(ConfigError, match="measured against titanium white"):
        read_paints(file(tmp_path, yellow_alone))


def test_the_six_that_are_taken_otherwise() -> None:
    assert tuple(paint.name for paint in usual_paints()) == SIX
    assert all(bool((inside(paint.absorption) >= 0).all()) for paint in usual_paints())


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "it has 1 to 32"),
        ("paint = 3", "it has 1 to 32"),
        ("[[paint]]\nname = 'x'\n[other]\na = 1", "it has 1 to 32"),
        ("[[paint]]", "paint 1 has no name"),
        ("paint = [3]", "paint 1 is no table"),
        ("[[paint]]\nname = ''", "paint 1 has no name of 1 to 40"),
        ("[[paint]]\nname = 'burnt sienna'", "burnt sienna is not one of the published paints (titanium white, carbon"),
        ("[[paint]]\nname = 'x'\ncolor = 'red'", "x: color 'red' is not a colour; write it like #b97f2c"),
        ("[[paint]]\nname = 'x'\ncolour = '#112233'", "x has 'colour', which is not known; there are name, color"),
        ("[[paint]]\nname = 'x'\ntint = '#112233'", "x needs a color, or color, tint and white"),
        ("[[paint]]\nname = 'x'\ncolor = '#112233'\ntint = '#a0a0b0'", "x needs a color, or color, tint and white"),
        ("[[paint]]\nname='x'\ncolor='#112233'\ntint='#a0a0b0'\nwhite=nan", "x: white is nan; it is how many parts"),
        ("[[paint]]\nname='x'\ncolor='#112233'\ntint='#a0a0b0'\nwhite=0", "x: white is 0"),
        ("[[paint]]\nname='x'\ncolor='#8090a0'\ntint='#200800'\nwhite=5", "x: its colour lies"),
        ("[[paint]]\nname='x'\nover_white='#203040'\nover_black='#8090a0'", "x: it is lighter over black"),
        ("[[paint]]\nname='x'\ncolor='#112233'\n[[paint]]\nname='x'\ncolor='#112244'", "x is there twice"),
        ("[[paint]\n", "is not TOML"),
    ],
)
def test_files_that_are_none_say_why(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(ConfigError) as refused:
        read_paints(file(tmp_path, text))
    assert says in str(refused.value) and "docs/how-to/mix.md" in str(refused.value)


def test_all_faults_are_named_at_once_and_too_many_paints_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as refused:
        read_paints(file(tmp_path, "[[paint]]\nname='a'\ncolor='b'\n[[paint]]\nname='c'\nwhite=0\ncolour='#000000'"))
    assert all(part in str(refused.value) for part in ("a: color", "c: white", "c has 'colour'"))
    with pytest.raises(ConfigError, match=f"1 to {MAX_PAINTS}"):
        read_paints(file(tmp_path, "[[paint]]\nname='titanium white'\n" * (MAX_PAINTS + 1)))
    with pytest.raises(ConfigError, match="does not exist"):
        read_paints(tmp_path / "nowhere.toml")
