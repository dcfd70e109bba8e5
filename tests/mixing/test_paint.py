import pytest
import torch

from frida_painter.errors import ConfigError
from frida_painter.mixing.paint import (
    Paint,
    PaintDataSource,
    color_of,
    find_acrylic,
    mix_reflectance,
    published_names,
    reflectance,
)
from frida_painter.palette import ciede2000, from_hex, to_lab

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


def test_phthalo_blue_is_a_strong_paint_and_ultramarine_a_weak_one() -> None:
    strong, weak = (lab((name, 1), ("titanium white", 20))[0] for name in ("phthalo blue", "ultramarine blue"))
    assert weak - strong > 4


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
