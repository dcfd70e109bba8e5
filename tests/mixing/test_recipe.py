import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st

from frida_painter.errors import ConfigError
from frida_painter.mixing import Finish
from frida_painter.mixing.paint import Paint, color_of, mix_reflectance, usual_paints
from frida_painter.mixing.recipe import (
    _PER_DOUBLING,
    _PER_PAINT,
    EASY_PAINTS,
    EASY_PARTS,
    KUBELKA_MUNK,
    MAX_PARTS,
    NEAR,
    REACHED,
    PaintSet,
    Recipe,
)
from frida_painter.strokes.palette import ciede2000, difference, from_hex, to_lab

SIX = usual_paints()


def recipes(
    colors: torch.Tensor, paints: Sequence[Paint], most: int = 4, finish: Finish = Finish.matte
) -> list[Recipe]:
    return PaintSet(tuple(paints), finish, darkest=None).mix(colors, most)


def mixture(parts: list[int]) -> torch.Tensor:
    weights = torch.tensor([parts], dtype=torch.float64)
    return color_of(
        mix_reflectance(weights, torch.stack([p.absorption for p in SIX]), torch.stack([p.scattering for p in SIX]))
    )[0]


@settings(max_examples=min(20, settings.default.max_examples))
@given(st.dictionaries(st.integers(0, 5), st.integers(1, 9), min_size=1, max_size=3))
def test_what_can_be_mixed_is_found_again(parts: dict[int, int]) -> None:
    (found,) = recipes(mixture([parts.get(index, 0) for index in range(6)])[None], SIX)
    assert found.difference < 3.5 and found.within_reach


@settings(max_examples=min(15, settings.default.max_examples))
@given(st.tuples(*3 * [st.floats(0, 1)]), st.integers(1, 4))
def test_recipes_are_short_small_in_lowest_terms_and_say_what_they_give(color: tuple[float, ...], most: int) -> None:
    target = torch.tensor(color, dtype=torch.float64)
    (found,) = recipes(target[None], SIX, most)
    counts = [count for _, count in found.parts]
    assert 1 <= len(counts) <= most and sum(counts) <= MAX_PARTS and min(counts) >= 1
    assert math.gcd(*counts) == 1 and counts == sorted(counts, reverse=True)
    by_name = {paint.name: count for paint, count in found.parts}
    again = mixture([by_name.get(paint.name, 0) for paint in SIX])
    assert torch.allclose(again, found.color, atol=1e-9)
    assert float(difference(again, target)) == pytest.approx(found.difference, abs=1e-3)
    assert sum(found.volumes(7.0)) == pytest.approx(7.0)


def easy(recipe: Recipe) -> bool:
    return len(recipe.parts) <= EASY_PAINTS and recipe.whole <= EASY_PARTS


@cache
def every_easy_mixture() -> tuple[torch.Tensor, torch.Tensor]:
    """Returns Lab [m, 3] of all easy mixtures of the six paints, one by one, and which have black, [m]."""
    absorption, scattering = (torch.stack([getattr(p, name) for p in SIX]) for name in ("absorption", "scattering"))
    thirds = torch.tensor(
        [(a, b, c) for a in range(41) for b in range(41 - a) for c in range(41 - a - b) if math.gcd(a, b, c) == 1]
    )
    colors, blacks = [], []
    for paints in itertools.combinations(range(6), 3):
        parts = torch.zeros(len(thirds), 6, dtype=torch.float64)
        parts[:, list(paints)] = thirds.double()
        colors.append(to_lab(color_of(mix_reflectance(parts, absorption, scattering))))
        blacks.append(parts[:, [paint.name for paint in SIX].index("carbon black")] > 0)
    return torch.cat(colors), torch.cat(blacks)


@settings(max_examples=min(8, settings.default.max_examples))
@given(st.lists(st.integers(0, 20), min_size=6, max_size=6).filter(any))
@example([3, 5, 1, 1, 0, 4])
@example([20, 8, 6, 14, 11, 0])
def test_a_hard_recipe_is_given_only_if_no_easy_one_is_near(parts: list[int]) -> None:
    target = mixture(parts)
    (found,) = recipes(target[None], SIX)
    lab, (mixed, black) = to_lab(target), every_easy_mixture()
    off = ciede2000(mixed, lab)
    allowed = ~black | bool(lab[0] <= 45 or lab[1:].norm() <= 5)  # black is for darks and greys
    assert easy(found) or float(off[allowed].min()) > NEAR - 0.5
    assert found.within_reach or float(off.min()) > REACHED


def test_near_whites_get_traces_that_can_be_counted() -> None:
    cream, white = recipes(torch.stack([from_hex("#f2e9dc"), from_hex("#fbfbf8")]), SIX)
    assert cream.difference < 2.5 and EASY_PARTS < cream.whole <= MAX_PARTS
    assert white.whole == 1, "traces would not bring it nearer"


def hue_and_chroma(color: torch.Tensor) -> tuple[float, float]:
    _, a, b = to_lab(color).tolist()
    return math.degrees(math.atan2(b, a)), math.hypot(a, b)


