from pathlib import Path

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.errors import ConfigError
from frida_painter.mixing import Finish
from frida_painter.mixing.paint import (
    BANDS,
    MAX_PAINTS,
    Paint,
    PaintDataSource,
    color_of,
    film_over,
    find_acrylic,
    inside,
    mix_reflectance,
    published_names,
    ratio,
    read_paints,
    reflectance,
    reflectance_of,
)
from frida_painter.strokes.palette import ciede2000, from_hex, to_hex, to_lab

PAINTS = {name: find_acrylic(name) for name in published_names()}

# Golden Artist Colors' own measurements (CIE L*a*b*) of thin drawdowns of the same pigments in fluid acrylics.
MEASURED = {
    "titanium white": (98.28, -0.9, 1.67),
    "carbon black": (25.77, 0.2, -0.17),
    "pyrrole red": (42.26, 54.6, 31.25),
    "quinacridone magenta": (31.41, 27.69, 2.75),
    "ultramarine blue": (24.36, 12.28, -25.74),
    "phthalo blue": (24.95, 8.48, -18.01),
    "phthalo green": (27.19, -8.89, -4.8),
}


def lab(*colors: tuple[str, int]) -> list[float]:
    """Lab of a mixture of published paints in these parts."""
    parts = torch.tensor([[float(count) for _, count in colors]], dtype=torch.float64)
    absorption = torch.stack([PAINTS[name].absorption for name, _ in colors])
    scattering = torch.stack([PAINTS[name].scattering for name, _ in colors])
    return to_lab(color_of(mix_reflectance(parts, absorption, scattering)))[0].tolist()


def test_the_published_paints_look_as_their_maker_measured_them() -> None:
    off = {
        name: float(ciede2000(to_lab(PAINTS[name].color), torch.tensor(measured, dtype=torch.float64)))
        for name, measured in MEASURED.items()
    }
    assert max(off.values()) < 5, off
    assert sum(off.values()) / len(off) < 3, off


def test_blue_and_yellow_make_green_and_red_and_yellow_orange() -> None:
    _, a, b = lab(("phthalo blue", 1), ("hansa yellow", 4))
    assert a < -25 and b > 25
    _, a, b = lab(("ultramarine blue", 1), ("hansa yellow", 1))
    assert a < -10 and b > 20, "a duller green, as ultramarine makes"
    _, a, b = lab(("pyrrole red", 1), ("hansa yellow", 4))
    assert 20 < a < 50 and b > 40
    _, a, b = lab(("quinacridone magenta", 3), ("ultramarine blue", 3), ("titanium white", 4))
    assert a > 15 and b < -15, "a violet"


@pytest.mark.parametrize("name", [name for name in PAINTS if name != "titanium white"])
def test_white_lightens_and_more_white_lightens_more(name: str) -> None:
    lightness = [lab((name, 4), ("titanium white", white))[0] for white in (0, 1, 4, 16, 64)]
    assert lightness == sorted(lightness) and lightness[-1] > lightness[0]


def test_a_paint_of_which_only_its_colour_is_known_has_that_colour() -> None:
    for text in ("#b97f2c", "#f0ede2", "#9a6d60", "#2f6b3a"):
        paint = Paint.of_color("mine", from_hex(text).double())
        assert torch.allclose(paint.color, from_hex(text).double(), atol=2e-3)
        assert paint.source is PaintDataSource.color


def test_a_tint_tells_how_strong_a_paint_is() -> None:
    known = PAINTS["quinacridone magenta"]
    white = PAINTS["titanium white"]
    tint = color_of(
        mix_reflectance(
            torch.tensor([[1.0, 10.0]], dtype=torch.float64),
            torch.stack((known.absorption, white.absorption)),
            torch.stack((known.scattering, white.scattering)),
        )
    )[0]
    told = Paint.of_tint("mine", known.color, tint, 10)
    guessed = Paint.of_color("mine", known.color)

    def with_white(paint: Paint) -> torch.Tensor:
        k, s = paint.absorption + 30 * white.absorption, paint.scattering + 30 * white.scattering
        return to_lab(color_of(reflectance(k, s)))

    off = [float(ciede2000(with_white(paint), with_white(known))) for paint in (told, guessed)]
    assert off[0] < 3 < off[1], off


