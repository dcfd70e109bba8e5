import itertools
from functools import cache

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from frida_painter.mixing.paint import Paint
from frida_painter.mixing.recipe import ANY_PAINTS, PaintSet
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.planning.mixable import MIN_APART, make_mixable, mixing_changes
from frida_painter.planning.planner import Planner
from frida_painter.planning.settings import PlannerSettings
from frida_painter.strokes.palette import difference, from_hex

APART = 2.5
# Brighter than any acrylic: fluorescent pinks, greens, cyans and yellows, some of them hardly different.
SATURATED = ("#ff00ff", "#ff10e8", "#00ff00", "#20ff10", "#00ffff", "#ffff00", "#0000ff", "#ff2000")
MUTED = ("#d8c8b0", "#a08060", "#806050", "#608090", "#9a9a98", "#b8a0a0")

channels = st.integers(0, 255)
palettes = st.lists(st.tuples(channels, channels, channels), min_size=1, max_size=4, unique=True)


@cache
def acrylics() -> PaintSet:
    paints = PaintSet.of("acrylics")
    assert paints is not None
    return paints


def colors(*texts: str) -> Tensor:
    return torch.stack([from_hex(text) for text in texts])


def assert_mixable(color: Tensor) -> None:
    """Each colour is within reach, has its own recipe, and gives a mixture that is told apart from the others."""
    found = acrylics().mix(color)
    assert all(recipe.within_reach for recipe in found)
    assert len({recipe.words for recipe in found}) == len(found)
    assert all(
        float(difference(one.color, other.color)) >= MIN_APART for one, other in itertools.combinations(found, 2)
    )


@settings(max_examples=12, deadline=None)
@given(palettes, st.integers(0, 9))
def test_each_palette_becomes_one_that_can_be_mixed_and_then_stays(given: list, heavy: int) -> None:
    color = torch.tensor(given) / 255
    weight = torch.ones(len(color)).index_fill(0, torch.tensor(heavy % len(color)), 50.0)
    made = make_mixable(color, weight, acrylics(), APART)
    assert_mixable(made.color)
    assert made.number.unique().tolist() == list(range(len(made.color)))
    again = make_mixable(made.color, torch.ones(len(made.color)), acrylics(), 0.0)
    assert torch.equal(again.color, made.color) and not again.changes
    assert sorted(len(change.colors) for change in made.changes if len(change.colors) > 1) == sorted(
        count for count in made.number.bincount().tolist() if count > 1
    )


def test_colors_that_can_be_mixed_stay_bit_by_bit() -> None:
    color = colors(*MUTED)
    made = make_mixable(color, torch.ones(len(color)), acrylics(), APART)
    assert torch.equal(made.color, color) and made.number.tolist() == list(range(len(color))) and not made.changes


def test_two_pinks_with_one_recipe_become_one_and_the_change_is_told() -> None:
    made = make_mixable(colors("#ff00ff", "#608090", "#ff10e8"), torch.tensor([3, 1, 1]), acrylics(), APART)
    assert made.number.tolist() == [0, 1, 0] and torch.equal(made.color[1], from_hex("#608090"))
    (change,) = made.changes
    assert "#ff00ff" in str(change) and "#ff10e8" in str(change) and min(change.differences) > 5
    assert float(difference(made.color[0], from_hex("#ff00ff"))) == pytest.approx(change.differences[0], abs=1e-3)


def test_a_measured_black_is_a_black_that_can_be_mixed() -> None:
    black = from_hex("#141414")[None]
    unknown, measured = (PaintSet(acrylics().paints, darkest=darkest).mix(black)[0] for darkest in (None, (0.07,) * 3))
    assert not unknown.within_reach and measured.within_reach
    assert measured.verdict == "as dark as it gets", "the lack of darkness is still told"
    white, brown = Paint.of_color("white", from_hex("#f0f0f0")), Paint.of_color("brown", from_hex("#8a5a2b"))
    assert not PaintSet((white, brown)).mix(black)[0].within_reach, "there is no black paint"


def planner(picture: Tensor, **changed: object) -> Planner:
    wanted = {"strokes": 40, "colors": 8, "render_height": 64, "effort": 0.1, "focus": "none", "layers": 2, **changed}
    return Planner(Goal((ImageTerm(picture),)), PlannerSettings.of(canvas="12x9cm", brushes="broad,medium", **wanted))


def blocks(*texts: str) -> Tensor:
    """Eight or fewer colours side by side, [3, 64, 85]."""
    color = colors(*texts)
    return color[torch.arange(85) * len(color) // 85].T[:, None].expand(3, 64, 85).contiguous()


def test_wells_of_a_plan_towards_colors_out_of_reach_can_be_mixed_and_told_apart() -> None:
    plan = planner(blocks(*SATURATED)).plan()
    for _, part in plan.by_wells():
        assert_mixable(part.palette.color)
    assert mixing_changes(plan) and all("became" in words for words in mixing_changes(plan).values())
    assert len(plan) == 40


def test_a_plan_towards_colors_that_can_be_mixed_is_the_same_as_without_the_stage() -> None:
    with_stage, without = (
        planner(blocks(*MUTED), paints=paints, colors=len(MUTED)).plan() for paints in ("acrylics", ANY_PAINTS)
    )
    assert with_stage.digest == without.digest and not mixing_changes(with_stage)


def test_people_who_do_not_mix_keep_every_color() -> None:
    plan = planner(blocks(*SATURATED), paints=ANY_PAINTS).plan()
    assert not all(recipe.within_reach for recipe in acrylics().mix(plan.palette.color)) and not mixing_changes(plan)