@pytest.mark.parametrize(("pure", "chroma"), [("#ff0000", 60), ("#0000ff", 45), ("#00ff00", 45), ("#ff00ff", 45)])
def test_pure_colours_keep_their_hue_and_chroma(pure: str, chroma: float) -> None:
    (found,) = PaintSet.of("acrylics").mix(from_hex(pure)[None])
    hue, reached = hue_and_chroma(found.color)
    turned = abs((hue - hue_and_chroma(from_hex(pure))[0] + 180) % 360 - 180)
    assert not found.within_reach and easy(found)
    assert turned < 30 and reached > chroma, f"{found.words}: hue {turned:.0f} degrees away, chroma {reached:.0f}"


def test_black_is_for_darks() -> None:
    lights = torch.stack([from_hex(text) for text in ("#b5988c", "#e0c9a6", "#87ceeb", "#c9a27e")])
    assert not any(paint.name == "carbon black" for one in recipes(lights, SIX) for paint, _ in one.parts)
    (dark,) = recipes(from_hex("#2b2d30")[None], SIX)
    assert dark.parts[0][0].name == "carbon black"


def test_more_paints_never_come_out_worse_by_more_than_they_are_simpler() -> None:
    targets = torch.stack([from_hex(text) for text in ("#b5988c", "#3f6b9a", "#7a8f3c", "#e0c9a6")])
    few, many = (recipes(targets, SIX, most) for most in (2, 4))
    assert all(more.difference <= less.difference + 1 for less, more in zip(few, many, strict=True))
    assert all(one.difference < 4 for one in many)


@pytest.mark.parametrize("text", ["#c9a27e", "#d0b090"])
def test_a_very_little_of_a_fourth_paint_is_found(text: str) -> None:
    (found,) = recipes(from_hex(text)[None], SIX)
    assert found.within_reach and len(found.parts) == 4 and found.parts[-1][1] == 1


def test_what_no_paint_can_give_is_out_of_reach() -> None:
    green, black, red = recipes(torch.tensor([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.78, 0.17, 0.2]]), SIX)
    assert not green.within_reach and not black.within_reach
    assert red.within_reach and red.words == "1 pyrrole red"
    (varnished,) = recipes(torch.tensor([[0.12, 0.11, 0.12]]), SIX, finish=Finish.gloss)
    (matte,) = recipes(torch.tensor([[0.12, 0.11, 0.12]]), SIX)
    assert varnished.difference < matte.difference - 3


@pytest.mark.parametrize(
    ("missed", "off", "verdict"),
    [
        *((1.0, 1.0, ""), (2.04, 2.0, ""), (2.06, 2.1, "near"), (5.04, 5.0, "near"), (5.06, 5.1, "out of reach")),
        (math.nan, math.nan, "out of reach"),
    ],
)
def test_a_recipe_is_judged_by_the_number_that_people_read(missed: float, off: float, verdict: str) -> None:
    found = Recipe(torch.tensor([0.5, 0.5, 0.5]), ((SIX[0], 1),), torch.zeros(3), missed, missed)
    assert found.off == pytest.approx(off, nan_ok=True) and found.verdict == verdict
    assert found.within_reach == (verdict != "out of reach")
    limited = replace(found, difference=missed + 4)
    assert limited.off == pytest.approx(off, nan_ok=True) and limited.within_reach == found.within_reach


def test_no_recipe_with_one_part_more_or_less_would_be_better() -> None:
    (found,) = recipes(from_hex("#7a8f3c")[None], SIX)
    by_name = {paint.name: count for paint, count in found.parts}
    here = [by_name.get(paint.name, 0) for paint in SIX]

    def cost(parts: list[int]) -> float:
        used = sum(count > 0 for count in parts)
        return (
            float(difference(mixture(parts), found.target)) + _PER_PAINT * used + _PER_DOUBLING * math.log2(sum(parts))
        )

    for index, sign in itertools.product((at for at, count in enumerate(here) if count), (-1, 1)):
        assert cost(here) <= cost([count + sign * (at == index) for at, count in enumerate(here)]) + 1e-6


def test_the_search_among_many_paints_stays_small(monkeypatch: pytest.MonkeyPatch) -> None:
    many = [replace(SIX[at % 6], name=f"{at}", absorption=SIX[at % 6].absorption * (1 + at / 40)) for at in range(24)]
    tested = list[int]()

    def mix(parts: torch.Tensor, *paints: Any) -> torch.Tensor:
        tested.append(len(parts))
        return mix_reflectance(parts, *paints)

    monkeypatch.setattr("frida_painter.registry.load_part", lambda *_: replace(KUBELKA_MUNK, mix=mix))
    found = recipes(torch.stack([mixture([3, 1, 0, 1, 0, 0]), mixture([5, 1, 1, 0, 2, 1])]), many)
    assert all(one.difference < REACHED for one in found) and max(tested) < 300_000, "of 24 paints"


@pytest.mark.parametrize(("paints", "most"), [([], 4), (SIX, 0), (SIX, 5)])
def test_without_paints_there_is_no_mixture(paints: list, most: int) -> None:
    with pytest.raises(ConfigError, match="mixing takes"):
        recipes(torch.rand(1, 3), paints, most)