@pytest.mark.parametrize(
    ("name", "tint", "parts"),
    [("phthalo blue", "#7bc3e7", 10), ("dioxazine purple", "#c2b7e0", 20), ("ultramarine blue", "#b8ceed", 10)],
)
def test_of_paints_too_dark_to_be_told_by_their_colour_a_tint_of_any_strength_tells(
    name: str, tint: str, parts: int
) -> None:
    wanted, white = PAINTS[name], PAINTS["titanium white"]
    known = Paint.of_tint(name, wanted.color, from_hex(tint).double(), parts)
    tints = [
        color_of(reflectance(one.absorption + 4 * white.absorption, one.scattering + 4 * white.scattering))
        for one in (known, wanted)
    ]
    assert float(ciede2000(*(to_lab(color) for color in tints))) < 2


def test_a_tint_that_cannot_be_is_refused() -> None:
    with pytest.raises(ConfigError, match="CIEDE2000 from all that a paint with this tint can have"):
        Paint.of_tint("mine", from_hex("#8090a0").double(), from_hex("#201008").double(), 5)


parts = st.floats(0.08, 0.96)
colors = st.tuples(parts, parts, parts).map(lambda color: torch.tensor(color, dtype=torch.float64))


@given(colors)
def test_the_smoothest_reflectance_has_the_colour_it_was_made_for(color: torch.Tensor) -> None:
    found = reflectance_of(color)
    assert found.shape == (len(BANDS),) and bool(((found > 0) & (found < 1)).all())
    assert torch.allclose(color_of(found), color, atol=1e-6)


def test_grey_reflects_alike_everywhere_and_all_of_it_is_white() -> None:
    grey = reflectance_of(torch.full((3,), 0.5, dtype=torch.float64))
    assert float(grey.max() - grey.min()) < 1e-6
    assert torch.allclose(color_of(torch.ones(16, dtype=torch.float64)), torch.ones(3, dtype=torch.float64))


def test_every_colour_even_the_purest_has_one() -> None:
    corners = torch.cartesian_prod(*3 * [torch.tensor([0.0, 1.0], dtype=torch.float64)])
    found = reflectance_of(corners)
    assert found.shape == (8, 16) and bool(torch.isfinite(found).all())
    assert float((color_of(found) - corners).abs().max()) < 0.05, "brought to where paints end"


positive = st.floats(0.01, 5)


def t(*numbers: float) -> torch.Tensor:
    return torch.tensor(numbers, dtype=torch.float64)


@given(positive, positive)
def test_absorption_over_scattering_comes_back_from_what_is_seen(absorption: float, scattering: float) -> None:
    seen = reflectance(t(absorption), t(scattering))
    assert float(ratio(seen)) == pytest.approx(absorption / scattering, rel=1e-6, abs=1e-6) or float(seen) < 0.04


@given(positive, positive, st.floats(0.1, 9))
def test_a_paint_mixed_with_itself_stays_what_it_is(absorption: float, scattering: float, parts: float) -> None:
    k, s = t(absorption)[None].repeat(2, 1), t(scattering)[None].repeat(2, 1)
    alone = reflectance(t(absorption), t(scattering))
    assert torch.allclose(mix_reflectance(t(parts, 1.0)[None], k, s)[0], alone)


@given(positive, positive, positive, positive, st.floats(0.05, 0.95))
def test_a_mixture_lies_between_its_paints(k1: float, s1: float, k2: float, s2: float, share: float) -> None:
    one, other = reflectance(t(k1), t(s1)), reflectance(t(k2), t(s2))
    between = mix_reflectance(t(share, 1 - share)[None], t(k1, k2)[:, None], t(s1, s2)[:, None])[0]
    assert float(torch.minimum(one, other)) - 1e-9 <= float(between) <= float(torch.maximum(one, other)) + 1e-9


@given(st.floats(0.05, 2), st.floats(0.3, 3))
def test_a_film_over_white_and_black_tells_both_constants(absorption: float, scattering: float) -> None:
    """Against the hyperbolic solution, written down once more the other way round."""
    a = 1 + absorption / scattering
    b = (a * a - 1) ** 0.5
    coth = b / torch.tanh(t(b * scattering))

    def over(ground: float) -> torch.Tensor:
        within = (1 - ground * (a - coth)) / (a - ground + coth)
        return 0.035 + 0.965 * 0.4 * within / (1 - 0.6 * within)

    white = t(0.95)
    found = film_over(over(float(inside(white))), over(0.0), white)
    assert float(found[0]) == pytest.approx(absorption, rel=2e-2)
    assert float(found[1]) == pytest.approx(scattering, rel=2e-2)


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
